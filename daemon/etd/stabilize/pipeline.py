"""The place between what a frame wants and what the limits let through.

Owns: what a stabilizer gets and returns, how far it may go, and the order of the stabilizers.
Must not know: limits, hardware, clocks. What comes out of here is a request: the frame's bounds
(`PulseBounds`) and `safety/limits.py` clamp it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Literal, Protocol

import msgspec

ContactState = Literal["unknown", "open", "soft", "closed", "saturated", "shorted"]

#: No pulse is shorter.
SHORTEST_US = 20
#: Widths are requested in steps of this: prepared pulses stay few, and a width is compared with the
#: same width before (`safety/return_share.py`).
WIDTH_STEP_US = 5


class PulseRequest(msgspec.Struct, frozen=True, gc=False):
    """A requested pulse, and its prepulse, if any.

    To change a part and keep the others: `msgspec.structs.replace`.
    """

    current_ua: int
    width_us: int
    #: Directly before the pulse, in the same message, the same way; both 0: none.
    prepulse_ua: int = 0
    prepulse_us: int = 0

    @property
    def is_possible(self) -> bool:
        """Whether it is a pulse; anything else is an error of the stabilizer."""
        return (
            self.current_ua >= 0
            and self.width_us >= SHORTEST_US
            and 0 <= self.prepulse_ua <= self.current_ua
            and self.prepulse_us >= 0
        )

    @property
    def whole_us(self) -> int:
        """Both steps together."""
        return self.width_us + self.prepulse_us

    @property
    def charge_pc(self) -> int:
        """The charge of both steps."""
        return self.current_ua * self.width_us + self.prepulse_ua * self.prepulse_us

    def current_of(self, charge_pc: int) -> int:
        """The current, in uA, at which both steps together have this charge and no more."""
        if not self.current_ua or not self.prepulse_us:
            return charge_pc // self.width_us
        return charge_pc * self.current_ua // self.charge_pc

    def not_above(self, other: PulseRequest) -> PulseRequest:
        """This request with no part above the other's."""
        return PulseRequest(
            min(self.current_ua, other.current_ua),
            min(self.width_us, other.width_us),
            min(self.prepulse_ua, other.prepulse_ua),
            min(self.prepulse_us, other.prepulse_us),
        )

    def at(self, current_ua: int) -> PulseRequest:
        """The same at a lower current: the prepulse falls with it."""
        if current_ua == self.current_ua:
            return self
        prepulse_ua = self.prepulse_ua * current_ua // max(1, self.current_ua)
        return PulseRequest(current_ua, self.width_us, prepulse_ua, self.prepulse_us)


class ElectrodeEstimate(msgspec.Struct, frozen=True, gc=False):
    """What pulses, a calibration and sensors show of an electrode; None where unknown.

    `resistance_ohm` and `voltage_v` are the last pulse's, as measured. `skin_ohm` is the skin's
    resistance to a long pulse, from stimulus pulses alone, filtered, and None while it is rejected
    (see `sensing/impedance.py`). `latest_ohm` is that of the last pulse alone, unfiltered: a law
    that gives less by it gives less. `skin_at_ua` is the current of the pulse it was last measured
    with.
    """

    electrode: int
    is_touched: bool | None
    resistance_ohm: int | None
    voltage_v: float | None
    now_ns: int = 0
    state: ContactState = "unknown"
    #: How far a contact that was made anew has come: 0 just now, 1 for long.
    firmness: float = 1.0
    #: The current of the last pulse that the source could not deliver, until one is delivered.
    undelivered_ua: int | None = None
    skin_ohm: float | None = None
    latest_ohm: float | None = None
    skin_at_ua: int = 0
    #: The same as estimated from the beginning of pulses alone, filtered and of the last one; and
    #: whether `skin_ohm` is no more.
    early_ohm: float | None = None
    latest_early_ohm: float | None = None
    is_estimated: bool = False
    #: From the calibration: resistance then, at which current, and where feeling begins.
    reference_ohm: int | None = None
    reference_at_ua: int | None = None
    #: Whether it was made with pulses of which only the beginning is known.
    is_reference_early: bool = False
    threshold_ua: int | None = None
    #: Of the sensor under this electrode.
    pressure_kpa: float | None = None

    @property
    def higher_ohm(self) -> float | None:
        """Of `skin_ohm` and `latest_ohm`."""
        return higher(self.skin_ohm, self.latest_ohm)

    @property
    def higher_early_ohm(self) -> float | None:
        """Of `early_ohm` and `latest_early_ohm`."""
        return higher(self.early_ohm, self.latest_early_ohm)


