"""From a width with decimals to one that is asked for, the charge kept.

Owns: the rounding that the laws by width share. Must not know: why a width is asked for.
"""

from __future__ import annotations

from dataclasses import replace

from etd.stabilize.pipeline import Wish, stepped_up_us


def held_us(wish: Wish, exact_us: float, narrowest_us: int, most_wider: float) -> int:
    """The step at or above, not beyond `most_wider`, and not below the narrowest (or what was
    wanted, if that is narrower).
    """
    widest_us = int(wish.width_us * most_wider)
    return max(min(narrowest_us, wish.width_us), min(stepped_up_us(exact_us), widest_us))


def as_charge(wish: Wish, exact_us: float, narrowest_us: int, most_wider: float) -> Wish:
    """The same charge as `exact_us` would have; the current makes up for the rounding, downward
    only.
    """
    width_us = held_us(wish, exact_us, narrowest_us, most_wider)
    current_ua = int(wish.current_ua * min(1.0, exact_us / width_us))
    return replace(wish, current_ua=current_ua, width_us=width_us)
