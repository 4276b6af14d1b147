"""Whether answers do harm: what is not felt, and what is above pain, beside nothing said.

Owns: both bounds, and the bodies that have another one of pain where answers may raise, by name,
with how much, and why. Must not know: how answers are heeded, how it is shown.

The bounds are those of a law (`steady_harm`): 1.2 times what there is without, and nothing above
pain where there is nothing without. What ships, where answers only lower and give back, is held to
that of pain on every body. Where they may raise, the excluded bodies are why that is not how it
ships; they are held to a bound of their own, above what was seen.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf
from typing import NamedTuple

from bench.felt_compared import Compared, Figures, raising
from bench.run import Bound
from bench.steady_harm import MOST_TIMES
from etd_body.kinds import BodyKind

#: A part of the scans that nobody tells from none, in 0.1 % [design].
UNTOLD = 0.001
_RAISED = "what is raised against it comes nearer to pain, which does not"


class Exclusion(NamedTuple):
    """From the bound of pain: the most instead, in times of no answers', and why."""

    most_times: float
    why: str


#: Where answers may raise, and there is anything above pain without them.
EXCLUDED: dict[BodyKind, Exclusion] = {
    BodyKind.ADAPTING: Exclusion(4.0, f"touch adapts to use; {_RAISED}"),
    BodyKind.SOAKING: Exclusion(1.5, f"a soaking skin takes from what is felt; {_RAISED} soak"),
    BodyKind.TENDER: Exclusion(
        2.5, "pain begins just above the threshold; a common raise brings some over it"
    ),
    BodyKind.SWEAT: Exclusion(
        1.5, "few in all: an answer in error raises for a minute, when an edge peels"
    ),
}


def bounds(found: Sequence[Compared]) -> list[Bound]:
    """What must hold of what is not felt, and of pain."""
    return [_not_felt(each) for each in found] + [_above_pain(each) for each in found]


def excluded(found: Sequence[Compared]) -> list[str]:
    """A sentence for each body that is out of a bound, and excluded."""
    return [
        f"{each.body} is excluded{raising(each)}: scans above pain are"
        f" {each.said.scans_above_pain:.0f} with answers, {each.plain.scans_above_pain:.0f}"
        f" without, which is more than {MOST_TIMES:g} times as many, and at most"
        f" {EXCLUDED[each.body].most_times:g} may be: {EXCLUDED[each.body].why}."
        for each in found
        if is_out(each)
    ]


def is_out(each: Compared) -> bool:
    """Of the bound of pain that other bodies have."""
    return _is_excluded(each) and _pain_times(each) > MOST_TIMES


def _is_excluded(each: Compared) -> bool:
    return each.may_raise and each.body in EXCLUDED and _is_above(each.plain)


def _not_felt(each: Compared) -> Bound:
    what = f"{each.body}: not felt, of nothing said{raising(each)}"
    return _at_most(what, each.said.not_felt / max(each.plain.not_felt, UNTOLD), MOST_TIMES)


def _is_above(figures: Figures) -> bool:
    return figures.scans_above_pain > 0.0


def _above_pain(each: Compared) -> Bound:
    what = f"{each.body}: scans above pain, of nothing said{raising(each)}"
    most = EXCLUDED[each.body].most_times if _is_excluded(each) else MOST_TIMES
    return _at_most(what, _pain_times(each), most)


def _pain_times(each: Compared) -> float:
    said, plain = each.said.scans_above_pain, each.plain.scans_above_pain
    return said / plain if plain else inf if said else 1.0


def _at_most(what: str, value: float, most: float) -> Bound:
    return Bound(what, round(value, 3), most, is_met=value <= most)