def higher(mean_ohm: float | None, latest_ohm: float | None) -> float | None:
    """Of a mean and the last value, if there is one; None where there is no mean."""
    return mean_ohm if mean_ohm is None or latest_ohm is None else max(mean_ohm, latest_ohm)


class MaxGain(msgspec.Struct, frozen=True):
    """The largest factors of a stabilizer on a frame's pulse; 1: no more than the frame's."""

    current: float = 1.0
    width: float = 1.0
    charge: float = 1.0

    def then(self, other: MaxGain) -> MaxGain:
        """The factors of two stabilizers in a row."""
        return MaxGain(
            self.current * other.current, self.width * other.width, self.charge * other.charge
        )


NO_GAIN = MaxGain()


class PulseBounds(msgspec.Struct, frozen=True, gc=False):
    """The bounds of a frame for an electrode: no stabilizer's request goes beyond.

    `cap_us` is the width that a cap's current is taken for: the frame's, or that of the pulses that
    the cap was accepted with, if it is less. `width_us` is how wide its slot in the scan is, beside
    the `prepulse_us` that the body site leaves for a prepulse. `cap_led_part`: of a cap's current,
    what led into the pulses that it was accepted with; 0: they were plain ones. Current and charge
    are clamped, and reported, together with the limits (`safety/limits.py`).
    """

    current_ua: int
    cap_us: int
    width_us: int
    charge_pc: int
    prepulse_us: int = 0
    cap_led_part: float = 0.0

    def capped_pc(self, cap_ua: float) -> int:
        """The charge of a cap, with the prepulse of the pulses it was accepted with."""
        return int(cap_ua * self.cap_us) + int(cap_ua * self.cap_led_part) * self.prepulse_us

    def not_above(self, other: PulseBounds) -> PulseBounds:
        """These bounds, current, width and charge not above the other's."""
        return msgspec.structs.replace(
            self,
            current_ua=min(self.current_ua, other.current_ua),
            width_us=min(self.width_us, other.width_us),
            charge_pc=min(self.charge_pc, other.charge_pc),
        )

    def in_slot(self, request: PulseRequest) -> PulseRequest:
        """The request with no step wider than its slot."""
        if request.width_us <= self.width_us and request.prepulse_us <= self.prepulse_us:
            return request
        return PulseRequest(
            request.current_ua,
            min(request.width_us, self.width_us),
            request.prepulse_ua,
            min(request.prepulse_us, self.prepulse_us),
        )


class Stabilizer(Protocol):
    """A stabilizer. It keeps its own state between pulses, electrode by electrode."""

    @property
    def max_gain(self) -> MaxGain:
        """The most it can ever request: the plan keeps room for it, and no request goes beyond."""
        ...

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        """The pulse that this stabilizer requests, given the request of the one before.

        When what it needs is not known, that is `request` itself; a rise to it may take time.
        """
        ...

    def reset(self) -> None:
        """The supply was off: any contact may have changed."""
        ...


def adapt_all(
    stabilizers: Sequence[Stabilizer], request: PulseRequest, estimate: ElectrodeEstimate
) -> PulseRequest:
    """The request after all stabilizers, in the order of the body-site file."""
    for stabilizer in stabilizers:
        request = stabilizer.adapt(request, estimate)
    return request


def max_gain_of(stabilizers: Sequence[Stabilizer]) -> MaxGain:
    """The factors of all stabilizers together."""
    found = MaxGain()
    for stabilizer in stabilizers:
        found = found.then(stabilizer.max_gain)
    return found


def stepped_up_us(width_us: float) -> int:
    """The step at or above."""
    return math.ceil(width_us / WIDTH_STEP_US - 1e-9) * WIDTH_STEP_US
