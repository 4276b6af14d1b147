"""Which kinds of faults are played at an operation of a scene.

Owns: the choice among them, by words, by part of the whole, and by drawing pairs. Must not know:
which operations there are, how a case is played, what must hold.
"""

from __future__ import annotations

import itertools
import random
import zlib
from collections.abc import Sequence
from dataclasses import replace

from campaign import scenes
from campaign.judge import GUARDED, PAIR
from campaign.kind import Kind
from campaign.kinds import kinds_of
from campaign.operations import Port
from campaign.places import Chosen, Operation
from campaign.results import BENCH

#: Whose cases take long, and which have no link that a gateway could hang at.
LONG, _UNLINKED = (BENCH,), (BENCH, "power-up")


def kinds_in(board: str, scene: str) -> list[Kind]:
    return kinds_of(
        scenes.config(board).board, has_link=scene not in _UNLINKED, on_bench=scene == BENCH
    )


def is_asked_for(name: str, words: Sequence[str]) -> bool:
    return not words or any(text in name for text in words)


def classes_first_at(board: str, scene: str) -> set[str]:
    """Of which a part of the whole has at least one case here: all that come in the frames of a
    board with all guards, and in its self-test what comes in that alone.
    """
    if board != GUARDED or scene not in ("frames", BENCH):
        return set()
    in_frames = {kind.fault_class for kind in kinds_in(board, "frames")}
    here = {kind.fault_class for kind in kinds_in(board, scene)}
    return in_frames if scene == "frames" else here - in_frames


def takes(missing: set[str], kind: Kind) -> bool:
    """The first one of its class, which is not missing any more."""
    is_first = kind.fault_class in missing
    missing.discard(kind.fault_class)
    return is_first


def due_at(kinds: Sequence[Kind], number: int, port: Port, at: Chosen) -> list[Kind]:
    if number not in at.once and number not in at.staying:
        return []
    return [kind for kind in kinds if kind.applies(number, port, at)]


def one_of_each_class(kinds: Sequence[Kind], number: int) -> list[Kind]:
    """Of what happens once, in turn."""
    by_class: dict[str, list[Kind]] = {}
    for kind in kinds:
        if not kind.stays:
            by_class.setdefault(kind.fault_class, []).append(kind)
    turns = [variants[number % len(variants)] for variants in by_class.values()]
    return [*turns, *(kind for kind in kinds if kind.stays)]


def is_in(kind: Kind, number: int, part: int) -> bool:
    """Every so many-th case, the same each time."""
    return part == 1 or zlib.crc32(f"{kind.name} {number}".encode()) % part == 0


def pairs(
    scene: str,
    kinds: Sequence[Kind],
    others: Sequence[Kind],
    operations: Sequence[Operation],
    *,
    count: int,
    seed: int,
) -> dict[int, list[Kind]]:
    """So many, drawn: one of `kinds` and one of `others` at any two operations, the same with the
    same seed.
    """
    drawn: dict[int, list[Kind]] = {}
    dice = random.Random(f"{scene} {seed}")
    while kinds and sum(map(len, drawn.values())) < count:
        number = dice.randrange(len(operations))
        kind, then = dice.choice(kinds), dice.choice(others)
        after = dice.randrange(1, 400)
        if kind.may_come_at(operations[number].port):
            both = f"{kind.name}, then {then.name} after {after}"
            made = replace(kind, fault_class=PAIR, variant=both, then=then, then_after=after)
            drawn.setdefault(number, []).append(made)
    return drawn


def part_of_a_class(words: Sequence[str]) -> str:
    """The first class of which these words ask for a part, or nothing."""
    every = [
        kind for at in itertools.product(scenes.BOARDS, scenes.SCENES) for kind in kinds_in(*at)
    ]
    asked_for = {kind.fault_class for kind in every if is_asked_for(kind.name, words)}
    left_out = (kind.fault_class for kind in every if not is_asked_for(kind.name, words))
    return next((name for name in left_out if name in asked_for), "")
