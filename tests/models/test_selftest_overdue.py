"""A self-test has a stopper beside it: tried out before electrodes are connected, and then kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from etd.selftest.fixture import Fixture
from etd.selftest.run import run
from etd_hal.cutlatch import CutLatch
from etd_hal.fake.faults import SpiStall
from etd_hal.fake.stepped_beside import SteppedBeside, SteppedStopper
from etd_hal.ports import Changes
from etd_hal.supply_note import SupplyNote
from selftest_rig import DATE, SelftestRig, bad, by_name, selftest_rig

MS = 1_000_000
BARE, ALL, RELAY = "kajimoto-hv507", "reference-hv507", "feetthrough-relay"


def held_up(board: str, part: float) -> SelftestRig:
    """For five seconds in a message, when this part of all pulses was fired."""
    whole = selftest_rig(board)
    assert whole.run().passed
    rig = selftest_rig(board)
    stall = SpiStall(5_000_000, at_message=1)
    rig.watch.before_pulse = {
        int(whole.watch.pulses * part): lambda: rig.fake.world.put_in(stall),
    }
    return rig


@pytest.mark.parametrize("part", [0.25, 0.5, 0.75])
@pytest.mark.parametrize(
    # A relay opens late, and what the supply's capacitor holds flows until then and after.
    ("board", "most_nc"),
    [(BARE, 200.0), (ALL, 50.0), (RELAY, 82_000.0)],
)
def test_a_message_that_is_held_up_is_cut_off(board: str, most_nc: float, part: float) -> None:
    """Without the stopper 424 000 nC pass the load at a probe's current."""
    rig = held_up(board, part)
    assert [name for _, name in bad(rig.run())] == ["length_of_a_message"]
    assert rig.most_charge_nc < most_nc


class _Changed(SteppedBeside):
    """A bench whose stopper is another."""

    def __init__(self, rig: SelftestRig, kind: type[SteppedStopper]) -> None:
        super().__init__(rig.bench.backend.gpio, rig.clock)
        self._kind = kind
        self.stopper_clock = rig.clock
        self.started: SteppedStopper | None = None
        rig.bench = replace(rig.bench, backend=replace(rig.bench.backend, beside=self))

    def stopper(
        self,
        latch: CutLatch,
        safe_changes: Changes,
        note: Path | SupplyNote | None,
        priority: int | None,
        scan_core: int | None,
    ) -> SteppedStopper:
        assert note is None
        inner: Any = super().stopper(latch, safe_changes, None, priority, scan_core)
        self.started = self._kind(inner._stopper, self.stopper_clock)
        return self.started


class _Deaf(SteppedStopper):
    def watch(self, is_needed: bool) -> None:
        """Hangs."""


class _NotUrgent(SteppedStopper):
    refusals = ("the stopper: no real-time priority",)


class _Late(SteppedStopper):
    """Kept from its processor for 20 ms before each check."""

    def watch(self, is_needed: bool) -> None:
        again = super().watch
        self._clock.at(self._clock.now_ns() + 20 * MS, lambda: again(is_needed))


@pytest.mark.parametrize(
    ("kind", "measured"),
    [
        (_Deaf, "nothing was cut"),
        (_NotUrgent, "the stopper: no real-time priority"),
        (_Late, "cut 20.0 ms after it was due"),
    ],
)
@pytest.mark.parametrize("board", [BARE, ALL, RELAY])
def test_without_a_stopper_in_time_no_electrode_is_connected(
    board: str, kind: type[SteppedStopper], measured: str
) -> None:
    rig = selftest_rig(board)
    _Changed(rig, kind)
    report = rig.run()
    assert bad(report) == [("rail", "stopper")]
    assert by_name(report)["stopper"].measured == measured
    assert rig.most_charge_nc == 0.0


def test_a_bench_that_starts_no_process_is_told() -> None:
    rig = selftest_rig()
    rig.bench = replace(rig.bench, backend=replace(rig.bench.backend, beside=None))
    report = rig.run()
    assert bad(report) == [("rail", "bus")]
    assert "the stopper" in by_name(report)["bus"].measured


@pytest.mark.parametrize("board", [BARE, ALL])
def test_a_test_that_is_killed_in_a_pulse_leaves_its_outputs_cut(board: str) -> None:
    """All that is left of it is the stopper, which learns of the end from the kernel."""

    class Killed(BaseException):
        pass

    rig = selftest_rig(board)
    beside = _Changed(rig, SteppedStopper)
    whole = selftest_rig(board)
    whole.run()

    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)

    def kill() -> None:
        # What `finally` would do is done by nobody.
        fixture.board.safe_off = lambda: ()  # type: ignore[method-assign]
        fixture.end_stopper = lambda: None  # type: ignore[method-assign]
        raise Killed

    rig.watch.before_pulse = {whole.watch.pulses // 2: kill}
    with pytest.raises(Killed):
        run(fixture, DATE)
    lines = rig.bench.backend.gpio
    safe = fixture.board.safe_changes
    assert {line: lines.get(line) for line, _ in safe} != dict(safe)
    assert beside.started is not None
    beside.started.end()
    assert {line: lines.get(line) for line, _ in safe} == dict(safe)


def test_it_ends_with_the_test_and_cuts_nothing_after_it() -> None:
    rig = selftest_rig()
    beside = _Changed(rig, SteppedStopper)
    assert rig.run().passed
    assert beside.started is not None
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)
    fixture.board.cut.expect(rig.clock.now_ns())
    rig.clock.spend(100 * MS)
    assert not fixture.board.cut.is_cut
