"""Stage 8, into the dummy load: each of the ADC's low bits stands at 0 at times, and at 1 at times.

Owns: which currents bring a bit that did not move yet to both its levels. Must not know: what the
readings say of the source.

The ladder's equal steps may all read near multiples of 64 codes: then a low bit stands still on a
board that is in order. So whoever stood still is looked for at currents of its own: eight readings
over the bit's period, which leaves both halves of it at least three whatever the constants are
within their tolerances; and for the two lowest, whose period is no wider than the DAC's steps may
be, codes of the DAC one after another, into the load and into an open electrode.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator

from etd.safety.maxima import maxima_of
from etd.selftest.fixture import DummyLoad, Fixture
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober

_BITS = 6
#: Of a bit's period, and of the DAC's codes.
_READINGS, _NEIGHBORS = 8, 16
#: A bit whose period is at least a reading's uncertainty times the readings is looked for by it.
_BY_PERIOD = 2
#: Where the codes one after another begin, and the periods: weak, and above the ADC's first codes.
_FROM_UA = 500
_SECOND_MS, _MARGIN = 1_000, 1.2


class _Seen:
    """The low bits that were read as 1, and those that were read as 0."""

    def __init__(self, step_v: float) -> None:
        self._step_v = step_v
        self._ones = self._zeros = 0
        self.readings = 0

    def add(self, voltage_v: float) -> None:
        code = round(voltage_v / self._step_v)
        self._ones |= code
        self._zeros |= ~code
        self.readings += 1

    @property
    def still(self) -> list[int]:
        moved = self._ones & self._zeros
        return [bit for bit in range(_BITS) if not moved >> bit & 1]


def check(
    fixture: Fixture,
    log: CheckLog,
    prober: Prober,
    load: DummyLoad,
    read_v: Iterable[float],
    volts_per_ua: float,
) -> None:
    """`read_v`: of the ladder; `volts_per_ua` is what its line makes of this load.

    Raises: BusError, BoardFault, GuardRefusal.
    """
    seen = _Seen(fixture.file.source.node_uv_per_code / 1e6)
    for volts in read_v:
        seen.add(volts)
    pause_ms = _SECOND_MS * _MARGIN / maxima_of(fixture.file, fixture.loaded.body_site).rate_hz
    for electrode, current_ua in _looked_for(fixture, load, volts_per_ua):
        if not seen.still:
            break
        fixture.wait_ms(pause_ms)
        seen.add(prober.into_load(electrode, current_ua)[1].voltage_v)
    still = seen.still
    log.judge(
        "adc_bits",
        not still,
        f"bits {still} never moved, {seen.readings} readings"
        if still
        else f"bits 0 to {_BITS - 1} move, {seen.readings} readings",
        "each of the low bits at 0 and at 1",
        "the ADC's word comes moved by a bit: use SPI mode 1, and look at the clock's edges; a"
        " higher bit that stands still is the ADC's own",
    )


def _looked_for(
    fixture: Fixture, load: DummyLoad, volts_per_ua: float
) -> Iterator[tuple[int, int]]:
    """(electrode, uA)."""
    source = fixture.file.source
    ua_per_code = source.node_uv_per_code / 1e6 / volts_per_ua
    for bit in reversed(range(_BY_PERIOD, _BITS)):
        for part in range(_READINGS):
            yield load.first, _FROM_UA + int((part << bit + 1) / _READINGS * ua_per_code)
    commanded_ua = source.full_scale_ua / (source.codes - 1)
    for electrode in (load.first, fixture.free[0]):
        for step in range(_NEIGHBORS):
            # Half a step more, so that no rounding makes two of them one.
            yield electrode, _FROM_UA + int((step + 0.5) * commanded_ua)
