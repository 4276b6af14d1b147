"""Rounds over all electrodes without the operator, to find a switch that fails sometimes.

Owns: the order of the rounds, and the report of failures. Must not know: the operator; what is
fired next.

The readings of load and open electrodes are known. Here each single reading is only compared as to
which it is nearer to, so that the noise of a good ADC is not taken for a fault.

The walk repeats readings while a touch may bounce, and so does not detect a chain that sometimes
fails. Here nothing is touched. An electrode with the load precedes and follows each open one, so
that a latch that did not follow is detected at once; a lost clock is only detected if it moves the
load's two outputs (`UNPROVED`).
"""

from __future__ import annotations

from collections.abc import Iterator

from etd.safety.maxima import maxima_of
from etd.selftest.fixture import MS, DummyLoad, Fixture
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd.selftest.touch import Touch

#: Enough for five failures of a switch that fails once in a hundred times.
_LEAST_SELECTIONS = 500
_LEAST_ROUNDS = 8
_MOST_TOLD = 6
_SECOND_MS = 1_000
#: Each end of the load gets one of so many pulses, at most at the body site's rate.
_SELECTIONS_PER_END, _MARGIN = 4, 1.2


def check(fixture: Fixture, log: CheckLog, prober: Prober, load: DummyLoad) -> None:
    """With only the load connected. Raises: BusError, BoardFault, GuardRefusal."""
    touch = Touch(fixture, prober, load)
    nearer = touch.nearer
    rate_hz = maxima_of(fixture.file, fixture.loaded.body_site).rate_hz
    pause_ms = _SECOND_MS * _MARGIN / rate_hz / _SELECTIONS_PER_END
    fixture.wait_ms(_SECOND_MS)
    begun_ns = fixture.clock.now_ns()
    done = 0
    off: list[str] = []
    rounds = max(_LEAST_ROUNDS, -(-_LEAST_SELECTIONS // (2 * len(fixture.free))))
    for number in range(rounds):
        prober.reset_chain()
        for electrode, is_loaded in _round(fixture, load, is_load_first=number % 4 < 2):
            fixture.wait_ms(pause_ms)
            done += 1
            volts = touch.read_v(electrode, is_anodic=number % 2 == 0)
            if not (nearer.is_load(volts) if is_loaded else nearer.is_open(volts)):
                off.append(f"{electrode} ({volts:.2f} V)")
    took_s = (fixture.clock.now_ns() - begun_ns) / MS / 1_000
    where = f": electrode {', '.join(off[:_MOST_TOLD])}" if off else ""
    log.judge(
        "every_time",
        not off,
        f"{len(off)} of {done} selections in {took_s:.1f} s were wrong{where}",
        f"every time nearer to {nearer.load_v:.2f} V at the load's electrodes, and nearer to"
        f" {nearer.open_v:.2f} V at all others",
        "the chain of switches sometimes fails: check its clock, data and latch with an"
        " oscilloscope, its supply, the level shifter, and loose wires",
    )


def _round(fixture: Fixture, load: DummyLoad, *, is_load_first: bool) -> Iterator[tuple[int, bool]]:
    """(electrode, whether it has the load): the load's ends in turn, each with an open one.

    The order varies: a latch that misses edges periodically could otherwise miss them at open
    electrodes only, where it does not show.
    """
    for index, electrode in enumerate(fixture.free):
        loaded, is_open = ((load.first, load.second)[index % 2], True), (electrode, False)
        yield from (loaded, is_open) if is_load_first else (is_open, loaded)
