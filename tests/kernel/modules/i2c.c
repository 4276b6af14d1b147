// SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
/*
 * The I2C adapter: bus 1, as /dev/i2c-1, with raw transfers and repeated starts.
 *
 * What is asked is: for each message u16 address, u16 flags (1: a read), u16 length, u16 0, and
 * the bytes of a write. The answer is all bytes read; -EREMOTEIO, as the Pi's driver says it,
 * where nobody is at the address.
 */
#include <linux/delay.h>
#include <linux/i2c.h>
#include <linux/module.h>
#include <linux/platform_device.h>
#include <linux/slab.h>

#include "rig.h"

#define MOST_BYTES 60000

static int i2c_errno;
module_param(i2c_errno, int, 0644);
MODULE_PARM_DESC(i2c_errno, "every transaction fails with this error number (0: none does)");
static uint i2c_stuck_ms;
module_param(i2c_stuck_ms, uint, 0644);
MODULE_PARM_DESC(i2c_stuck_ms, "the bus is stuck: each transaction times out after so long");

struct one_message {
	u16 address;
	u16 flags;
	u16 length;
	u16 zero;
} __packed;

static struct platform_device *device;

/* Lays the messages out; returns the length, and how much will be read, or 0 if it is too much. */
static size_t lay_out(const struct i2c_msg *messages, int count, u8 *asked, size_t *read_bytes)
{
	size_t length = 0;
	int i;

	*read_bytes = 0;
	for (i = 0; i < count; i++) {
		bool is_read = messages[i].flags & I2C_M_RD;
		struct one_message one = {
			.address = messages[i].addr,
			.flags = is_read,
			.length = messages[i].len,
		};

		if (length + sizeof(one) + one.length > MOST_BYTES)
			return 0;
		memcpy(asked + length, &one, sizeof(one));
		length += sizeof(one);
		if (is_read) {
			*read_bytes += one.length;
		} else {
			memcpy(asked + length, messages[i].buf, one.length);
			length += one.length;
		}
	}
	return *read_bytes > MOST_BYTES ? 0 : length;
}

static int ask(struct i2c_msg *messages, int count, u8 *asked, u8 *answer)
{
	size_t length, read_bytes;
	int error, i;

	length = lay_out(messages, count, asked, &read_bytes);
	if (!length)
		return -EMSGSIZE;
	error = rig_ask(RIG_I2C_TRANSFER, asked, length, answer, read_bytes);
	if (error)
		return error;
	/* A byte and its acknowledgement at 100 kHz, the addresses too. */
	fsleep(90 * (read_bytes + length - count * (sizeof(struct one_message) - 1)));
	for (i = 0; i < count; i++) {
		if (!(messages[i].flags & I2C_M_RD))
			continue;
		memcpy(messages[i].buf, answer, messages[i].len);
		answer += messages[i].len;
	}
	return count;
}

static int transfer(struct i2c_adapter *adapter, struct i2c_msg *messages, int count)
{
	u8 *asked, *answer;
	int result = -ENOMEM;

	if (i2c_stuck_ms) {
		msleep(i2c_stuck_ms);
		return -ETIMEDOUT;
	}
	if (i2c_errno)
		return -i2c_errno;
	asked = kmalloc(MOST_BYTES, GFP_KERNEL);
	answer = kmalloc(MOST_BYTES, GFP_KERNEL);
	if (asked && answer)
		result = ask(messages, count, asked, answer);
	kfree(asked);
	kfree(answer);
	return result;
}

static u32 functionality(struct i2c_adapter *adapter)
{
	return I2C_FUNC_I2C | I2C_FUNC_SMBUS_EMUL;
}

static const struct i2c_algorithm algorithm = {
	.master_xfer = transfer,
	.functionality = functionality,
};

static struct i2c_adapter adapter = {
	.owner = THIS_MODULE,
	.algo = &algorithm,
	.name = "rig-i2c",
	.nr = 1,
};

static int i2c_probe(struct platform_device *found)
{
	adapter.dev.parent = &found->dev;
	return i2c_add_numbered_adapter(&adapter);
}

static void i2c_remove(struct platform_device *found)
{
	i2c_del_adapter(&adapter);
}

static struct platform_driver i2c_driver_of_rig = {
	.probe = i2c_probe,
	.remove = i2c_remove,
	.driver = { .name = "rig-i2c" },
};

int rig_i2c_start(void)
{
	int error = platform_driver_register(&i2c_driver_of_rig);

	if (error)
		return error;
	device = platform_device_register_simple("rig-i2c", PLATFORM_DEVID_NONE, NULL, 0);
	if (IS_ERR(device)) {
		platform_driver_unregister(&i2c_driver_of_rig);
		return PTR_ERR(device);
	}
	return 0;
}

void rig_i2c_end(void)
{
	platform_device_unregister(device);
	platform_driver_unregister(&i2c_driver_of_rig);
}
