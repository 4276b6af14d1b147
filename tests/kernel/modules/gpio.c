// SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
/*
 * The GPIO lines: a chip of 54 lines with the label of a Raspberry Pi 4's.
 *
 * As the Pi's driver it has no set_multiple: gpiolib then sets several lines one after another,
 * by a call of set() each, and these calls, in their order, are what this file is for. As with
 * the kernels of Raspberry Pi OS, an output that is let go of stays an output and keeps its level,
 * unless `strict_gpiod` is set, as there: then it becomes an input.
 *
 * Interrupts: an input that the answerer moves raises one, and gpiolib makes an edge event of it.
 */
#include <linux/bitops.h>
#include <linux/gpio/driver.h>
#include <linux/irq.h>
#include <linux/irqdomain.h>
#include <linux/module.h>
#include <linux/platform_device.h>
#include <linux/string.h>

#include "rig.h"

#define CREATE_TRACE_POINTS
#include "rig_trace.h"

#define LINES 54
#define LABEL "pinctrl-bcm2711"

static bool strict_gpiod;
module_param(strict_gpiod, bool, 0644);
MODULE_PARM_DESC(strict_gpiod, "outputs that are let go of become inputs (default: they stay)");

static unsigned long pulled_up = BIT(4);
module_param(pulled_up, ulong, 0644);
MODULE_PARM_DESC(pulled_up, "a bit for each line with a pull-up, the others have pull-downs (POL)");

/* One bit a line. An input reads `levels`, too, unless it is in `ask_at_read`. */
static DECLARE_BITMAP(levels, LINES);
static DECLARE_BITMAP(outputs, LINES);
static DECLARE_BITMAP(ask_at_read, LINES);
static DECLARE_BITMAP(rising, LINES);
static DECLARE_BITMAP(falling, LINES);

static struct gpio_chip chip;
static struct platform_device *device;
/* Held while inputs are moved, so that the chip cannot go away meanwhile. */
static DEFINE_MUTEX(chip_lock);
static bool chip_is_there;

static void drive(unsigned int line, bool level)
{
	u32 told[2] = { line, level };

	assign_bit(line, levels, level);
	trace_rig_line(line, level);
	rig_tell(RIG_LINE_DRIVEN, told, sizeof(told));
}

static void chip_set(struct gpio_chip *gc, unsigned int line, int level)
{
	drive(line, level);
}

static int chip_get(struct gpio_chip *gc, unsigned int line)
{
	u32 asked = line;
	u8 level;
	int error;

	if (test_bit(line, outputs) || !test_bit(line, ask_at_read))
		return test_bit(line, levels);
	error = rig_ask(RIG_LINE_READ, &asked, sizeof(asked), &level, sizeof(level));
	return error ? error : level;
}

static int chip_get_direction(struct gpio_chip *gc, unsigned int line)
{
	return test_bit(line, outputs) ? GPIO_LINE_DIRECTION_OUT : GPIO_LINE_DIRECTION_IN;
}

static int chip_direction_input(struct gpio_chip *gc, unsigned int line)
{
	clear_bit(line, outputs);
	return 0;
}

/* The level comes first, and then the direction: no glitch. */
static int chip_direction_output(struct gpio_chip *gc, unsigned int line, int level)
{
	drive(line, level);
	set_bit(line, outputs);
	return 0;
}

/* With nobody driving it, the board sees what the line's pull makes of it. */
static void chip_free(struct gpio_chip *gc, unsigned int line)
{
	if (!strict_gpiod || !test_bit(line, outputs))
		return;
	clear_bit(line, outputs);
	drive(line, (pulled_up >> line) & 1);
}

/* Pulls: the levels of inputs come from the answerer anyway. */
static int chip_set_config(struct gpio_chip *gc, unsigned int line, unsigned long config)
{
	switch (pinconf_to_config_param(config)) {
	case PIN_CONFIG_BIAS_DISABLE:
	case PIN_CONFIG_BIAS_PULL_UP:
	case PIN_CONFIG_BIAS_PULL_DOWN:
		return 0;
	default:
		return -ENOTSUPP;
	}
}

static void irq_mask(struct irq_data *data)
{
	gpiochip_disable_irq(&chip, irqd_to_hwirq(data));
}

static void irq_unmask(struct irq_data *data)
{
	gpiochip_enable_irq(&chip, irqd_to_hwirq(data));
}

static int irq_set_type(struct irq_data *data, unsigned int type)
{
	irq_hw_number_t line = irqd_to_hwirq(data);

	assign_bit(line, rising, type & IRQ_TYPE_EDGE_RISING);
	assign_bit(line, falling, type & IRQ_TYPE_EDGE_FALLING);
	return 0;
}

static const struct irq_chip line_irqs = {
	.name = "rig-gpio",
	.irq_mask = irq_mask,
	.irq_unmask = irq_unmask,
	.irq_set_type = irq_set_type,
	.flags = IRQCHIP_IMMUTABLE,
	GPIOCHIP_IRQ_RESOURCE_HELPERS,
};

void rig_gpio_move_input(unsigned int line, bool level)
{
	if (line >= LINES)
		return;
	mutex_lock(&chip_lock);
	if (chip_is_there && !test_bit(line, outputs) && test_bit(line, levels) != level) {
		assign_bit(line, levels, level);
		/* A line that nobody watches has no handler: the kernel ignores it. */
		if (test_bit(line, level ? rising : falling))
			generic_handle_domain_irq_safe(chip.irq.domain, line);
	}
	mutex_unlock(&chip_lock);
}

void rig_gpio_ask_at_read(unsigned int line)
{
	if (line < LINES)
		set_bit(line, ask_at_read);
}

static int gpio_probe(struct platform_device *found)
{
	int error;

	memset(&chip, 0, sizeof(chip));
	chip.label = LABEL;
	chip.parent = &found->dev;
	chip.owner = THIS_MODULE;
	chip.base = -1;
	chip.ngpio = LINES;
	/* To ask the answerer is to sleep; gpiolib then keeps these calls out of interrupts. */
	chip.can_sleep = true;
	chip.free = chip_free;
	chip.get = chip_get;
	chip.set = chip_set;
	chip.get_direction = chip_get_direction;
	chip.direction_input = chip_direction_input;
	chip.direction_output = chip_direction_output;
	chip.set_config = chip_set_config;
	gpio_irq_chip_set_chip(&chip.irq, &line_irqs);
	chip.irq.handler = handle_simple_irq;
	chip.irq.default_type = IRQ_TYPE_NONE;

	error = gpiochip_add_data(&chip, NULL);
	if (error)
		return error;
	mutex_lock(&chip_lock);
	chip_is_there = true;
	mutex_unlock(&chip_lock);
	return 0;
}

/* Also what happens when the device is unbound from its driver: the lines are unplugged. */
static void gpio_remove(struct platform_device *found)
{
	mutex_lock(&chip_lock);
	chip_is_there = false;
	mutex_unlock(&chip_lock);
	gpiochip_remove(&chip);
}

static struct platform_driver gpio_driver = {
	.probe = gpio_probe,
	.remove = gpio_remove,
	.driver = { .name = "rig-gpio" },
};

int rig_gpio_start(void)
{
	int error = platform_driver_register(&gpio_driver);

	if (error)
		return error;
	device = platform_device_register_simple("rig-gpio", PLATFORM_DEVID_NONE, NULL, 0);
	if (IS_ERR(device)) {
		platform_driver_unregister(&gpio_driver);
		return PTR_ERR(device);
	}
	return 0;
}

void rig_gpio_end(void)
{
	platform_device_unregister(device);
	platform_driver_unregister(&gpio_driver);
}
