"""One phase of a pulse: ready to be sent, and what came of it.

Owns: these two records, which board and daemon share. Must not know: how a phase is made, sent or
limited.
"""

from __future__ import annotations

from typing import Final

from etd_hal.ports import Message
from etd_hal.timing import Shape


class Pulse:
    """A phase, ready to be sent; `commanded_ua` is the current of its code, `prepulse_ua` that of
    the code before it (0: there is none).
    """

    __slots__ = (
        "code",
        "commanded_ua",
        "commanded_us",
        "message",
        "planned_ns",
        "prepulse_ua",
        "shape",
    )

    def __init__(
        self,
        commanded_ua: int,
        code: int,
        shape: Shape,
        message: Message,
        planned_ns: int,
        commanded_us: float,
        prepulse_ua: int = 0,
    ) -> None:
        self.commanded_ua: Final = commanded_ua
        self.code: Final = code
        self.shape: Final = shape
        self.message: Final = message
        self.planned_ns: Final = planned_ns
        #: Its width as reported, rounded to hundredths.
        self.commanded_us: Final = commanded_us
        self.prepulse_ua: Final = prepulse_ua


class PulseResult:
    """The result of a phase.

    `baseline_v` is the node's voltage before the pulse, `early_v` 10 us after its beginning,
    `voltage_v` near its end, or the early one again where the pulse is too short for an end sample.
    `excess_ns` is by how much the call was longer than planned.
    """

    __slots__ = ("baseline_v", "begun_ns", "early_v", "ended_ns", "excess_ns", "voltage_v")

    def __init__(
        self,
        begun_ns: int,
        ended_ns: int,
        excess_ns: int,
        baseline_v: float,
        voltage_v: float,
        early_v: float,
    ) -> None:
        self.begun_ns: Final = begun_ns
        self.ended_ns: Final = ended_ns
        self.excess_ns: Final = excess_ns
        self.baseline_v: Final = baseline_v
        self.voltage_v: Final = voltage_v
        self.early_v: Final = early_v
