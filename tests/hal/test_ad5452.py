"""The DAC's word, against the datasheet: C1 C0, D11..D0, two bits that do not count."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd_hal.chips import ad5452


@pytest.mark.parametrize(
    ("code", "sent"),
    [(0, "0000"), (1, "0004"), (409, "0664"), (1228, "1330"), (2048, "2000"), (4095, "3ffc")],
)
def test_a_code_is_sent_most_significant_bit_first_above_two_unused_bits(
    code: int, sent: str
) -> None:
    assert ad5452.word(code).hex() == sent


@pytest.mark.parametrize("code", [-1, 4096, 0x3000, 0xFFFF])
def test_a_code_that_the_dac_has_not_is_refused_and_never_masked(code: int) -> None:
    with pytest.raises(ValueError, match=rf"DAC code {code} is outside 0\.\.4095"):
        ad5452.word(code)


@given(st.integers(0, 4095))
def test_no_word_touches_the_control_bits(code: int) -> None:
    sent = int.from_bytes(ad5452.word(code), "big")
    assert sent & 0xC003 == 0
    assert sent >> 2 == code
