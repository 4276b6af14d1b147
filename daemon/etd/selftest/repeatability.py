"""Rounds over all electrodes without hands and without a second look: a switch that follows nearly
always.

Owns: the order of the rounds, and what is said of those that were off. Must not know: who touches
what; what is fired next.

What the load and the board make of a probe has been measured. Here each single reading says only
which of the two it is nearer to, so that the noise of an ADC in order is no fault of the switches.

The walk looks again for as long as a touch may bounce, and so forgives a chain that bounces. Here
nobody touches anything. An electrode that reads the load comes before and after each one that is
open, so that a latch that did not follow shows at once; of a lost clock only what moves the load's
two outputs shows (`UNPROVED`).
"""

from __future__ import annotations

from collections.abc import Iterator

from etd.safety.maxima import maxima_of
from etd.selftest.fixture import MS, DummyLoad, Fixture
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd.selftest.touch import Touch

#: Enough for a fault that comes once in a hundred times to come five times.
_LEAST_SELECTIONS = 500
_LEAST_ROUNDS = 8
_MOST_TOLD = 6
_SECOND_MS = 1_000
#: The load's ends get a pulse each in so many, no oftener than the body site allows.
_SELECTIONS_PER_END, _MARGIN = 4, 1.2


def check(fixture: Fixture, log: CheckLog, prober: Prober, load: DummyLoad) -> None:
    """With the load between its two electrodes, and alone. Raises: as all that probes."""
    touch = Touch(fixture, prober, load)
    nearer = touch.nearer
    rate_hz = maxima_of(fixture.file, fixture.loaded.body_site).rate_hz
    pause_ms = _SECOND_MS * _MARGIN / rate_hz / _SELECTIONS_PER_END
    fixture.wait_ms(_SECOND_MS)
    begun_ns = fixture.clock.now_ns()
    done = 0
    off: list[str] = []
    for number in range(_rounds(fixture)):
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
        f"{len(off)} of {done} selections in {took_s:.1f} s were off{where}",
        "the load at its two electrodes and open at all others, every single time, by which of"
        f" {nearer.load_v:.2f} and {nearer.open_v:.2f} V is nearer",
        "the chain of switches does not always follow: look at its clock, data and latch with an"
        " oscilloscope, at its supply, the level shifter and loose wires",
    )


def _rounds(fixture: Fixture) -> int:
    return max(_LEAST_ROUNDS, -(-_LEAST_SELECTIONS // (2 * len(fixture.free))))


def _round(fixture: Fixture, load: DummyLoad, *, is_load_first: bool) -> Iterator[tuple[int, bool]]:
    """(electrode, whether it reads the load): the load's ends in turn, each beside an open one.

    Not always in one order: a latch that misses one edge of so many, a multiple of those of two
    selections, would miss it at the open ones alone, which read open all the same.
    """
    for index, electrode in enumerate(fixture.free):
        loaded, is_open = ((load.first, load.second)[index % 2], True), (electrode, False)
        yield from (loaded, is_open) if is_load_first else (is_open, loaded)
