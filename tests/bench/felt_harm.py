"""Whether answers do harm: what is not felt, and what is above pain, beside nothing said.

Owns: both bounds, and the bodies that the one of pain is not asked of, by name, and why. Must not
know: how answers are heeded, how it is shown.

The bounds are those of a law (`steady_harm`): 1.2 times what there is without, and nothing above
pain where there is nothing without. The latter is asked of every body.
"""

from __future__ import annotations

from collections.abc import Sequence
from math import inf

from bench.felt_compared import Compared, Figures
from bench.run import Bound
from bench.steady_harm import MOST_TIMES
from etd_body.kinds import BodyKind

#: A part of the scans that nobody tells from none, in 0.1 % [design].
UNTOLD = 0.001
_RAISED = "what is raised against it comes nearer to pain, which does not"
#: Where scans above pain may be more than 1.2 times those without answers, and why.
EXCLUDED: dict[BodyKind, str] = {
    BodyKind.ADAPTING: f"touch adapts to use; {_RAISED}",
    BodyKind.TENDER: "pain begins just above the threshold; a common raise brings some over it",
    BodyKind.SWEAT: "few in all: an answer in error raises for a minute, when an edge peels",
}


def bounds(found: Sequence[Compared]) -> list[Bound]:
    """What must hold, on every body but for the excluded ones."""
    asked = [each for each in found if each.body not in EXCLUDED or not _is_above(each.plain)]
    return [_not_felt(each) for each in found] + [_above_pain(each) for each in asked]


def excluded(found: Sequence[Compared]) -> list[str]:
    """A sentence for each body that is out of the bound of pain, and excluded."""
    return [
        f"{each.body} is excluded: scans above pain are {each.said.scans_above_pain:.0f} with"
        f" answers, {each.plain.scans_above_pain:.0f} without, which is more than"
        f" {MOST_TIMES:g} times as many: {EXCLUDED[each.body]}."
        for each in found
        if each.body in EXCLUDED and _is_above(each.plain) and _pain_times(each) > MOST_TIMES
    ]


def _not_felt(each: Compared) -> Bound:
    times = each.said.not_felt / max(each.plain.not_felt, UNTOLD)
    return _at_most(f"{each.body}: not felt, of nothing said", times)


def _is_above(figures: Figures) -> bool:
    return figures.scans_above_pain > 0.0


def _above_pain(each: Compared) -> Bound:
    return _at_most(f"{each.body}: scans above pain, of nothing said", _pain_times(each))


def _pain_times(each: Compared) -> float:
    said, plain = each.said.scans_above_pain, each.plain.scans_above_pain
    return said / plain if plain else inf if said else 1.0


def _at_most(what: str, value: float) -> Bound:
    return Bound(what, round(value, 3), MOST_TIMES, is_met=value <= MOST_TIMES)
