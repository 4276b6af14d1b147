// SPDX-License-Identifier: Apache-2.0 OR GPL-2.0-only
/*
 * The SPI controller: bus 0 with two chip selects, as /dev/spidev0.0 and /dev/spidev0.1.
 *
 * A message is handed to the answerer whole, before its first bit, and all that will be read is
 * taken then. After that it is played: the kernel's SPI core makes the order of transfers, the
 * delays and the chip select, and calls transfer_one() for the bits, which take the time that they
 * would take on a Pi. So the answerer's time lies before the pulse and not in it. It is still a
 * part of the call that sends the message, except where computing takes no time.
 *
 * What is asked is: u32 chip select, u32 mode, u32 number of transfers; then for each transfer
 * u32 length, u32 speed_hz, u16 delay_us, u8 cs_change, u8 0, and its bytes.
 */
#include <linux/delay.h>
#include <linux/module.h>
#include <linux/platform_device.h>
#include <linux/slab.h>
#include <linux/spi/spi.h>

#include "rig.h"

/* spidev takes no message of more than 4096 bytes; and a note of the door's is below 64 kB. */
#define MOST_BYTES 4096
#define MOST_ASKED 60000
/* The Pi's controller idles for one clock period after each byte. */
#define CLOCKS_PER_BYTE 9

static bool realtime = true;
module_param(realtime, bool, 0644);
MODULE_PARM_DESC(realtime, "bytes take the time of their bits (default: yes)");

/* Faults, each for one message: it clears itself. -1 is none. */
static int spi_fail_at = -1;
module_param(spi_fail_at, int, 0644);
MODULE_PARM_DESC(spi_fail_at, "the next message fails at this transfer with data, with EIO");
static int spi_stall_at = -1;
module_param(spi_stall_at, int, 0644);
MODULE_PARM_DESC(spi_stall_at, "the next message stands still before this transfer with data");
static uint spi_stall_ms = 100;
module_param(spi_stall_ms, uint, 0644);
MODULE_PARM_DESC(spi_stall_ms, "for so long");

struct question {
	u32 chip_select;
	u32 mode;
	u32 transfers;
} __packed;

struct one_transfer {
	u32 length;
	u32 speed_hz;
	u16 delay_us;
	u8 cs_change;
	u8 zero;
} __packed;

static struct platform_device *device;
/* Of the message that is being played: the core plays one at a time. */
static u8 answers[MOST_BYTES];
static size_t answers_at;
static int transfers_played;

static size_t lay_out(struct spi_message *message, u8 *asked, size_t *data_bytes)
{
	struct question *question = (struct question *)asked;
	struct spi_transfer *transfer;
	size_t length = sizeof(*question);

	*question = (struct question){
		.chip_select = spi_get_chipselect(message->spi, 0),
		.mode = message->spi->mode & (SPI_CPHA | SPI_CPOL),
	};
	*data_bytes = 0;
	list_for_each_entry(transfer, &message->transfers, transfer_list) {
		struct one_transfer one = {
			.length = transfer->len,
			.speed_hz = transfer->speed_hz,
			.delay_us = transfer->delay.value,
			.cs_change = transfer->cs_change,
		};

		if (length + sizeof(one) + transfer->len > MOST_ASKED ||
		    *data_bytes + transfer->len > MOST_BYTES)
			return 0;
		memcpy(asked + length, &one, sizeof(one));
		length += sizeof(one);
		if (transfer->tx_buf)
			memcpy(asked + length, transfer->tx_buf, transfer->len);
		else
			memset(asked + length, 0, transfer->len);
		length += transfer->len;
		*data_bytes += transfer->len;
		question->transfers++;
	}
	return length;
}

/* The core calls this once for each message, before chip select falls. */
static int prepare_message(struct spi_controller *controller, struct spi_message *message)
{
	size_t length, data_bytes;
	u8 *asked = kmalloc(MOST_ASKED, GFP_KERNEL);
	int error = -EMSGSIZE;

	if (!asked)
		return -ENOMEM;
	length = lay_out(message, asked, &data_bytes);
	if (length)
		error = rig_ask(RIG_SPI_MESSAGE, asked, length, answers, data_bytes);
	kfree(asked);
	answers_at = 0;
	transfers_played = 0;
	return error;
}

static bool is_due(int *fault_at)
{
	if (*fault_at != transfers_played)
		return false;
	*fault_at = -1;
	return true;
}

/* The core calls this for each transfer that has data; 0 means that it is over. */
static int transfer_one(struct spi_controller *controller, struct spi_device *spi,
			struct spi_transfer *transfer)
{
	u64 lasts_ns = (u64)transfer->len * CLOCKS_PER_BYTE * NSEC_PER_SEC;

	if (is_due(&spi_stall_at))
		msleep(spi_stall_ms);
	if (is_due(&spi_fail_at))
		return -EIO;
	if (realtime) {
		do_div(lasts_ns, transfer->speed_hz);
		/* ndelay() for what is short: it takes no more than some ms. */
		if (lasts_ns < NSEC_PER_MSEC)
			ndelay((unsigned long)lasts_ns);
		else
			usleep_range(lasts_ns / 1000, lasts_ns / 1000 + 100);
	}
	if (transfer->rx_buf)
		memcpy(transfer->rx_buf, answers + answers_at, transfer->len);
	answers_at += transfer->len;
	transfers_played++;
	return 0;
}

/* Nothing hangs on it; but the core traces chip select only where there is one. */
static void set_cs(struct spi_device *spi, bool is_high)
{
}

static int spi_probe(struct platform_device *found)
{
	/* A name that spidev takes: it does not take every device. */
	struct spi_board_info info = { .modalias = "dh2228fv", .max_speed_hz = 125000000 };
	struct spi_controller *controller;
	int error;

	controller = devm_spi_alloc_host(&found->dev, 0);
	if (!controller)
		return -ENOMEM;
	controller->bus_num = 0;
	controller->num_chipselect = 2;
	controller->mode_bits = SPI_CPOL | SPI_CPHA | SPI_CS_HIGH | SPI_NO_CS;
	/* As on the Pi: 8-bit words, and no others. */
	controller->bits_per_word_mask = SPI_BPW_MASK(8);
	controller->prepare_message = prepare_message;
	controller->transfer_one = transfer_one;
	controller->set_cs = set_cs;
	error = devm_spi_register_controller(&found->dev, controller);
	if (error)
		return error;
	for (info.chip_select = 0; info.chip_select < 2; info.chip_select++)
		if (!spi_new_device(controller, &info))
			return -ENODEV;
	return 0;
}

static struct platform_driver spi_driver = {
	.probe = spi_probe,
	.driver = { .name = "rig-spi" },
};

int rig_spi_start(void)
{
	int error = platform_driver_register(&spi_driver);

	if (error)
		return error;
	device = platform_device_register_simple("rig-spi", PLATFORM_DEVID_NONE, NULL, 0);
	if (IS_ERR(device)) {
		platform_driver_unregister(&spi_driver);
		return PTR_ERR(device);
	}
	return 0;
}

void rig_spi_end(void)
{
	platform_device_unregister(device);
	platform_driver_unregister(&spi_driver);
}
