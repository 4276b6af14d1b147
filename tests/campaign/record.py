"""What the page has of each class, kept in the clone with the version and day of its playing.

Owns: that file, a line for each class on each board, what a run puts into it, and what it comes to.
A class that was played anew takes the place of what was there, so that a part of the campaign can
be played after a change and the rest says when it was. Must not know: how a case is played, what
must hold, how a table looks.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import msgspec

from campaign.case import Outcome
from campaign.results import PC_PER_UC, Figures, figures, where_of

FILE = Path(__file__).with_name("recorded.jsonl")


class Line(Figures, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Of a class on a board, or on the bench of a self-test."""

    on: str
    pulse_pc: int
    #: As git describes them, and in UTC; more than one where a run went on after its code was
    #: committed, or after midnight.
    version: str
    day: str
    #: Of the operations: which were taken.
    how: str

    @property
    def most_uc(self) -> float:
        return max(self.most_alone_uc, self.most_shared_uc)


def lines_of(found: Iterable[Outcome], how: str) -> list[Line]:
    """By board, by strength of the pulses, and by class, in the order in which they are met."""
    by_table: dict[tuple[str, int], list[Outcome]] = {}
    for one in found:
        by_table.setdefault((where_of(one), one.pulse_pc), []).append(one)
    return [
        _line(on, pulse_pc, row, [one for one in ones if one.fault_class == row.fault_class], how)
        for (on, pulse_pc), ones in by_table.items()
        for row in figures(ones)
    ]


def _line(on: str, pulse_pc: int, row: Figures, those: Sequence[Outcome], how: str) -> Line:
    return Line(
        **msgspec.structs.asdict(row),
        on=on,
        pulse_pc=pulse_pc,
        version=", ".join(sorted({one.version for one in those})),
        day=", ".join(sorted({one.played.partition(" ")[0] for one in those})),
        how=how,
    )


def recorded(path: Path = FILE) -> list[Line]:
    """Raises: OSError, msgspec.ValidationError."""
    return msgspec.json.Decoder(Line).decode_lines(path.read_bytes())


def record(lines: Sequence[Line], path: Path = FILE) -> None:
    encode = msgspec.json.Encoder().encode
    path.write_bytes(b"".join(encode(line) + b"\n" for line in lines))


def merged(before: Sequence[Line], new: Sequence[Line]) -> list[Line]:
    """A new line in the place of the one of its class there, or else at the end."""
    by_key = {_key(line): line for line in before} | {_key(line): line for line in new}
    return list(by_key.values())


def _key(line: Line) -> tuple[str, int, str]:
    return line.on, line.pulse_pc, line.fault_class


def in_all(lines: Sequence[Line]) -> list[dict[str, Any]]:
    """Of each table all of it, in one row."""
    tables = sorted({(line.on, line.pulse_pc) for line in lines})
    return [_sum(*at, [one for one in lines if (one.on, one.pulse_pc) == at]) for at in tables]


def _sum(on: str, pulse_pc: int, those: Sequence[Line]) -> dict[str, Any]:
    counts = ("cases", "told", "latent", "silent", "crashed")
    slowest_ms = [one.safe_most_ms for one in those if one.safe_most_ms is not None]
    return {
        "on": on,
        "pulse_uc": pulse_pc / PC_PER_UC,
        **{count: sum(getattr(one, count) for one in those) for count in counts},
        "safe_most_ms": max(slowest_ms, default=None),
        "most_alone_uc": max(one.most_alone_uc for one in those),
        "most_shared_uc": max(one.most_shared_uc for one in those),
    }


def played(lines: Sequence[Line]) -> list[dict[str, Any]]:
    """By whom and when: the largest part first, with all classes that later ones do not name. What
    has played all there is on a board, or on the bench, names that.
    """
    parts: dict[tuple[str, str, str], list[Line]] = {}
    for line in lines:
        parts.setdefault((line.version, line.day, line.how), []).append(line)
    found: list[dict[str, Any]] = [
        {
            "version": version,
            "day": day,
            "how": how,
            "cases": sum(one.cases for one in those),
            "processor_s": round(sum(one.processor_s for one in those)),
            "classes": _played_by(those, lines),
        }
        for (version, day, how), those in parts.items()
    ]
    first, *later = sorted(found, key=lambda part: -part["cases"])
    return [{**first, "classes": ["all others" if later else "all"]}, *later]


def _played_by(those: Sequence[Line], lines: Sequence[Line]) -> list[str]:
    """Its classes; or where they are, if nothing else is there."""
    where = {one.on for one in those}
    if sum(line.on in where for line in lines) == len(those):
        return [f"all of {on}" for on in sorted(where)]
    return list(dict.fromkeys(one.fault_class for one in those))
