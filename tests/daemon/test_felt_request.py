"""The request `felt`, from a program through the gateway to the engine and into a record."""

from __future__ import annotations

import asyncio
import io
from typing import Any

import numpy as np
import pytest

from etd import AsyncDisplay, Display, Refused
from etd.apps.monitor import Monitor
from etd.cli.keys import keys_of
from etd.cli.monitor import draw
from etd.client.telemetry import Item
from etd.gateway.journal import Journal
from etd.gateway.replies import hello
from etd.protocol.carried import CarriedOver
from etd.protocol.facts import Endpoints
from etd.protocol.felt import FeltFacts
from etd.protocol.link import SayFelt
from etd.protocol.messages import Limits, StateReport
from etd.record.lines import Carried, Engine, LeaseBegun, Line, State
from etd.replay.timeline import Timeline
from gateway_rig import GatewayRig, ServedRig
from scripted_engine import NOT_RAISED, engine_hello


def said(rig: Any) -> list[SayFelt]:
    return [command for command in rig.engine.heard if isinstance(command, SayFelt)]


def test_a_program_with_the_lease_says_it_with_the_lease() -> None:
    with (
        ServedRig() as rig,
        Display(address=rig.address, max_current_ua=3_000, width_us=100, client="me") as display,
    ):
        lowered = display.felt("too_strong")
        display.arm()
        asked = display.felt("too_weak", electrodes=(0, 2))
        first, second = said(rig)
    assert (lowered.did, lowered.reason) == ("lowered", "")
    assert (asked.did, asked.reason) == ("nothing", NOT_RAISED.reason)
    assert (first.lease, first.answer, first.electrodes) == (None, "too_strong", None)
    assert second.lease is not None
    assert (second.answer, second.electrodes) == ("too_weak", (0, 2))


def test_too_strong_is_heard_of_a_lease_that_has_ended_and_nothing_else_is() -> None:
    with GatewayRig() as rig:
        mine = rig.open()
        for lease in ("unknown", mine + "x"):
            assert rig.call(op="felt", answer="too_strong", lease=lease)["ok"]
            assert rig.call(op="felt", answer="good", lease=lease)["error"] == "other_lease"
        assert rig.call(op="felt", answer="too_strong", lease=mine)["ok"]
        heard = [(each.answer, each.lease) for each in said(rig)]
    assert heard == [("too_strong", None), ("too_strong", None), ("too_strong", mine)]


def test_awaited_it_is_the_same() -> None:
    async def script(address: str) -> None:
        async with AsyncDisplay(
            address=address, max_current_ua=3_000, width_us=100, client="me"
        ) as display:
            assert (await display.felt("good", electrodes=[1])).did == "nothing"

    with ServedRig() as rig:
        asyncio.run(script(rig.address))
        (only,) = said(rig)
    assert (only.answer, only.electrodes) == ("good", (1,))


@pytest.mark.parametrize(
    ("answer", "electrodes", "reason"),
    [
        ("weak", None, "it can be too_weak, good, too_strong"),
        ("good", (), "electrodes is empty"),
        ("too_strong", [27.5], r"27\.5 is no electrode: give whole numbers"),
        ("too_strong", [True], "True is no electrode"),
        ("too_strong", [-1], "-1 is no electrode"),
        ("too_strong", [256], "there is no electrode 256: an array has 256 at most, from 0 on"),
        ("too_strong", [float("nan")], "nan is no electrode"),
        ("too_strong", [None], "None is no electrode"),
        ("too_strong", 27, r"electrodes=27: give a list of their numbers, as \[27\]"),
        ("too_strong", "27", "give a list of their numbers"),
        ("too_strong", {27: 0.5}, "give a list of their numbers"),
    ],
)
def test_what_cannot_be_said_is_refused_in_the_program(
    answer: Any, electrodes: Any, reason: str
) -> None:
    with ServedRig() as rig, Display(address=rig.address, client="me") as display:
        with pytest.raises(Refused, match=reason):
            display.felt(answer, electrodes)
        assert said(rig) == []


def test_numbers_of_an_array_name_electrodes() -> None:
    with ServedRig() as rig, Display(address=rig.address, client="me") as display:
        display.felt("too_strong", np.array([2, 0]))
        assert said(rig)[0].electrodes == (2, 0)


def test_a_token_that_holds_nothing_is_refused_and_none_may_lower() -> None:
    with GatewayRig() as rig:
        assert rig.call(op="felt", answer="too_weak", lease="no")["error"] == "no_lease"
        assert rig.call(op="felt", answer="too_strong")["did"] == "lowered"
        assert rig.call(op="felt", answer="too_strong", electrodes=[])["error"] == "bad_message"
        assert rig.call(op="felt", answer="stronger")["error"] == "bad_message"


