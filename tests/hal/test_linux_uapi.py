"""The kernel's structures, against bytes written down from its headers."""

from __future__ import annotations

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd_hal.linux import uapi


def test_a_transfer_is_laid_out_as_in_spidev_h() -> None:
    packed = uapi.spi_ioc_transfer(
        tx=0x1122334455667788,
        rx=0x99AABBCCDDEEFF00,
        length=2,
        speed_hz=10_400_000,
        delay_us=0x0A0B,
        cs_change=True,
    )
    assert packed == bytes.fromhex(
        "8877665544332211"  # tx_buf
        "00ffeeddccbbaa99"  # rx_buf
        "02000000"  # len
        "00b19e00"  # speed_hz
        "0b0a"  # delay_usecs
        "08"  # bits_per_word
        "01"  # cs_change
        "00000000"  # tx_nbits, rx_nbits, word_delay_usecs, pad
    )


@pytest.mark.parametrize(
    ("transfers", "number"),
    [(1, 0x40206B00), (2, 0x40406B00), (32, 0x44006B00), (511, 0x7FE06B00)],
)
def test_request_numbers_are_the_kernels(transfers: int, number: int) -> None:
    assert uapi.spi_ioc_message(transfers) == number


@pytest.mark.parametrize("transfers", [0, 512, 1024])
def test_a_number_that_would_mean_zero_bytes_is_never_made(transfers: int) -> None:
    with pytest.raises(ValueError, match="transfers"):
        uapi.spi_ioc_message(transfers)


def test_line_values_are_bits_then_mask() -> None:
    assert uapi.line_values([(0, 1), (3, 0), (63, 1)]) == struct.pack(
        "<QQ", 1 << 63 | 1, 1 << 63 | 1 << 3 | 1
    )


@given(st.dictionaries(st.integers(0, 63), st.integers(0, 1)))
def test_every_level_is_found_at_its_bit(levels: dict[int, int]) -> None:
    values = uapi.line_values(levels.items())
    assert {bit: uapi.level_of(values, bit) for bit in levels} == levels


def test_each_transfer_takes_a_whole_128_bytes_of_the_kernels_buffer() -> None:
    assert uapi.bounce_bytes([0, 1, 2, 128, 129]) == 0 + 128 + 128 + 128 + 256
