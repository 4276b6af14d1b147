"""A ladder of ever stronger pulses into the dummy load; each must agree before the next is fired.

Owns: how far a step may be off, and where the climb ends: a source that is wrong never comes to its
strongest. Must not know: what the steps together say; who is near.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd.selftest.buses import IDLE_V
from etd.selftest.fixture import DummyLoad, Fixture
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd.selftest.readings import TOLERANCE
from etd_hal.board import PulseResult
from etd_hal.boardfile import Source

_STEPS = 16
#: Off the line, of a step's own current.
LINEARITY = 0.03
SATURATES = (
    "the source saturates: look at its mirror, and at the rail under load; if it comes further with"
    " a smaller first resistor it is the rail"
)
#: Of the compliance: what the top may take of it by the board file, and on this board. The second
#: is more because the leak may be larger than the file says.
_HEADROOM_NAMED, _HEADROOM = 0.9, 0.95


@dataclass(frozen=True, slots=True)
class Rung:
    """What the source was told, and what it made of it by the node's voltage."""

    commanded_ua: int
    made_ua: float
    shot: PulseResult


def largest_ohm(source: Source, strongest_ua: int) -> int | None:
    """Into a larger load the source cannot make its strongest; None where it can into any."""
    return _largest_ohm(source, strongest_ua, source.leak_ohm)


def largest_here_ohm(fixture: Fixture, strongest_ua: int) -> int | None:
    """The same for this board, as it was measured."""
    return _largest_ohm(fixture.file.source, strongest_ua * fixture.gain, fixture.leak_ohm)


def _largest_ohm(source: Source, most_ua: float, leak_ohm: float) -> int | None:
    beside_ohm = source.compliance_v * _HEADROOM_NAMED / most_ua * 1e6
    if beside_ohm >= leak_ohm:
        return None
    return int(1 / (1 / beside_ohm - 1 / leak_ohm))


def reachable_ua(fixture: Fixture, beside_ohm: float) -> int:
    """What the source may be told, and surely makes into a load and its leak."""
    return int(fixture.file.source.compliance_v * _HEADROOM / (beside_ohm * fixture.gain) * 1e6)


def climb(
    fixture: Fixture,
    log: CheckLog,
    prober: Prober,
    load: DummyLoad,
    beside_ohm: float,
    most_ua: int,
) -> list[Rung]:
    """All steps up to `most_ua`, or those until one was off: that is judged a failure.

    Raises: BusError, BoardFault, GuardRefusal.
    """
    rungs: list[Rung] = []
    for step in range(1, _STEPS + 1):
        commanded_ua, result = prober.into_load(load.first, most_ua * step // _STEPS)
        rung = Rung(commanded_ua, result.voltage_v / beside_ohm * 1e6, result)
        rungs.append(rung)
        slack_ua = _slack_ua(fixture, rung, beside_ohm)
        if abs(rung.made_ua - commanded_ua) > slack_ua:
            _judge_off(log, rung, step, slack_ua)
            break
    return rungs


def _slack_ua(fixture: Fixture, rung: Rung, beside_ohm: float) -> float:
    """Gain and line, what a node at rest may show already, and a step of the ADC."""
    reading_v = IDLE_V + fixture.file.source.node_uv_per_code / 1e6
    return (TOLERANCE + LINEARITY) * rung.commanded_ua + reading_v / beside_ohm * 1e6


def _judge_off(log: CheckLog, rung: Rung, step: int, slack_ua: float) -> None:
    """Too little after steps that agreed is a source that saturates; all else is its gain."""
    is_saturated = step > 1 and rung.made_ua < rung.commanded_ua
    log.judge(
        "linearity" if is_saturated else "steps",
        False,
        f"{rung.made_ua:.0f} uA where {rung.commanded_ua} uA were told, at step {step} of {_STEPS}:"
        " nothing stronger was fired",
        f"{rung.commanded_ua} +-{slack_ua:.0f} uA",
        SATURATES
        if is_saturated
        else "the source makes something else than it is told: look at the DAC's reference, and at"
        " the mirror",
    )
