"""Stop, stop lines, and the way out of a halt."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import Any

import pytest

from engine_rig import EngineRig
from engine_scenes import (
    MS,
    armed,
    dac_codes,
    ended_leases,
    fully_open,
    halts,
    moves,
    only,
    phases,
    states,
)
from etd.protocol.frame import Frame
from etd.protocol.link import (
    Answer,
    ArmBoard,
    AskAccount,
    ClearHalt,
    CloseLease,
    Command,
    DisarmBoard,
    KeepLease,
    MeasureContact,
    NewFrame,
    OpenLease,
    SetMark,
    StopNow,
)
from etd.protocol.messages import Limits
from etd_hal.backend import Backend
from etd_hal.ports import Changes, Edge, Gpio

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
ALL = (1_000,) * N
REFERENCE = "reference-hv507"


def stop(rig: EngineRig, who: str = "operator") -> None:
    assert rig.ask(StopNow, client=who).error is None


def in_state(rig: EngineRig, state: str) -> EngineRig:
    """Any of SAFE, PROBE, ARMED; PROBE waits for a rail that rises for half a second."""
    rig.open()
    rig.try_wearer_stop()
    if state != "SAFE":
        rig.commands.send(ArmBoard(ref=rig.next_ref()))
        rig.run_ms(10 if state == "PROBE" else 700)
    assert rig.state == state
    return rig


@pytest.mark.parametrize("state", ["SAFE", "PROBE", "ARMED"])
def test_stop_halts_from_every_state(make_rig: MakeRig, state: str) -> None:
    rig = in_state(make_rig(REFERENCE), state)
    stop(rig)
    assert rig.state == "HALTED"
    (halt,) = halts(rig)
    assert (halt.cause, halt.source) == ("stop", "operator")
    assert states(rig)[-1].halt == halt
    assert moves(rig, "HV")[-1][1] == 0
    assert rig.fake.dac_code == 0
    assert rig.engine.supervisor.lease is None
    assert ended_leases(rig)[-1].reason == "halted"


def test_stop_is_silent_within_one_pulse(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.show(current_ua=ALL, rate_hz=100.0, ttl_ms=1_000)
    rig.run_ms(7)
    asked_ns = rig.clock.now_ns()
    rig.commands.send(StopNow(ref=0, client="operator"))
    rig.run_ms(100)
    assert rig.engine.components.soft_start.ceiling_ua == 0
    assert phases(rig)[-1].to_ns < asked_ns + MS
    assert all(code == 0 for _, code in dac_codes(rig, asked_ns + MS))


def test_a_stop_in_the_middle_of_a_scan_is_heard_before_the_next_pulse(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.run_ms(250)
    asked_ns = rig.clock.now_ns() + 3 * MS
    rig.clock.at(asked_ns, lambda: rig.commands.send(StopNow(ref=0, client="operator")))
    rig.show(current_ua=ALL, rate_hz=60.0, ttl_ms=1_000)
    rig.run_ms(100)
    assert any(phase.from_ns < asked_ns for phase in phases(rig) if phase.current_ua > 900)
    assert phases(rig)[-1].from_ns < asked_ns + MS


@pytest.mark.parametrize(
    "ask",
    [
        lambda rig: rig.ask(ArmBoard),
        lambda rig: rig.ask(
            OpenLease, lease="b", client="b", limits=Limits(max_current_ua=100, width_us=50)
        ),
    ],
)
def test_a_halt_is_latched(make_rig: MakeRig, ask: Callable[[EngineRig], object]) -> None:
    rig = armed(make_rig(electrodes=N))
    stop(rig)
    answer = ask(rig)
    assert answer.error == "halted"  # type: ignore[attr-defined]
    assert "clear" in answer.reason  # type: ignore[attr-defined]
    rig.run_ms(3_000)
    assert rig.state == "HALTED"


@pytest.mark.parametrize(
    ("command", "more"),
    [
        (KeepLease, {}),
        (CloseLease, {}),
        (DisarmBoard, {}),
        (MeasureContact, {}),
        (SetMark, {}),
        (AskAccount, {"seq": 7}),
    ],
)
def test_a_command_that_passed_the_gateway_before_the_stop_is_told_its_cause(
    make_rig: MakeRig, command: type[Command], more: dict[str, Any]
) -> None:
    rig = armed(make_rig(electrodes=N))
    stop(rig, "the wearer")
    answer = rig.ask(command, lease="a-lease", **more)
    assert answer.error == "halted"
    assert "the wearer" in answer.reason


def test_a_frame_that_passed_the_gateway_before_the_stop_is_told_its_cause(
    make_rig: MakeRig,
) -> None:
    rig = armed(make_rig(electrodes=N))
    stop(rig, "the wearer")
    answer = rig.show(current_ua=ALL)
    assert answer.error == "halted"
    assert "the wearer" in answer.reason
    streamed = Frame(lease="a-lease", seq=1_000, current_ua=ALL)
    assert rig.frames.send(NewFrame(ref=0, frame=streamed))
    rig.run_ms(50)
    assert [report.refused.error for report in rig.reports if report.refused] == ["halted"]


def test_the_first_cause_stands(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    stop(rig, "the first")
    stop(rig, "the second")
    assert [halt.source for halt in halts(rig)] == ["the first"]
    assert rig.engine.supervisor.states.halt == halts(rig)[0]


def test_clear_leads_to_safe_and_open_and_arm_are_needed_after(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    stop(rig)
    assert rig.ask(ClearHalt).error is None
    assert rig.state == "SAFE"
    assert rig.ask(ArmBoard).error == "no_lease"
    rig.open()
    assert rig.show(current_ua=ALL).error == "not_armed"
    assert rig.ask(ArmBoard).error is None
    assert rig.state == "ARMED"


def test_there_is_nothing_to_clear_while_nothing_is_halted(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    assert rig.ask(ClearHalt).error == "wrong_state"
    assert rig.state == "ARMED"


# --- stop lines -----------------------------------------------------------------------------------


@pytest.mark.parametrize("line", ["emergency_stop", "wearer_stop"])
def test_a_stop_line_while_armed_is_silent_within_one_pulse_and_halts(
    make_rig: MakeRig, line: str
) -> None:
    rig = fully_open(make_rig(REFERENCE), 1_000)
    rig.run_ms(250)
    pressed_ns = rig.clock.now_ns() + 6 * MS
    rig.fake.world.press(line, pressed_ns)  # type: ignore[arg-type]
    rig.show(current_ua=(1_000,) * 64, rate_hz=20.0, ttl_ms=1_000)
    rig.run_ms(50)
    fired = [phase for phase in phases(rig) if phase.current_ua > 900]
    assert 5 < len(fired) < 30
    assert pressed_ns - MS < fired[-1].from_ns < pressed_ns + MS
    (halt,) = halts(rig)
    assert (halt.cause, halt.source) == (line, line)
    hv_ns, hv = moves(rig, "HV")[-1]
    assert hv == 0
    assert hv_ns < pressed_ns + MS
    assert {level for _, level in moves(rig, "BL", pressed_ns + MS)} <= {0}
    assert {code for _, code in dac_codes(rig, hv_ns)} == {0}


@pytest.mark.parametrize("line", ["emergency_stop", "wearer_stop"])
def test_a_stop_line_between_two_scans_halts_within_milliseconds(
    make_rig: MakeRig, line: str
) -> None:
    rig = armed(make_rig(REFERENCE))
    rig.fake.world.press(line)  # type: ignore[arg-type]
    rig.run_ms(3)
    assert rig.state == "HALTED"


@pytest.mark.parametrize("line", ["emergency_stop", "wearer_stop"])
def test_a_stop_line_in_probe_halts_and_the_arm_is_answered(make_rig: MakeRig, line: str) -> None:
    rig = in_state(make_rig(REFERENCE), "PROBE")
    ref = rig.last_ref
    rig.fake.world.press(line)  # type: ignore[arg-type]
    answer = rig.wait_for(ref)
    assert answer.error == "arm_failed"
    assert line in answer.reason
    assert rig.state == "HALTED"
    assert moves(rig, "HV")[-1][1] == 0


class WithoutEdges:
    """Lines of which the kernel has lost every edge: their levels are as they are."""

    def __init__(self, gpio: Gpio) -> None:
        self._gpio = gpio
        self.is_losing = False

    def set(self, changes: Changes) -> None:
        self._gpio.set(changes)

    def get(self, line: int) -> int:
        return self._gpio.get(line)

    def edges(self) -> tuple[Edge, ...]:
        found = self._gpio.edges()
        return () if self.is_losing else found


@pytest.mark.parametrize("line", ["emergency_stop", "wearer_stop"])
def test_a_stop_line_whose_edge_was_lost_halts_before_the_next_scan(
    make_rig: MakeRig, line: str
) -> None:
    lines: list[WithoutEdges] = []

    def wrap(backend: Backend) -> Backend:
        lines.append(WithoutEdges(backend.gpio))
        return dataclasses.replace(backend, gpio=lines[0])

    rig = armed(make_rig(REFERENCE, wrap=wrap))
    rig.show(current_ua=only(64, e3=500, e40=500), rate_hz=20.0, ttl_ms=1_000)
    rig.run_ms(60)
    lines[0].is_losing = True
    pressed_ns = rig.clock.now_ns()
    rig.fake.world.press(line)  # type: ignore[arg-type]
    assert len(phases(rig)) >= 4
    rig.run_ms(51)
    (halt,) = halts(rig)
    assert (halt.cause, halt.source) == (line, line)
    rig.run_ms(60)
    assert phases(rig, pressed_ns) == []


def test_a_press_that_is_over_at_once_still_halts(make_rig: MakeRig) -> None:
    rig = armed(make_rig(REFERENCE))
    now_ns = rig.clock.now_ns()
    rig.fake.world.press("wearer_stop", now_ns + 1_000)
    rig.fake.world.release("wearer_stop", now_ns + 2_000)
    rig.run_ms(5)
    assert rig.state == "HALTED"


def test_a_stop_line_in_safe_halts_nothing_but_nothing_is_armed(make_rig: MakeRig) -> None:
    rig = in_state(make_rig(REFERENCE), "SAFE")
    rig.fake.world.press("emergency_stop")
    rig.run_ms(5)
    assert rig.state == "SAFE"
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert "emergency_stop open" in answer.reason
    assert rig.state == "SAFE"


@pytest.mark.parametrize("line", ["emergency_stop", "wearer_stop"])
def test_a_halt_is_not_cleared_while_a_stop_line_is_open(make_rig: MakeRig, line: str) -> None:
    rig = armed(make_rig(REFERENCE))
    rig.fake.world.press(line)  # type: ignore[arg-type]
    rig.run_ms(5)
    answer = rig.ask(ClearHalt)
    assert answer.error == "halted"
    assert f"{line} still open" in answer.reason
    assert rig.state == "HALTED"
    rig.fake.world.release(line)  # type: ignore[arg-type]
    rig.run_ms(5)
    assert rig.ask(ClearHalt).error is None


@pytest.mark.parametrize("is_found_by_sending", [False, True])
def test_a_stop_of_a_gateway_that_is_killed_at_once_halts(
    make_rig: MakeRig, is_found_by_sending: bool
) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.commands.send(StopNow(ref=0, client="operator"))
    rig.commands.close()
    rig.frames.close()
    if is_found_by_sending:
        rig.engine.components.gateway_link.send(Answer(ref=7))
    rig.run_ms(20)
    assert rig.state == "HALTED"


def test_a_stop_is_heard_behind_a_flood_of_frames(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    for _ in range(200):
        rig.send(current_ua=ALL, ttl_ms=1_000)
    asked_ns = rig.clock.now_ns()
    rig.commands.send(StopNow(ref=0, client="operator"))
    rig.run_ms(20)
    assert rig.state == "HALTED"
    assert [phase for phase in phases(rig, asked_ns) if phase.from_ns > asked_ns + MS] == []
