"""How steady it was: the figures of one run, or of several fingers together.

Owns: what each figure counts. Must not know: engines, bodies, tables.

A contact is firm when all of it lies on and has done so for `FIRM_S`. Felt strength is 1 at the
threshold and 0 below it; a scan in which a firm electrode is not felt counts as 0. An electrode
that is never felt has no variation over time: it counts among those not felt. Where none is ever
felt there is no variation at all (nan).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from bench.steady_run import Kept

FIRM_S = 1.0
#: After a contact is made anew, what is felt within this is the step: longer than any ramp takes,
#: the engine's own (about half a second) and the law's (`soften_ms`, one second) together.
STEP_S = 3.0
#: What is felt until a law has given back all that it held: told beside it, since putting off is no
#: merit. By then pressing has changed most.
LONG_STEP_S = 7.0
#: It is compared with what the same electrode is felt as, while it lies on firmly, so long before
#: and after; a return with less than `LEAST_STEADY_S` of that on either side is not judged.
STEADY_S, LEAST_STEADY_S = 10.0, 2.0
#: Of the steady strength: what a return may reach.
MOST_STEP = 1.2
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
    recontact_step: float | None
    recontact_step_mean: float | None
    #: How many of them are above 1.2.
    recontacts_above: int
    #: The same within `LONG_STEP_S`.
    recontacts_above_later: int
    #: Those that are judged, and those that are not: nothing steady enough to compare with.
    recontacts: int
    recontacts_not_judged: int
    scans: int
    #: The law goes by the person's k, and none may be used: these are the figures of no law.
    is_refused: bool = False


def figures(name: str, kept: Sequence[Kept]) -> SteadyFigures:
    """All fingers together."""
    over_time: list[float] = []
    over_electrodes: list[float] = []
    means: list[float] = []
    steps: list[float] = []
    later: list[float] = []
    shown = below = painful = firm_painful = scans = returns = 0
    most_pain = 0.0
    for run in kept:
        firm = firm_of(run)
        ever = firm.any(axis=0)
        felt = np.where(firm, run.felt, np.nan)[:, ever]
        mean = np.nanmean(felt, axis=0)
        is_felt = mean > 0.0
        over_time.extend(np.nanstd(felt, axis=0)[is_felt] / mean[is_felt])
        if is_felt.any():
            over_electrodes.append(float(mean.std() / mean.mean()))
        means.extend(mean)
        steps.extend(recontact_steps(run, firm, STEP_S))
        later.extend(recontact_steps(run, firm, LONG_STEP_S))
        returns += sum(1 for _ in _touched_again(run))
        touching = run.attached > 0.0
        shown += int(touching.sum())
        below += int((touching & (run.felt < 1.0)).sum())
        painful += int((run.pain >= 1.0).sum())
        firm_painful += int(((run.pain >= 1.0) & firm).sum())
        scans += run.felt.size
        most_pain = max(most_pain, float(run.pain.max()))
    return SteadyFigures(
        name=name,
        mean_felt=float(np.mean(means)),
        over_time=_mean(over_time),
        over_electrodes=_mean(over_electrodes),
        below_threshold=below / shown,
        above_pain=painful / scans,
        scans_above_pain=painful,
        firm_scans_above_pain=firm_painful,
        most_pain=most_pain,
        recontact_step=max(steps, default=None),
        recontact_step_mean=float(np.mean(steps)) if steps else None,
        recontacts_above=sum(step > MOST_STEP for step in steps),
        recontacts_above_later=sum(step > MOST_STEP for step in later),
        recontacts=len(steps),
        recontacts_not_judged=returns - len(steps),
        scans=scans,
    )


def _mean(values: Sequence[float]) -> float:
    return float(np.mean(values)) if values else math.nan


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


def recontact_steps(kept: Kept, firm: Mask, within_s: float) -> list[float]:
    """One for each return, where the electrode was felt at all while it lay on firmly."""
    found: list[float] = []
    for scan, electrode in _touched_again(kept):
        before, after = (
            kept.felt[_within(kept, scan, *span) & firm[:, electrode], electrode]
            for span in ((-STEADY_S, 0.0), (0.0, STEADY_S))
        )
        steady = np.concatenate([before, after])
        soon = kept.felt[_lying_on(kept, scan, electrode, within_s), electrode]
        least = LEAST_STEADY_S / _period_s(kept)
        if min(len(before), len(after)) >= least and steady.any():
            # At the threshold every other scan is felt, and half of a strength is none.
            found.append(float(soon.max() / np.median(steady[steady > 0.0])))
    return found


def _lying_on(kept: Kept, scan: int, electrode: int, within_s: float) -> slice:
    """The scans so soon after a touch, up to the one before which the contact comes off anew: what
    is felt then is of that peeling.
    """
    end = scan + int(_within(kept, scan, 0.0, within_s).sum())
    part = kept.attached[scan:end, electrode]
    leaving = np.flatnonzero(np.diff(part) < 0.0)
    return slice(scan, scan + max(1, int(leaving[0])) if len(leaving) else end)


def _period_s(kept: Kept) -> float:
    return float(np.median(np.diff(kept.inside_s)))


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
