"""A pulse, as the kernel's SPI core made it: read from trace events, without our encoder."""

from __future__ import annotations

import pytest

import kernel_trace
from etd_hal.backend import Backend
from etd_hal.timing import Shape, pulse_message
from kernel_trace import Event

#: 1365/4095 of 10 mA; a word is two zero bits, twelve of the code, two that do not count.
CODE = 1_365
WORD = bytes((1_365 >> 6, (1_365 & 0x3F) << 2))
ZERO = bytes(2)


def only_message() -> list[Event]:
    (message,) = kernel_trace.messages(kernel_trace.events())
    return message


def chip_select(message: list[Event]) -> list[bool]:
    return [event.is_active for event in message if event.name == "spi_set_cs"]


def starts(message: list[Event]) -> list[Event]:
    return [event for event in message if event.name == "spi_transfer_start"]


def rises_us(message: list[Event]) -> list[int]:
    """When chip select rose: the DAC then takes its word."""
    return [event.t_us for event in message if event.name == "spi_set_cs" and not event.is_active]


def test_a_trace_that_lost_events_is_not_read(ports: Backend) -> None:
    kernel_trace.begin(buffer_kb=8)
    for _ in range(200):
        ports.spi.transfer(pulse_message(ports.codec, 0, Shape((10,), True, 0.0, 0.0)))
    with pytest.raises(AssertionError, match="the trace has holes"):
        kernel_trace.events()


def test_the_bus_is_set_to_the_boards_mode_and_to_words_of_8_bits(ports: Backend) -> None:
    setups = [event.rest for event in kernel_trace.events() if event.name == "spi_setup"]
    assert "setup mode 1," in setups[-1]
    assert "8 bits/w" in setups[-1]


def test_the_words_are_sent_in_order_each_in_its_own_chip_select(ports: Backend) -> None:
    ports.spi.transfer(pulse_message(ports.codec, CODE, Shape((10, 10, 10), False, 0.0, 0.0)))
    message = only_message()
    assert [event.tx for event in starts(message)] == [WORD, b"", b"", b"", ZERO]
    assert chip_select(message) == [True, False, True, False]
    names = [event.name for event in message if event.name != "spi_transfer_stop"]
    assert names[:5] == [
        *("spi_message_start", "spi_set_cs", "spi_transfer_start"),
        *("spi_set_cs", "spi_set_cs"),
    ]


def test_the_delays_lie_between_the_word_and_the_zero(ports: Backend) -> None:
    ports.spi.transfer(pulse_message(ports.codec, CODE, Shape((10, 10, 7), False, 0.0, 0.0)))
    message = only_message()
    stops = [event.t_us for event in message if event.name == "spi_transfer_stop"]
    begins = [event.t_us for event in starts(message)]
    held = [begin - stop for stop, begin in zip(stops, begins[1:], strict=False)]
    # The gap after the word is cs_change's 10 us; stamps are cut to whole microseconds.
    assert all(gap >= least - 1 for gap, least in zip(held, (10, 10, 10, 7), strict=True)), held


def test_with_an_end_sample_the_word_is_sent_twice(ports: Backend) -> None:
    ports.spi.transfer(pulse_message(ports.codec, CODE, Shape((10, 10), True, 0.0, 0.0)))
    message = only_message()
    assert [event.tx for event in starts(message)] == [WORD, b"", b"", WORD, ZERO]
    assert chip_select(message) == [True, False, True, False, True, False]


def test_the_pulse_lasts_from_the_first_rise_of_chip_select_to_the_last(ports: Backend) -> None:
    ports.spi.transfer(pulse_message(ports.codec, CODE, Shape((10,) * 9, False, 0.0, 0.0)))
    first, last = rises_us(only_message())
    assert last - first >= 9 * 10 + 10 - 1


def test_what_is_read_is_what_the_converter_sent(ports: Backend) -> None:
    reads = ports.spi.transfer(pulse_message(ports.codec, 0, Shape((10,), True, 0.0, 0.0)))
    stops = [event for event in only_message() if event.name == "spi_transfer_stop"]
    assert list(reads) == [event.rx for event in stops if event.tx]
