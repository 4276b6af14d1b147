"""A requested pulse, the bounds of a frame for it, and how far a stabilizer may go beyond.

Owns: these three, and the steps of a width. Must not know: who requests it, limits, hardware.
"""

from __future__ import annotations

import math
from typing import Final

#: No pulse is shorter.
SHORTEST_US = 20
#: Widths are requested in steps of this: prepared pulses stay few, and a width is compared with the
#: same width before (`safety/return_share.py`).
WIDTH_STEP_US = 5


class PulseRequest:
    """A requested pulse, and its prepulse, if any."""

    __slots__ = ("current_ua", "prepulse_ua", "prepulse_us", "width_us")

    def __init__(
        self, current_ua: int, width_us: int, prepulse_ua: int = 0, prepulse_us: int = 0
    ) -> None:
        self.current_ua: Final = current_ua
        self.width_us: Final = width_us
        #: Directly before the pulse, in the same message, the same way; both 0: none.
        self.prepulse_ua: Final = prepulse_ua
        self.prepulse_us: Final = prepulse_us

    def __repr__(self) -> str:
        parts = self.current_ua, self.width_us, self.prepulse_ua, self.prepulse_us
        return f"PulseRequest{parts}"

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, PulseRequest)
            and self.current_ua == other.current_ua
            and self.width_us == other.width_us
            and self.prepulse_ua == other.prepulse_ua
            and self.prepulse_us == other.prepulse_us
        )

    @property
    def is_possible(self) -> bool:
        """Whether it is a pulse; anything else is an error of the stabilizer."""
        return (
            self.current_ua >= 0
            and self.width_us >= SHORTEST_US
            and 0 <= self.prepulse_ua <= self.current_ua
            and self.prepulse_us >= 0
        )

    def stepped(self, current_ua: int, width_us: int) -> PulseRequest:
        """The same with another step after the prepulse."""
        return PulseRequest(current_ua, width_us, self.prepulse_ua, self.prepulse_us)

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


class MaxGain:
    """The largest factors of a stabilizer on a frame's pulse; 1: no more than the frame's."""

    __slots__ = ("charge", "current", "width")

    def __init__(self, current: float = 1.0, width: float = 1.0, charge: float = 1.0) -> None:
        self.current: Final = current
        self.width: Final = width
        self.charge: Final = charge

    def then(self, other: MaxGain) -> MaxGain:
        """The factors of two stabilizers in a row."""
        return MaxGain(
            self.current * other.current, self.width * other.width, self.charge * other.charge
        )


NO_GAIN = MaxGain()


class PulseBounds:
    """The bounds of a frame for an electrode: no stabilizer's request goes beyond.

    `cap_us` is the width that a cap's current is taken for: the frame's, or that of the pulses that
    the cap was accepted with, if it is less. `width_us` is how wide its slot in the scan is, beside
    the `prepulse_us` that the body site leaves for a prepulse. `cap_led_part`: of a cap's current,
    what led into the pulses that it was accepted with; 0: they were plain ones. Current and charge
    are clamped, and reported, together with the limits (`safety/limits.py`). `raised_ua` and
    `raised_pc`: what they may rise to by the person's word; 0: not at all.
    """

    __slots__ = (
        "cap_led_part",
        "cap_us",
        "charge_pc",
        "current_ua",
        "prepulse_us",
        "raised_pc",
        "raised_ua",
        "width_us",
    )

    def __init__(
        self,
        current_ua: int,
        cap_us: int,
        width_us: int,
        charge_pc: int,
        prepulse_us: int = 0,
        cap_led_part: float = 0.0,
        raised_ua: int = 0,
        raised_pc: int = 0,
    ) -> None:
        self.current_ua: Final = current_ua
        self.cap_us: Final = cap_us
        self.width_us: Final = width_us
        self.charge_pc: Final = charge_pc
        self.prepulse_us: Final = prepulse_us
        self.cap_led_part: Final = cap_led_part
        self.raised_ua: Final = raised_ua
        self.raised_pc: Final = raised_pc

    @property
    def may_be_raised(self) -> bool:
        """By the person's word."""
        return self.raised_ua > 0

    def capped_pc(self, cap_ua: float) -> int:
        """The charge of a cap, with the prepulse of the pulses it was accepted with."""
        return int(cap_ua * self.cap_us) + int(cap_ua * self.cap_led_part) * self.prepulse_us

    def not_above(self, other: PulseBounds) -> PulseBounds:
        """These bounds, current, width and charge not above the other's."""
        return PulseBounds(
            min(self.current_ua, other.current_ua),
            self.cap_us,
            min(self.width_us, other.width_us),
            min(self.charge_pc, other.charge_pc),
            self.prepulse_us,
            self.cap_led_part,
            min(self.raised_ua, other.raised_ua),
            min(self.raised_pc, other.raised_pc),
        )

    def raised(self, factor: float) -> PulseBounds:
        """These bounds, current and charge so much higher where they may rise."""
        return PulseBounds(
            max(self.current_ua, min(int(self.current_ua * factor), self.raised_ua)),
            self.cap_us,
            self.width_us,
            max(self.charge_pc, min(int(self.charge_pc * factor), self.raised_pc)),
            self.prepulse_us,
            self.cap_led_part,
        )

    def no_wider(self, width_us: int) -> PulseBounds:
        """These bounds, with a slot of this width."""
        return PulseBounds(
            self.current_ua,
            self.cap_us,
            width_us,
            self.charge_pc,
            self.prepulse_us,
            self.cap_led_part,
            self.raised_ua,
            self.raised_pc,
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


def stepped_up_us(width_us: float) -> int:
    """The step at or above."""
    return math.ceil(width_us / WIDTH_STEP_US - 1e-9) * WIDTH_STEP_US
