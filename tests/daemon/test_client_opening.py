"""`arm(open_to=...)`, as an application calls it: what it shows, and what it does not open to."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Iterator
from typing import Any

import pytest
from msgspec.structs import replace

from etd import AsyncDisplay, Display, Refused
from etd.protocol.link import Answer, Command, NewFrame
from etd.protocol.opening import LeaseCalibration
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


def with_unfelt(*unfelt: int) -> Callable[[Command | NewFrame], Answer]:
    told = LeaseCalibration(name="P01", polarity="anodic", digest="0" * 64, unfelt=unfelt)

    def answer(message: Command | NewFrame) -> Answer:
        found = full_answer(message)
        return found if isinstance(message, NewFrame) else replace(found, calibrations=(told,))

    return answer


def levels_by(rig: ServedRig) -> list[Any]:
    return [sent.frame.level for sent in rig.engine.frames if not sent.frame.preview]


def test_one_level_opens_the_electrodes_that_are_felt_and_says_which_are_left_out(
    rig: ServedRig,
) -> None:
    rig.engine.answer = with_unfelt(1, 3)
    with display(rig) as d, pytest.warns(UserWarning, match=r"not felt .* left out: 1, 3"):
        (taken,) = d.arm(open_to=0.5)
    assert taken.unfelt == (1, 3)
    assert levels_by(rig) == [(0.5, 0.0, 0.5, 0.0), (0.0,) * 4]


def test_awaited_it_is_the_same(rig: ServedRig) -> None:
    async def script() -> None:
        async with AsyncDisplay(
            address=rig.address, max_current_ua=3000, width_us=100, client="me"
        ) as d:
            await d.arm(open_to=0.5)

    rig.engine.answer = with_unfelt(0)
    with pytest.warns(UserWarning, match="left out: 0"):
        asyncio.run(script())
    assert levels_by(rig)[0] == (0.0, 0.5, 0.5, 0.5)


@pytest.mark.parametrize("named", [{1: 0.5}, [0.0, 0.5, 0.0, 0.0]])
def test_an_electrode_that_is_named_is_not_left_out(rig: ServedRig, named: Any) -> None:
    """The daemon refuses it, with the reason."""
    rig.engine.answer = with_unfelt(1)
    with display(rig) as d:
        d.arm(open_to=named)
    assert levels_by(rig)[0] == (0.0, 0.5, 0.0, 0.0)


def test_where_none_is_felt_the_daemon_is_asked_for_all_and_says_so(rig: ServedRig) -> None:
    rig.engine.answer = with_unfelt(0, 1, 2, 3)
    with display(rig) as d:
        d.arm(open_to=0.5)
    assert levels_by(rig)[0] == (0.5,) * 4


def test_a_current_for_all_is_one_for_those_that_are_not_felt_as_well(rig: ServedRig) -> None:
    rig.engine.answer = with_unfelt(1)
    with display(rig) as d:
        d.arm(open_to_ua=900)
    assert shown_by(rig)[0] == (900,) * 4
