"""`arm(open_to=...)`, as an application calls it: what it shows, and what it does not open to."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest

from etd import Display, Refused
from etd.protocol.link import Answer, Command, NewFrame
from etd.protocol.outcome import Clamp
from gateway_rig import ServedRig
from scripted_engine import full_answer

pytestmark = pytest.mark.slow


@pytest.fixture
def rig() -> Iterator[ServedRig]:
    with ServedRig() as rig:
        yield rig


def display(rig: ServedRig) -> Display:
    return Display(address=rig.address, max_current_ua=3000, width_us=100, client="me")


def shown_by(rig: ServedRig) -> list[Any]:
    return [sent.frame.current_ua for sent in rig.engine.frames if not sent.frame.preview]


def test_currents_can_be_opened_to_as_well(rig: ServedRig) -> None:
    with display(rig) as d:
        d.arm(open_to_ua=900)
        d.arm(open_to_ua={1: 500})
    assert shown_by(rig) == [(900,) * 4, (0,) * 4, (0, 500, 0, 0), (0,) * 4]


def test_what_is_above_a_cap_is_not_opened_to_and_ends_silent(rig: ServedRig) -> None:
    cap = Clamp(electrode=1, wanted_ua=900, allowed_ua=700, reason="cap", limited_by=1)

    def capped(message: Command | NewFrame) -> Answer:
        if isinstance(message, NewFrame) and any(message.frame.current_ua or ()):
            return Answer(ref=message.ref, rate_hz=60.0, clamped=(cap,))
        return full_answer(message)

    rig.engine.answer = capped
    with display(rig) as d:
        with pytest.raises(Refused, match="700 uA at most"):
            d.arm(open_to_ua=900)
        assert shown_by(rig)[-1] == (0,) * 4
