"""At which operations of a scene faults are put in: all, or those that are not the same case again.

Owns: what makes two operations the same case, and the choice. Must not know: faults, scenes.

A scene has tens of thousands of operations, most of them bits of a chain. Two are the same case
where the same calls of the same lines of code have led to the same port: the engine is in the same
state of its program, and what stands on the wires differs in which bit of a word, which electrode,
or which scan it is. Of each such place the first, the second and the last operation are taken, and
as many between as are asked for, evenly. Pairs of faults come at any operation.
"""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from types import CodeType

from campaign.operations import Port


@dataclass(frozen=True, slots=True)
class Operation:
    port: Port
    #: The calls that have led to it, and the outermost of these: a stage of a self-test.
    place: int
    part: int


#: Fewer than these are one, in the middle.
_FEWEST = 3
#: So many calls tell a part of a scene.
_OUTERMOST = 4


def operation(port: Port, inside: CodeType) -> Operation:
    """With the calls that have led here, from the function with this code on."""
    found = []
    frame = sys._getframe(1)
    while frame is not None and frame.f_code is not inside:
        found.append((frame.f_code.co_filename, frame.f_code.co_name, frame.f_lineno))
        frame = frame.f_back  # type: ignore[assignment]
    return Operation(port, hash(tuple(found)), hash(tuple(found[-_OUTERMOST:])))


@dataclass(frozen=True, slots=True)
class Chosen:
    """Numbers of operations."""

    #: For what happens once.
    once: frozenset[int]
    #: For what stays: it is the same fault between two of these.
    staying: frozenset[int]
    #: Of what is in `staying`, the first and the last message of one place, by either: what stays
    #: is put in at one of both, by lot.
    ends: Mapping[int, tuple[int, int]]
    #: Of these one of each part: for what stays and no message of the program meets.
    parts: frozenset[int]


def chosen(
    operations: Sequence[Operation],
    each: int | None,
    *,
    had: Collection[tuple[Port, int]] = (),
    is_long: bool = False,
) -> Chosen:
    """`each`: at most so many of one place; None: all operations. What stays is put in at the first
    or the last of these where they are messages, and at one other of each part. `had`: ports and
    places that another scene has had. `is_long`: of a scene whose cases take long, what happens
    once is put in at one operation of a place, and what stays at one of each part.
    """
    if each is None:
        every = frozenset(range(len(operations)))
        return Chosen(every, every, {}, every)
    by_place: dict[Operation, list[int]] = {}
    for number, found in enumerate(operations):
        by_place.setdefault(found, []).append(number)
    once: set[int] = set()
    staying: set[int] = set()
    ends: dict[int, tuple[int, int]] = {}
    parts: dict[int, int] = {}
    for found, numbers in by_place.items():
        if (found.port, found.place) in had:
            continue
        taken = _spread(numbers, 1 if is_long else each)
        once.update(taken)
        if found.port == "spi" and not is_long:
            # From the first one on it meets the second as well.
            both = taken[0], taken[-1]
            staying.update(both)
            ends |= dict.fromkeys(both, both)
        elif found.part not in parts:
            parts[found.part] = taken[len(taken) // 2]
    staying.update(parts.values())
    return Chosen(frozenset(once), frozenset(staying), ends, frozenset(parts.values()))


def _spread(numbers: Sequence[int], count: int) -> list[int]:
    """The first, the second and the last, and evenly between them."""
    if len(numbers) <= count:
        return list(numbers)
    if count < _FEWEST:
        return [numbers[len(numbers) // 2]]
    last = len(numbers) - 1
    steps = count - 2
    return sorted(
        {numbers[0], *(numbers[1 + round(at * (last - 1) / steps)] for at in range(steps + 1))}
    )
