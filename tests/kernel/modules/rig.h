/* SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only */
/*
 * What the files of the module share: the door to the answerer, and one start and one end for
 * each bus.
 *
 * The module stands in for the hardware of a Raspberry Pi: GPIO lines, one SPI bus, one I2C bus.
 * Above it everything is the kernel's own: gpiolib, the SPI core, spidev, i2c-dev. Below it there
 * are no wires: what goes out is told to a program through /dev/rig, and what comes in is asked of
 * that program (tests/kernel/answerer.py), which plays the chips of the board.
 */
#ifndef RIG_H
#define RIG_H

#include <linux/types.h>

/* What goes through the door, as the kind of an event. */
enum rig_kind {
	RIG_LINE_DRIVEN = 1,	/* told: u32 line, u32 level. An output has a level now */
	RIG_LINE_READ = 2,	/* asked: u32 line. The answer is one byte, 0 or 1 */
	RIG_SPI_MESSAGE = 3,	/* asked: see spi.c. The answer is every byte that is read */
	RIG_I2C_TRANSFER = 4,	/* asked: see i2c.c. The answer is every byte that is read */
};

/*
 * Tell the answerer that something happened. Keeps the order of the calls. Sleeps while more is
 * waiting to be read than the answerer can have lost sight of. Nobody listening is no error.
 */
void rig_tell(enum rig_kind kind, const void *payload, size_t length);

/*
 * Ask the answerer, and sleep until it has answered. Fills `answer` with exactly `room` bytes.
 *
 * Returns 0, the answerer's own negative errno, -EIO when there is no answerer or it went away,
 * -ETIMEDOUT when it does not answer. With the module's parameter `alone` set and nobody there,
 * the answer is 0 and zeros.
 */
int rig_ask(enum rig_kind kind, const void *payload, size_t length, void *answer, size_t room);

/* The world moves an input: the level that is read, and the interrupt that an edge makes. */
void rig_gpio_move_input(unsigned int line, bool level);
/* A line whose level depends on what was clocked out: asked of the answerer at every read. */
void rig_gpio_ask_at_read(unsigned int line);

int rig_gpio_start(void);
void rig_gpio_end(void);
int rig_spi_start(void);
void rig_spi_end(void);
int rig_i2c_start(void);
void rig_i2c_end(void);
int rig_firmware_start(void);
void rig_firmware_end(void);

#endif
