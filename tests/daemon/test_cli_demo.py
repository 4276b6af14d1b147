"""The demo's loop against a daemon that refuses some of its frames.

Owns: which refusals end it.
"""

from __future__ import annotations

from collections.abc import Callable

import pytest

from etd.cli import main
from etd.cli.demo import Demo
from etd.cli.options import FakeBoard, any_board_faked
from etd.client import Display
from etd.protocol.errors import ErrorCode, Refused
from etd.protocol.link import Answer, Command, NewFrame
from gateway_rig import ServedRig
from scripted_engine import full_answer

SECONDS = 0.3


def refusing(code: ErrorCode, *seqs: int) -> Callable[[Command | NewFrame], Answer]:
    """An engine that refuses these frames."""

    def answer(message: Command | NewFrame) -> Answer:
        if isinstance(message, NewFrame) and message.frame.seq in seqs:
            return Answer(ref=message.ref, error=code, reason="as told")
        return full_answer(message)

    return answer


def display_of(rig: ServedRig) -> Display:
    return Display(address=rig.address, client="demo", max_current_ua=2000, width_us=100)


def test_frames_that_come_too_late_are_counted_and_do_not_end_it() -> None:
    with ServedRig() as rig:
        rig.engine.answer = refusing("expired", 1, 3)
        with display_of(rig) as display:
            running = Demo(display, has_calibration=False)
            running.run(SECONDS)
            told = running.summary()
        sent = len(rig.engine.frames)
    assert sent > 3
    assert told.startswith(f"{sent} frames (2 too late to be shown) and")


def test_any_other_refusal_ends_it() -> None:
    with ServedRig() as rig:
        rig.engine.answer = refusing("halted", 2)
        with display_of(rig) as display, pytest.raises(Refused, match="halted"):
            Demo(display, has_calibration=False).run(SECONDS)
        assert [message.frame.seq for message in rig.engine.frames] == [1, 2]


@pytest.mark.parametrize(
    ("text", "board"),
    [("fake", None), ("fake:feetthrough-relay", "feetthrough-relay"), ("pad", "pad")],
)
def test_its_board_is_named_as_in_run_and_play_or_alone(text: str, board: str | None) -> None:
    assert any_board_faked(text) == FakeBoard(board)


def test_a_board_that_is_not_shipped_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["demo", "--board", "fake:no-such", "--seconds", "1"]) == 1
    assert "no 'no-such' among the shipped boards" in capsys.readouterr().err
