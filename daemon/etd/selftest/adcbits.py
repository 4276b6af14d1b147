"""Stage 10, into the dummy load: each of the ADC's low bits must read both 0 and 1.

Owns: which currents bring a bit to both levels. Must not know: what the readings say of the source.

The ladder's equal steps may all read near multiples of 64 codes, so that a low bit is constant on a
good board. Such a bit gets currents of its own: eight readings over the bit's period, of which each
half has at least three, whatever the constants are within their tolerances. For the two lowest
bits, whose period may be below a step of the DAC: successive codes of the DAC, into the load and
into an open electrode.
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
#: From this bit on the period is long enough for readings by period.
_BY_PERIOD = 2
#: The lowest of these currents: weak, and above the ADC's first codes.
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
        f"bits {still} constant in {seen.readings} readings"
        if still
        else f"bits 0 to {_BITS - 1} change, {seen.readings} readings",
        "each of the low bits at 0 and at 1",
        "bit 0: the ADC's word is shifted by a bit: use SPI mode 1, and check the clock's edges;"
        " a higher bit: replace the ADC",
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
