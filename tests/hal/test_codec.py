"""The codec of a board file's DAC and ADC, handed to a board; and the codes of a current."""

from __future__ import annotations

import dataclasses
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from board_rig import board_rig, changed, fire_phase, machine_file
from etd_hal.board import Board
from etd_hal.boardfile import Source
from etd_hal.compose import codec_of
from etd_hal.errors import GuardRefusal
from stepped_board import shipped_board

KIT = shipped_board("kajimoto-hv507")


def source(full_scale_ua: int) -> Source:
    return changed(KIT, "source", full_scale_ua=full_scale_ua).source


@pytest.mark.parametrize(
    ("current_ua", "full_scale_ua", "code"),
    [
        (0, 10_000, 0),
        (2, 10_000, 0),
        (3, 10_000, 1),
        (3_000, 10_000, 1228),
        (10_000, 10_000, 4095),
        (10_000, 41_000, 998),
        (41_000, 41_000, 4095),
    ],
)
def test_a_current_becomes_the_code_below_it(
    current_ua: int, full_scale_ua: int, code: int
) -> None:
    assert source(full_scale_ua).code_for(current_ua) == code


@given(st.integers(0, 50_000), st.integers(1_000, 50_000))
def test_a_code_makes_no_more_than_asked_and_less_than_one_code_below_it(
    current_ua: int, full_scale_ua: int
) -> None:
    path = source(full_scale_ua)
    code = path.code_for(current_ua)
    assert path.current_of(code) <= current_ua + 1e-6
    assert path.current_of(code + 1) > current_ua - 1e-6


@pytest.mark.parametrize("current_ua", [-1, 10_003])
def test_a_current_outside_the_scale_ends_as_a_refused_word(current_ua: int) -> None:
    with pytest.raises(ValueError, match="DAC code"):
        codec_of(KIT.source).word(KIT.source.code_for(current_ua))


@pytest.mark.parametrize("code", [1, 1_228, 4_095])
def test_what_the_codec_of_a_board_sends_is_what_its_fake_plays(code: int) -> None:
    rig = board_rig()
    rig.begin()
    rig.visit(5, current_ua=math.ceil(KIT.source.current_of(code)))
    assert f"dac={codec_of(KIT.source).word(code).hex()}" in rig.story()
    assert rig.body()[-1]["asked_ua"] == round(KIT.source.current_of(code))


def test_a_board_sends_the_words_of_its_codec_and_the_guard_reads_them_by_itself() -> None:
    rig = board_rig()
    backend = rig.stepped.backend
    twice = dataclasses.replace(
        backend.codec, word=lambda code: backend.codec.word(min(2 * code, 4_095))
    )
    board = Board(KIT, machine_file(), twice, backend.spi, backend.gpio, backend.clock)
    assert board.safe_off() == ()
    board.calibrate()
    board.guard.permit(KIT.maxima.current_ua)
    selection = board.selection(5, None)
    board.prepare(selection)
    board.connect(selection, True)
    with pytest.raises(GuardRefusal, match=r"approval.*1998 uA"):
        fire_phase(board, board.pulse(1_000, 100), selection, True, 1_000, 100)
    assert rig.body() == []
