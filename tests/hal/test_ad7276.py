"""The ADC's frame, against the datasheet: two leading zeros, twelve bits, two trailing zeros."""

from __future__ import annotations

import pytest

from etd_hal.chips import ad7276
from etd_hal.errors import BoardFault
from etd_hal.fake.ad7276 import Ad7276


@pytest.mark.parametrize(
    ("received", "code"), [("0000", 0), ("0004", 1), ("1330", 1228), ("3ffc", 4095)]
)
def test_a_frame_holds_its_code_between_zeros(received: str, code: int) -> None:
    assert ad7276.code_of(bytes.fromhex(received)) == code


@pytest.mark.parametrize("received", ["ffff", "8000", "4000", "0002", "0001", "7ff8", "3ffd"])
def test_a_word_with_a_bit_outside_the_code_is_no_sample(received: str) -> None:
    with pytest.raises(BoardFault, match="leading and two trailing zero bits") as caught:
        ad7276.code_of(bytes.fromhex(received))
    assert caught.value.measured == received


@pytest.mark.parametrize("received", [b"", b"\x00", b"\x00\x00\x00"])
def test_another_length_than_two_bytes_is_no_sample(received: bytes) -> None:
    with pytest.raises(BoardFault, match="AD7276 frame"):
        ad7276.code_of(received)


@pytest.mark.parametrize("mode", [0, 1, 2])
def test_the_modes_that_a_board_may_have_read_alike(mode: int) -> None:
    adc = Ad7276()
    adc.select(2_049)
    assert ad7276.code_of(adc.shift(2, mode)) == 2_049


def test_mode_three_moves_the_word_into_the_leading_bits() -> None:
    adc = Ad7276()
    adc.select(2_048)
    with pytest.raises(BoardFault):
        ad7276.code_of(adc.shift(2, 3))
