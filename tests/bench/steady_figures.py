"""How steady it was: the figures of one run, or of several fingers together.

Owns: what each figure counts. Must not know: engines, bodies, tables.

A contact is firm when all of it lies on and has done so for `FIRM_S`. Felt strength is 1 at the
threshold and 0 below it; a scan in which a firm electrode is not felt counts as 0. An electrode
that is never felt has no variation over time: it counts among those not felt.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.steady_run import Kept

FIRM_S = 1.0
#: After a contact is made anew, what is felt within this is the step: it has its whole area after
#: a quarter of a second, and by the engine's own ramp most of its current after half of one.
STEP_S = 0.75
#: It is compared with what the same electrode is felt as, while it lies on firmly, so long before
#: and after.
STEADY_S = 10.0
Mask = NDArray[np.bool_]


@dataclass(frozen=True)
class SteadyFigures:
    """Of one set of stabilizers, all fingers together. Variations are std over mean."""

    name: str
    mean_felt: float
    over_time: float
    over_electrodes: float
    below_threshold: float
    above_pain: float
    scans_above_pain: int
    #: Of these, how many where the contact was firm: the others are at a peeling or a return.
    firm_scans_above_pain: int
    most_pain: float
    #: The most that is felt just after touching again, over the steady strength of the same
    #: electrode; the second: the mean over all such contacts.
    recontact_step: float
    recontact_step_mean: float
    recontacts: int
    scans: int


def figures(name: str, kept: Sequence[Kept]) -> SteadyFigures:
    """All fingers together."""
    over_time: list[float] = []
    over_electrodes: list[float] = []
    means: list[float] = []
    steps: list[float] = []
    shown = below = painful = firm_painful = scans = 0
    most_pain = 0.0
    for one in kept:
        firm = firm_of(one)
        ever = firm.any(axis=0)
        felt = np.where(firm, one.felt, np.nan)[:, ever]
        mean = np.nanmean(felt, axis=0)
        is_felt = mean > 0.0
        over_time.extend(np.nanstd(felt, axis=0)[is_felt] / mean[is_felt])
        over_electrodes.append(float(mean.std() / mean.mean()))
        means.extend(mean)
        steps.extend(recontact_steps(one, firm))
        touching = one.attached > 0.0
        shown += int(touching.sum())
        below += int((touching & (one.felt < 1.0)).sum())
        painful += int((one.pain >= 1.0).sum())
        firm_painful += int(((one.pain >= 1.0) & firm).sum())
        scans += one.felt.size
        most_pain = max(most_pain, float(one.pain.max()))
    return SteadyFigures(
        name=name,
        mean_felt=float(np.mean(means)),
        over_time=float(np.mean(over_time)),
        over_electrodes=float(np.mean(over_electrodes)),
        below_threshold=below / shown,
        above_pain=painful / scans,
        scans_above_pain=painful,
        firm_scans_above_pain=firm_painful,
        most_pain=most_pain,
        recontact_step=max(steps, default=0.0),
        recontact_step_mean=float(np.mean(steps)) if steps else 0.0,
        recontacts=len(steps),
        scans=scans,
    )


def firm_of(kept: Kept) -> Mask:
    """[scan, electrode]."""
    firm = np.zeros(kept.felt.shape, dtype=bool)
    since_s = np.full(kept.felt.shape[1], -np.inf)
    for scan, inside_s in enumerate(kept.inside_s):
        if scan == 0 or kept.piece[scan] != kept.piece[scan - 1]:
            since_s[:] = -np.inf
        whole = kept.attached[scan] >= 1.0
        since_s[~whole] = inside_s
        firm[scan] = whole & (inside_s - since_s >= FIRM_S)
    return firm


def recontact_steps(kept: Kept, firm: Mask) -> list[float]:
    """One for each return, where the electrode was felt at all while it lay on firmly."""
    found: list[float] = []
    for scan, electrode in _touched_again(kept):
        near = _within(kept, scan, -STEADY_S, STEADY_S)
        steady = kept.felt[near & firm[:, electrode], electrode]
        soon = kept.felt[_within(kept, scan, 0.0, STEP_S), electrode]
        if steady.any():
            # At the threshold every other scan is felt, and half of a strength is none.
            found.append(float(soon.max() / np.median(steady[steady > 0.0])))
    return found


def _touched_again(kept: Kept) -> Iterator[tuple[int, int]]:
    """(scan, electrode), for each return."""
    for scan in range(1, len(kept.felt)):
        if kept.piece[scan] == kept.piece[scan - 1]:
            again = (kept.attached[scan - 1] == 0.0) & (kept.attached[scan] > 0.0)
            yield from ((scan, int(electrode)) for electrode in np.flatnonzero(again))


def _within(kept: Kept, scan: int, from_s: float, to_s: float) -> Mask:
    """The scans of the same piece, so long after one of them."""
    after_s = kept.inside_s - kept.inside_s[scan]
    return np.asarray((kept.piece == kept.piece[scan]) & (after_s >= from_s) & (after_s <= to_s))
