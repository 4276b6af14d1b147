"""A self-test has a stopper beside it: tried out before electrodes are connected, and then kept."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest

from etd.selftest.fixture import Fixture
from etd.selftest.run import run
from etd_hal.cutlatch import CutLatch
from etd_hal.fake.faults import SpiStall
from etd_hal.fake.stepped_beside import SteppedBeside, SteppedStopper
from etd_hal.ports import Changes, Edge, Gpio
from etd_hal.stopper import Stopper
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
        self.lines, self.rig_clock = rig.bench.backend.gpio, rig.clock
        super().__init__(self.lines, rig.clock)
        self._kind = kind
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
        stopper = Stopper(latch.words, self.rig_clock.now_ns, lambda: self.lines.set(safe_changes))
        self.started = self._kind(stopper, self.rig_clock)
        return self.started


class _Deaf(SteppedStopper):
    def watch(self, is_needed: bool) -> None:
        """Hangs."""


class _Late(SteppedStopper):
    """Kept from its processor for 20 ms before each check."""

    def watch(self, is_needed: bool) -> None:
        again = super().watch
        self._clock.at(self._clock.now_ns() + 20 * MS, lambda: again(is_needed))


@pytest.mark.parametrize(
    ("kind", "measured"),
    [
        (_Deaf, "nothing was cut"),
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


class Killed(BaseException):
    """What ends a process comes at any call of its own, and `except Exception` does not stop it."""


class _Outlives(SteppedStopper):
    """Of a process that is killed nobody calls this; it learns of the end from the kernel."""

    def end(self) -> None:
        pass


class _DeadGpio:
    """The lines of a process: once it is dead it makes no call any more."""

    def __init__(self, inner: Gpio) -> None:
        self._inner = inner
        self.is_dead = False

    def set(self, changes: Changes) -> None:
        self._alive()
        self._inner.set(changes)

    def get(self, line: int) -> int:
        self._alive()
        return self._inner.get(line)

    def edges(self) -> tuple[Edge, ...]:
        self._alive()
        return self._inner.edges()

    def _alive(self) -> None:
        if self.is_dead:
            raise Killed


@pytest.mark.parametrize("board", [BARE, ALL])
def test_a_test_that_is_killed_in_a_pulse_leaves_its_outputs_cut(board: str) -> None:
    """All that is left of it is the stopper."""
    rig = selftest_rig(board)
    whole = selftest_rig(board)
    whole.run()
    beside = _Changed(rig, _Outlives)
    lines = _DeadGpio(rig.bench.backend.gpio)
    rig.bench = replace(rig.bench, backend=replace(rig.bench.backend, gpio=lines))

    def kill() -> None:
        lines.is_dead = True
        raise Killed

    rig.watch.before_pulse = {whole.watch.pulses // 2: kill}
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)
    with pytest.raises(Killed):
        run(fixture, DATE)
    safe = fixture.board.safe_changes
    assert {line: beside.lines.get(line) for line, _ in safe} != dict(safe)
    assert beside.started is not None
    SteppedStopper.end(beside.started)
    assert {line: beside.lines.get(line) for line, _ in safe} == dict(safe)


def test_it_ends_with_the_test_and_cuts_nothing_after_it() -> None:
    rig = selftest_rig()
    beside = _Changed(rig, SteppedStopper)
    assert rig.run().passed
    assert beside.started is not None
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)
    fixture.board.cut.expect(rig.clock.now_ns())
    rig.clock.spend(100 * MS)
    assert not fixture.board.cut.is_cut
