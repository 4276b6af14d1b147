"""Pulses of rising strength into the dummy load; each must agree before the next is fired.

Owns: the tolerance of a step, and the end of the climb: a wrong source never fires its strongest
pulse. Must not know: what the steps together say.
"""

from __future__ import annotations

from dataclasses import dataclass

from etd.selftest.buses import IDLE_V
from etd.selftest.fixture import DummyLoad, Fixture
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd.selftest.readings import TOLERANCE
from etd_hal.boardfile import Source
from etd_hal.phase import PulseResult

_STEPS = 16
#: The deviation from the line, as a part of a step's own current.
LINEARITY = 0.03
SATURATES = (
    "the source saturates: check its mirror, and the rail under load; if a smaller first resistor"
    " gives more current, it is the rail"
)
#: The part of the compliance that the strongest pulse may need, by the board file and as measured.
#: The second is larger because the leak may be larger than the file says.
_HEADROOM_NAMED, _HEADROOM = 0.9, 0.95


@dataclass(frozen=True, slots=True)
class Rung:
    """The commanded current, and the one measured by the node's voltage."""

    commanded_ua: int
    made_ua: float
    shot: PulseResult


def largest_ohm(source: Source, most_ua: float, leak_ohm: float | None = None) -> int | None:
    """The largest load into which the source can drive this current; None: any load."""
    leak_ohm = leak_ohm or source.leak_ohm
    beside_ohm = source.compliance_v * _HEADROOM_NAMED / most_ua * 1e6
    return None if beside_ohm >= leak_ohm else int(1 / (1 / beside_ohm - 1 / leak_ohm))


def largest_here_ohm(fixture: Fixture, strongest_ua: int) -> int | None:
    """The same for this board, as it was measured."""
    return largest_ohm(fixture.file.source, strongest_ua * fixture.gain, fixture.leak_ohm)


def reachable_ua(fixture: Fixture, beside_ohm: float) -> int:
    """The current that this source can certainly drive into a load and its leak."""
    return int(fixture.file.source.compliance_v * _HEADROOM / (beside_ohm * fixture.gain) * 1e6)


def climb(
    fixture: Fixture,
    log: CheckLog,
    prober: Prober,
    load: DummyLoad,
    beside_ohm: float,
    most_ua: int,
) -> list[Rung]:
    """Steps to `most_ua`, or to one that fails. Raises: BusError, BoardFault, GuardRefusal."""
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
    """The tolerances of gain and linearity, the idle voltage allowed, and a step of the ADC."""
    reading_v = IDLE_V + fixture.file.source.node_uv_per_code / 1e6
    return (TOLERANCE + LINEARITY) * rung.commanded_ua + reading_v / beside_ohm * 1e6


def _judge_off(log: CheckLog, rung: Rung, step: int, slack_ua: float) -> None:
    """Too little current after good steps means saturation; anything else a wrong gain."""
    is_saturated = step > 1 and rung.made_ua < rung.commanded_ua
    log.judge(
        "linearity" if is_saturated else "steps",
        False,
        f"{rung.made_ua:.0f} uA instead of {rung.commanded_ua} uA at step {step} of {_STEPS};"
        " nothing stronger was fired",
        f"{rung.commanded_ua} +-{slack_ua:.0f} uA",
        SATURATES
        if is_saturated
        else "the source does not follow its command: check the DAC's reference and the mirror",
    )
