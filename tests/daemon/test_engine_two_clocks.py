"""The board's clock and the machine's: what holds back the machine makes a fake late, and no more.

With a real board the two are one. A fake's clock stands still while its machine is held up; what
another process said (a frame, a lease, a sign of life) gets older meanwhile.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import MS, ended_leases, fully_open, halts, only, phases, states
from etd.engine.stopper import SILENT_NS
from etd.protocol.link import Alive, KeepLease
from etd_hal.backend import Backend
from etd_hal.ports import Clock

MakeRig = Callable[..., EngineRig]
BOARDS = ["kajimoto-hv507", "reference-hv507", "feetthrough-relay"]
CURRENT_UA = 1_000


@dataclass
class MachinesClock:
    """Ahead of the board's by what the machine has been held up; `times` as fast besides."""

    board: Clock
    times: int = 1
    held_up_ns: int = 0

    def now_ns(self) -> int:
        return self.board.now_ns() * self.times + self.held_up_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        raise AssertionError("nothing on the board waits for the machine")

    def doze_until_ns(self, deadline_ns: int) -> None:
        raise AssertionError("nothing on the board waits for the machine")


class Scene:
    """An engine whose board has one clock and whose machine another, showing electrode 3."""

    def __init__(
        self, make_rig: MakeRig, board: str = BOARDS[0], times: int = 1, factor: int = 1
    ) -> None:
        self._clocks: list[MachinesClock] = []

        def wrap(backend: Backend) -> Backend:
            self._clocks.append(MachinesClock(backend.clock, times))
            return replace(backend, host_clock=self._clocks[0], timeout_factor=factor)

        self.rig = make_rig(board, electrodes=16, wrap=wrap)

    @property
    def machine(self) -> MachinesClock:
        return self._clocks[0]

    def show(self, ttl_ms: int) -> None:
        assert self.rig.show(current_ua=only(16, e3=CURRENT_UA), ttl_ms=ttl_ms).error is None

    def keep(self, for_ms: int) -> None:
        """Time passes with the lease kept."""
        for _ in range(for_ms // 20):
            self.rig.commands.send(KeepLease(ref=0, lease=LEASE))
            self.rig.run_ms(20)

    def shown_ms(self, within_ms: int) -> float:
        """For how long, on the board's clock, it fires from now on; the lease is kept."""
        begun_ns = self.rig.clock.now_ns()
        self.keep(within_ms)
        return (max(phase.from_ns for phase in phases(self.rig, begun_ns)) - begun_ns) / MS


@pytest.mark.parametrize("board", BOARDS)
def test_a_machine_that_was_stopped_for_5_s_shows_nothing_afterwards_and_is_no_fault(
    make_rig: MakeRig, board: str
) -> None:
    scene = Scene(make_rig, board)
    rig = fully_open(scene.rig, CURRENT_UA)
    scene.show(ttl_ms=1_000)
    rig.run_ms(100)
    assert rig.state == "ARMED"
    scene.machine.held_up_ns += 5_000 * MS
    since_ns = rig.clock.now_ns()
    rig.run_ms(500)
    assert phases(rig, since_ns) == []
    assert [ended_lease.reason for ended_lease in ended_leases(rig)] == ["lapsed"]
    assert rig.state == "SAFE"
    assert [report for report in rig.reports if report.halt is not None] == []


def test_a_frame_that_expired_meanwhile_is_not_shown_and_the_next_one_is(make_rig: MakeRig) -> None:
    scene = Scene(make_rig)
    rig = fully_open(scene.rig, CURRENT_UA)
    scene.show(ttl_ms=200)
    rig.run_ms(50)
    scene.machine.held_up_ns += 201 * MS
    since_ns = rig.clock.now_ns()
    rig.run_ms(100)
    assert phases(rig, since_ns) == []
    assert rig.state == "ARMED"
    scene.show(ttl_ms=200)
    assert scene.shown_ms(within_ms=100) > 50


def test_a_frame_that_lay_in_the_queue_meanwhile_is_not_shown(make_rig: MakeRig) -> None:
    scene = Scene(make_rig)
    rig = fully_open(scene.rig, CURRENT_UA)
    rig.send(current_ua=only(16, e3=CURRENT_UA), ttl_ms=300)
    scene.machine.held_up_ns += 400 * MS
    since_ns = rig.clock.now_ns()
    rig.run_ms(100)
    assert phases(rig, since_ns) == []


@pytest.mark.parametrize(("times", "factor", "felt_ms"), [(1, 1, 200), (5, 1, 40), (5, 5, 200)])
def test_a_ttl_counts_on_the_machines_clock_and_a_factor_lengthens_it(
    make_rig: MakeRig, times: int, factor: int, felt_ms: int
) -> None:
    scene = Scene(make_rig, times=times, factor=factor)
    fully_open(scene.rig, CURRENT_UA)
    scene.show(ttl_ms=200)
    assert scene.shown_ms(within_ms=500) == pytest.approx(felt_ms, abs=20)


@pytest.mark.parametrize(("factor", "state"), [(1, "SAFE"), (3, "ARMED")])
def test_a_lease_and_the_gateways_silence_are_lengthened_by_the_same_factor(
    make_rig: MakeRig, factor: int, state: str
) -> None:
    leased = Scene(make_rig, factor=factor)
    fully_open(leased.rig, CURRENT_UA)
    leased.rig.ask(KeepLease, lease=LEASE)
    leased.machine.held_up_ns += 1_500 * MS
    leased.rig.commands.send(Alive())
    leased.rig.run_ms(5)
    assert leased.rig.state == state

    watched = Scene(make_rig, factor=factor)
    fully_open(watched.rig, CURRENT_UA)
    watched.rig.is_gateway_alive = False
    watched.rig.commands.send(Alive())
    watched.rig.run_ms(5)
    watched.machine.held_up_ns += 400 * MS
    watched.rig.run_ms(5)
    assert watched.rig.state == state


@pytest.mark.parametrize("factor", [1, 3])
def test_the_stopper_of_a_fake_may_wait_for_a_processor_as_long_as_the_rest(
    make_rig: MakeRig, factor: int
) -> None:
    scene = Scene(make_rig, factor=factor)
    fully_open(scene.rig, CURRENT_UA)
    scene.rig.stopper.is_looking = False
    scene.keep(factor * SILENT_NS // MS - 40)
    assert scene.rig.state == "ARMED"
    scene.keep(100)
    assert scene.rig.state == "HALTED"
    assert "the stopper made no check" in halts(scene.rig)[0].detail


def test_every_status_tells_the_factor_and_how_late_the_board_is(make_rig: MakeRig) -> None:
    scene = Scene(make_rig, factor=7)
    scene.machine.held_up_ns += 250 * MS
    scene.rig.run_ms(1_100)
    assert states(scene.rig)[-1].timeout_factor == 7
    assert states(scene.rig)[-1].clock_lag_us == 250_000


def test_a_single_clock_is_not_late(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=16)
    rig.run_ms(1_100)
    assert (states(rig)[-1].timeout_factor, states(rig)[-1].clock_lag_us) == (1, 0)
