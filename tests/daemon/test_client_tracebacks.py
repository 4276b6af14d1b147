"""What a script prints that does not catch a refusal: where it asked, and in one line why."""

from __future__ import annotations

import asyncio
import traceback
from collections.abc import Callable, Iterator

import pytest

from etd import AsyncDisplay, Display, EtdError, Pattern, PatternFrame, Refused
from etd.protocol.link import Answer, AskAccount, Command, NewFrame
from gateway_rig import ServedRig
from scripted_engine import full_answer

pytestmark = pytest.mark.slow

FIRST = [1_000, 0, 0, 0]
FELT = Pattern(electrodes=4, frames=(PatternFrame(duration_ms=50, level=(1.0, 0.0, 0.0, 0.0)),))
#: Of the script, of the display's method and of its exchange, two lines each and their marks.
MOST_LINES = 16


@pytest.fixture
def rig() -> Iterator[ServedRig]:
    with ServedRig() as rig:
        yield rig


def halting(message: Command | NewFrame) -> Answer:
    if isinstance(message, NewFrame) and not message.frame.preview and message.frame.seq > 1:
        return Answer(ref=message.ref, error="halted", reason="the wearer\nstopped it")
    return full_answer(message)


def forgetting(message: Command | NewFrame) -> Answer:
    if isinstance(message, AskAccount):
        return Answer(ref=message.ref, error="not_found", reason="there is no account")
    return full_answer(message)


def unarmed(message: Command | NewFrame) -> Answer:
    if isinstance(message, NewFrame):
        return Answer(ref=message.ref, error="not_armed", reason="arm first")
    return full_answer(message)


Script = Callable[[Display], object]
SCRIPTS: list[tuple[Callable[[Command | NewFrame], Answer], Script, str]] = [
    (unarmed, lambda d: d.show_current(FIRST), "arm first (not_armed)"),
    (unarmed, lambda d: d.present_current(FIRST, 0.1), "arm first (not_armed)"),
    (unarmed, lambda d: d.hold_current(FIRST, 0.1), "arm first (not_armed)"),
    (unarmed, lambda d: d.arm(open_to_ua=500), "arm first (not_armed)"),
    (
        unarmed,
        lambda d: d.play(FELT, current_ua=1_000, width_us=100),
        "frame 0: arm first (not_armed)",
    ),
    (
        halting,
        lambda d: d.present_current(FIRST, 0.5, ttl_ms=100),
        r"the wearer\nstopped it; it was cut short after 6 pulses (see its .presented) (halted)",
    ),
    (forgetting, lambda d: d.present_current(FIRST, 0.1), "some milliseconds (expired)"),
    (full_answer, lambda d: d.play("/no/file.json"), "name one that exists"),
    (full_answer, lambda d: d.start_record("p 01"), "hyphens or underscores (bad_message)"),
]


def printed(error: BaseException) -> list[str]:
    return "".join(traceback.format_exception(error)).splitlines()


def check(error: BaseException, last: str) -> None:
    lines = printed(error)
    assert lines[-1].endswith(last)
    assert sum(line.startswith("Traceback") for line in lines) == 1, "nothing is chained"


@pytest.mark.parametrize(("answer", "script", "last"), SCRIPTS)
def test_it_is_short_and_ends_with_one_line(
    rig: ServedRig, answer: Callable[[Command | NewFrame], Answer], script: Script, last: str
) -> None:
    with Display(address=rig.address, max_current_ua=3000, width_us=100) as d:
        d.arm()
        rig.engine.answer = answer
        with pytest.raises(EtdError) as caught:
            script(d)
        rig.engine.answer = full_answer
    check(caught.value, last)
    if isinstance(caught.value, Refused):
        assert len(printed(caught.value)) <= MOST_LINES


def test_so_it_is_where_it_is_awaited(rig: ServedRig) -> None:
    async def script() -> None:
        async with AsyncDisplay(address=rig.address, max_current_ua=3000, width_us=100) as d:
            await d.arm()
            rig.engine.answer = halting
            try:
                await d.present_current(FIRST, 0.5, ttl_ms=100)
            finally:
                rig.engine.answer = full_answer

    with pytest.raises(Refused) as caught:
        asyncio.run(script())
    check(caught.value, "(see its .presented) (halted)")


def test_what_the_program_handles_itself_is_still_told(rig: ServedRig) -> None:
    def handling(d: Display) -> None:
        try:
            raise ValueError("of the program")
        except ValueError:
            d.show_current(FIRST)

    with Display(address=rig.address, max_current_ua=3000, width_us=100) as d:
        rig.engine.answer = unarmed
        with pytest.raises(Refused) as caught:
            handling(d)
        rig.engine.answer = full_answer
    assert any("of the program" in line for line in printed(caught.value))
