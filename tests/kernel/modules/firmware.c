// SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
/*
 * What the firmware of a Raspberry Pi tells through the kernel: how warm the processor is, and
 * whether it is slowed down or has too little voltage.
 *
 * The temperature is a thermal zone without trip points: nothing is done about it, it is only told.
 * The other is a file of the device "soc:firmware" below "soc", where the Pi's driver has it too:
 * bits in hexadecimal.
 */
#include <linux/device.h>
#include <linux/err.h>
#include <linux/module.h>
#include <linux/platform_device.h>
#include <linux/sysfs.h>
#include <linux/thermal.h>

#include "rig.h"

static int temperature_mc = 45000;
module_param(temperature_mc, int, 0644);
MODULE_PARM_DESC(temperature_mc, "of the processor, in thousandths of a degree Celsius");
static uint throttled;
module_param(throttled, uint, 0644);
MODULE_PARM_DESC(throttled, "bits 0 to 3: under-voltage, capped, throttled, warm; now");

static struct platform_device *soc;
static struct platform_device *firmware;
static struct thermal_zone_device *zone;

static ssize_t get_throttled_show(struct device *dev, struct device_attribute *attr, char *buf)
{
	return sysfs_emit(buf, "%x\n", throttled);
}
static DEVICE_ATTR_RO(get_throttled);

static int get_temp(struct thermal_zone_device *asked, int *temperature)
{
	*temperature = temperature_mc;
	return 0;
}

static const struct thermal_zone_device_ops zone_ops = { .get_temp = get_temp };

static int add_firmware(void)
{
	struct platform_device_info info = { .name = "soc:firmware", .id = PLATFORM_DEVID_NONE };
	int error;

	soc = platform_device_register_simple("soc", PLATFORM_DEVID_NONE, NULL, 0);
	if (IS_ERR(soc))
		return PTR_ERR(soc);
	info.parent = &soc->dev;
	firmware = platform_device_register_full(&info);
	if (IS_ERR(firmware)) {
		platform_device_unregister(soc);
		return PTR_ERR(firmware);
	}
	error = device_create_file(&firmware->dev, &dev_attr_get_throttled);
	if (error) {
		platform_device_unregister(firmware);
		platform_device_unregister(soc);
	}
	return error;
}

static void remove_firmware(void)
{
	device_remove_file(&firmware->dev, &dev_attr_get_throttled);
	platform_device_unregister(firmware);
	platform_device_unregister(soc);
}

int rig_firmware_start(void)
{
	int error = add_firmware();

	if (error)
		return error;
	zone = thermal_tripless_zone_device_register("rig-thermal", NULL, &zone_ops, NULL);
	if (IS_ERR(zone)) {
		remove_firmware();
		return PTR_ERR(zone);
	}
	return 0;
}

void rig_firmware_end(void)
{
	thermal_zone_device_unregister(zone);
	remove_firmware();
}
