"""The player against a real gateway: what ends a pattern is told by its cause."""

from __future__ import annotations

import pytest

from etd import Display, Refused
from etd.apps.player import Player
from etd.apps.steps import Step
from etd.protocol.link import Answer, Command, NewFrame, Report
from etd.protocol.messages import Halt, StateReport
from gateway_rig import ServedRig
from scripted_engine import full_answer

STEP = Step(
    kind="level",
    numbers=(0.0, 1.0, 0.0, 0.0),
    options={"tag": 0},
    duration_ms=100,
    largest_ua=1_000,
)


def refused_after_the_first(rig: ServedRig, halt: Halt | None) -> str:
    """What the player says, where a frame is refused before any halt is reported."""
    state: StateReport = StateReport(
        state="HALTED" if halt else "SAFE", now_ns=1, engine="there", halt=halt
    )

    def answer(message: Command | NewFrame) -> Answer | None:
        if not isinstance(message, NewFrame):
            return full_answer(message)
        rig.engine.say(Report(state=state))
        return Answer(ref=message.ref, error="no_lease", reason="no lease stands")

    rig.engine.answer = answer
    display = Display(address=rig.address, max_current_ua=3_000, width_us=100)
    with display, pytest.raises(Refused) as caught:
        Player(display, (STEP,), lambda _: None).play()
    return str(caught.value)


def test_a_frame_that_is_refused_after_a_halt_is_told_as_the_halt() -> None:
    halt = Halt(cause="stop", source="etd stop", detail="asked to stop", t_ns=1)
    with ServedRig() as rig:
        assert "halted by stop (etd stop: asked to stop)" in refused_after_the_first(rig, halt)


def test_a_frame_that_is_refused_without_a_halt_is_told_as_refused() -> None:
    with ServedRig() as rig:
        assert "frame 0: no lease stands" in refused_after_the_first(rig, None)