# --- what is told --------------------------------------------------------------------------------


def facts(answers: int = 1, said_ns: int = 0, **changes: Any) -> FeltFacts:
    fields: dict[str, Any] = {
        "answer": "too_strong",
        "electrodes": None,
        "lowers_only": True,
        "factors": (0.95, 1.0, 1.0, 1.1),
    }
    return FeltFacts(answers=answers, said_ns=said_ns, **(fields | changes))


def report(felt: FeltFacts | None, now_ns: int = 0, state: Any = "ARMED") -> StateReport:
    return StateReport(state=state, now_ns=now_ns, engine="there", felt=felt)


def watching(key: str = "") -> Monitor:
    said_hello = hello(
        engine_hello(),
        name="main",
        endpoints=Endpoints(frames="", telemetry=""),
        calibrations=(),
        calibrations_folder="",
        default_calibration=None,
    )
    return Monitor(said_hello, key=key)


def test_the_monitor_tells_what_was_taken_and_given() -> None:
    monitor = watching()
    monitor.hear(report(facts()))
    assert "said x0.95-1.10" in monitor.line()
    monitor.hear(report(facts(factors=(0.81,) * 4, laws_off="laws are off")))
    assert "said x0.81, LAWS OFF" in monitor.line()
    monitor.hear(report(None))
    assert "said" not in monitor.line()


def test_who_can_press_is_told_to_press_again_until_something_else_is_said() -> None:
    monitor = watching(key="-")
    monitor.hear(report(facts()))
    assert "said x0.95-1.10, press - again for more" in monitor.line()
    monitor.hear(report(facts(2, answer="good")))
    assert "press" not in monitor.line()
    without = watching()
    without.hear(report(facts()))
    assert "press" not in without.line()


def test_where_hardly_anything_is_left_it_is_said_what_brings_it_back() -> None:
    monitor = watching()
    monitor.hear(report(facts(factors=(0.0, 1.0))))
    assert "said x0.00-1.00, hardly anything is left, until disarmed" in monitor.line()
    monitor.hear(report(facts(factors=(0.19, 1.0))))
    assert "hardly" not in monitor.line()


def test_each_press_in_the_monitor_is_said_however_fast_reports_come() -> None:
    keys = iter(["", "--", "x-"])
    with ServedRig() as rig, Display(address=rig.address, client="me") as display:
        reports: list[Item | None] = [("state", report(None))] * 3
        draw(display, iter(reports), lambda: next(keys))
        assert [command.answer for command in said(rig)] == ["too_strong"] * 3


def test_keys_are_read_of_a_terminal_only() -> None:
    with keys_of(io.StringIO("-")) as pressed:
        assert pressed() == ""


def test_the_log_tells_once_why_laws_are_off() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    for _ in range(3):
        journal.state(report(facts(laws_off="laws are off, since five of six")))
    journal.close()
    assert stream.getvalue().count("since five of six") == 1


# --- a replay ------------------------------------------------------------------------------------

SECOND = 1_000_000_000
CARRIED = Carried(
    carried=CarriedOver(
        t_ns=10 * SECOND,
        state="ARMED",
        soft_start=None,  # type: ignore[arg-type]
        contacts=None,
        power_up=None,
        has_session=True,
        calibration=None,
        shown_seq=None,
        next_scan_ns=None,
        recent_pulses=0,
        source_checked_ns=0,
    )
)


def timeline(*reports: StateReport) -> Timeline:
    lines: list[Line] = [
        Engine(t_ns=0, facts=engine_hello()),
        LeaseBegun(t_ns=0, client="me", uid=0, limits=Limits(max_current_ua=900, width_us=100)),
        CARRIED,
        *(State(report=each) for each in reports),
    ]
    return Timeline(lines)


def test_a_replay_is_told_what_was_said_when_it_was_heeded() -> None:
    first, second = facts(1, 11 * SECOND), facts(2, 12 * SECOND, lowers_only=False)
    found = timeline(report(first, 11 * SECOND), report(second, 12 * SECOND))
    told = [each for each in found.told if each.act == "felt"]
    assert [each.t_ns for each in told] == [11 * SECOND, 12 * SECOND]
    assert [each.felt for each in told] == [first, second]
    assert not any("answers" in caveat for caveat in found.caveats)


def test_what_was_said_before_the_record_is_a_caveat() -> None:
    found = timeline(report(facts(3, 9 * SECOND), 11 * SECOND))
    assert not [each for each in found.told if each.act == "felt"]
    assert any("3 of the person's answers" in caveat for caveat in found.caveats)
