"""The part of all that each return of a star conducts, from the paths of pulses through all others.

Owns: the likely part of each contact, and the most that it may be. Must not know: which electrodes
touch, how a path is read, what flows.

Each path is a contact, and all others in parallel behind it. With the part x that a contact has of
all conductances together,

    scale / path = x (1 - x),    the sum of all x = 1,

so the paths alone tell all parts, and what is common to all paths cancels. Of the two x that a path
allows only one contact can have the larger one: it conducts more than all others together.

A contact has the most where its path resists the least that it may, and all others the most. The
bounds of each contact by itself (`conductance.py`) are wider: each may have what the paths of all
others contradict.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

#: Of a root, by halves: nearer than any path is known.
_HALVES = 20
#: Of one by its slope, in steps; up to where that is not too steep; and what rounding leaves there.
_STEPS, _FLAT, _ALMOST = 3, 0.24, 1e-9


def likely_parts(through_s: Sequence[float]) -> list[float]:
    """`through_s`: what each path conducts, in S."""
    best = max(range(len(through_s)), key=through_s.__getitem__)
    part, scale = _most_part(through_s, best)
    if part == 1.0:
        # No star has such paths, or any has, of two.
        whole_s = sum(through_s)
        return [one_s / whole_s for one_s in through_s]
    return [part if one == best else _lesser(scale * s) for one, s in enumerate(through_s)]


def most_parts(least_s: Sequence[float], most_s: Sequence[float]) -> list[float]:
    """`least_s`, `most_s`: what each path conducts, in S, at least and at most (maybe inf)."""
    best = max(range(len(least_s)), key=least_s.__getitem__)
    part, scale = _most_part(least_s, best)
    # Of all parts together, by the scale: they rise faster than that, so that less is too much.
    slope = sum([0.5 * s / _root_of(scale * s) for s in least_s]) if part < 0.5 else math.inf
    found = []
    for one, most_own_s in enumerate(most_s):
        near = _near(least_s[one], most_own_s, scale, slope)
        if near is None:
            others_s = [*least_s[:one], most_own_s, *least_s[one + 1 :]]
            near = _most_part(others_s, one)[0]
        found.append(near)
    return found


def _near(own_s: float, most_own_s: float, scale: float, slope: float) -> float | None:
    """Hardly more than the most that one may have, for as much as some steps of a root cost; None
    where it, or another one, may have nearly half of all.
    """
    if slope == math.inf:
        return None
    if most_own_s <= 0.0:
        return 0.0
    now = min(scale, _FLAT / most_own_s)
    for _ in range(_STEPS):
        below, above = _root_of(now * own_s), _root_of(now * most_own_s)
        # All parts together beyond 1, and how fast that rises, ever faster: no step goes too far.
        beyond = slope * (now - scale) + below - above
        if beyond < -_ALMOST:
            return None
        now -= beyond / (slope - 0.5 * own_s / below + 0.5 * most_own_s / above)
    return _lesser(now * most_own_s)


def _most_part(through_s: Sequence[float], one: int) -> tuple[float, float]:
    """The most that `one` may have, where the others conduct so or better, and the scale then."""
    own_s, others_s = through_s[one], sum(through_s) - through_s[one]
    if own_s >= others_s or own_s == math.inf:
        return 1.0, 0.0
    best_s = max(through_s)
    most = 0.25 / best_s
    if _whole(through_s, most) >= 1.0:
        scale = _root(lambda scale: 1.0 - _whole(through_s, scale), most)
        return _lesser(scale * own_s), scale
    if own_s < best_s:
        # Another one has half of all or more.
        return _lesser(most * own_s), most
    # It has the larger part: its lesser one is what all others have together.
    scale = _root(lambda scale: _whole(through_s, scale) - 2.0 * _lesser(scale * own_s), most)
    return 1.0 - _lesser(scale * own_s), scale


def _lesser(scaled: float) -> float:
    """The lesser x of x (1 - x) = `scaled`."""
    return 0.5 - _root_of(scaled)


def _root_of(scaled: float) -> float:
    """How far both x lie off a half."""
    return math.sqrt(max(0.0, 0.25 - scaled))


def _whole(through_s: Sequence[float], scale: float) -> float:
    return sum([_lesser(scale * one_s) for one_s in through_s])


def _root(falling: Callable[[float], float], most: float) -> float:
    """Between 0 and `most`, of what is above 0 before it."""
    low, high = 0.0, most
    for _ in range(_HALVES):
        middle = 0.5 * (low + high)
        if falling(middle) > 0.0:
            low = middle
        else:
            high = middle
    return high
