"""From a width with decimals to one that is asked for, the charge kept.

Owns: the rounding that the laws by width share. Must not know: why a width is asked for.
"""

from __future__ import annotations

from etd.pulse.request import PulseRequest, stepped_up_us


def held_us(request: PulseRequest, exact_us: float, min_width_us: int, max_widening: float) -> int:
    """The step at or above, not beyond `max_widening`, and not below the narrowest (or what was
    wanted, if that is narrower).
    """
    widest_us = int(request.width_us * max_widening)
    return max(min(min_width_us, request.width_us), min(stepped_up_us(exact_us), widest_us))


def as_charge(
    request: PulseRequest, exact_us: float, min_width_us: int, max_widening: float
) -> PulseRequest:
    """The charge of `exact_us`; the current makes up for the rounding, downward only."""
    width_us = held_us(request, exact_us, min_width_us, max_widening)
    current_ua = int(request.current_ua * min(1.0, exact_us / width_us))
    return request.stepped(current_ua, width_us)
