"""The random order of a calibration: whose turn it is, and which trials are silent.

Owns: the draws. Must not know: procedures, currents, answers.

Each draw follows from the seed and the number of the trial alone: an interrupted calibration
continues in the order that it had, and can be repeated from its seed. A calibration of before there
was a seed has None: it continues as it began, one electrode after another, without silent trials.
"""

from __future__ import annotations

import random
from collections.abc import Collection

#: One trial of so many is a catch trial: silent, at a random place among them.
CATCH_IN = 8
#: So many electrodes are in play at once. More would hide the order better, but their thresholds
#: drift apart in the meantime, and an interruption would lose more.
IN_PLAY = 4
#: After so many electrodes, or half of them, the first one is asked again; with `equalize` it is
#: the reference, after so many.
CHECK_EACH = 8


def is_catch(seed: int | None, trial: int) -> bool:
    """`trial` counts from 0, catch trials included."""
    if seed is None:
        return False
    block, place = divmod(trial, CATCH_IN)
    return random.Random(f"catch {seed} {block}").randrange(CATCH_IN) == place


def shuffled(seed: int | None, electrodes: int, wanted: Collection[int]) -> list[int]:
    """Those of the array's electrodes that are wanted."""
    order = list(range(electrodes))
    if seed is not None:
        random.Random(f"order {seed}").shuffle(order)
    return [electrode for electrode in order if electrode in wanted]


def is_reference_last(seed: int | None, electrode: int, comparison: int) -> bool:
    """Of two comparisons of an electrode with the reference one begins with the electrode: what
    comes second is felt differently. `comparison` counts from 0.
    """
    if seed is None:
        return False
    pair, place = divmod(comparison, 2)
    return random.Random(f"pair {seed} {electrode} {pair}").randrange(2) == place


def is_silence_first(seed: int | None, trial: int) -> bool:
    """Of a silent comparison, which is none of those pairs: the reference comes after it."""
    return random.Random(f"silence {seed} {trial}").randrange(2) == 0


def drawn(seed: int | None, trial: int, in_play: Collection[int]) -> int:
    """The electrode of this trial."""
    if seed is None:
        return min(in_play)
    return random.Random(f"next {seed} {trial}").choice(sorted(in_play))
