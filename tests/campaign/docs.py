"""What a run of the campaign says in docs/safety.md.

Owns: the part of the page between two marks, which is not written by hand. Must not know: how a
case is played, what must hold.
"""

from __future__ import annotations

import math
import textwrap
from collections.abc import Callable, Sequence
from typing import Any

from campaign.judge import GUARDED, RELAYS, Bound, bounds
from campaign.record import Line, played
from campaign.results import BENCH, CLONE, PC_PER_UC

PAGE = CLONE / "docs" / "safety.md"
_BEGIN, _END = "<!-- written by make campaign -->\n", "<!-- so far -->\n"
_NONE = "**none**"
#: Whose time a run is told in, whatever else the machine did beside it.
_PROCESSORS = 2
COLUMNS = (
    *("fault", "told by", "cases", "told", "latent", "silent"),
    *("ms to safe, p50", "most", "uC, electrode", "uC, return"),
)
#: Which boards a table shows side by side.
_TABLES = (("kajimoto-hv507", GUARDED), (RELAYS,), (BENCH,))


def cells(rows: Sequence[Line | None], bound: Bound) -> tuple[str, ...]:
    """Of a class, in the order of `COLUMNS`: the figures of each board, one beside the other."""

    def each(figure: Callable[[Line], str]) -> str:
        return " / ".join("-" if row is None else figure(row) for row in rows)

    there = [row for row in rows if row is not None]
    return (
        there[0].fault_class,
        " / ".join(dict.fromkeys("; ".join(bound.rows_on(row.on)) or _NONE for row in there)),
        each(lambda row: str(row.cases)),
        each(lambda row: str(row.told)),
        each(lambda row: str(row.latent)),
        each(lambda row: str(row.silent)),
        each(lambda row: _ms(row.safe_p50_ms)),
        each(lambda row: _ms(row.safe_most_ms)),
        each(lambda row: f"{row.most_alone_uc:.3f}"),
        each(lambda row: f"{row.most_shared_uc:.3f}"),
    )


def _table(lines: Sequence[Line], boards: Sequence[str]) -> list[tuple[str, ...]]:
    """A row for each class that one of these boards can have."""
    at = {(line.on, line.fault_class): line for line in lines}
    names = dict.fromkeys(line.fault_class for line in lines if line.on in boards)
    known = bounds()
    return [
        cells([at.get((board, name)) for board in boards], known.get(name, Bound()))
        for name in sorted(names, key=list(known).index if set(names) <= set(known) else None)
    ]


def tables(lines: Sequence[Line]) -> list[tuple[str, list[tuple[str, ...]]]]:
    """Titles, and rows: first those with the pulses of most scenes."""
    made = []
    for pulse_pc in sorted({line.pulse_pc for line in lines}):
        those = [line for line in lines if line.pulse_pc == pulse_pc]
        for boards in _TABLES:
            if shown := [board for board in boards if any(line.on == board for line in those)]:
                names = " / ".join(f"`{board}`" for board in shown)
                cases = sum(line.cases for line in those if line.on in shown)
                title = f"On {names}, pulses of {pulse_pc / PC_PER_UC:.3f} uC, {cases} cases"
                made.append((title, _table(those, shown)))
    return made


def _ms(time_ms: float | None) -> str:
    return "-" if time_ms is None else f"{time_ms:.1f}"


def said(lines: Sequence[Line]) -> str:
    """By which version and when each part was played: the largest is all that is not named."""
    first, *later = played(lines)
    sentences = [f"{first['how']}: {_by(first)}."]
    for part in later:
        sentences.append(f"{_by(part)}, {_changed(first, part)}: {'; '.join(part['classes'])}.")
    return " ".join(sentences)


def of_selftests(lines: Sequence[Line]) -> str:
    """How many a self-test does not tell. Empty where none was played."""
    those, known = [line for line in lines if line.on == BENCH], bounds()
    silent = sum(line.silent for line in those)
    untold = sum(
        line.silent for line in those if not known.get(line.fault_class, Bound()).rows_on(BENCH)
    )
    if not those:
        return ""
    return (
        f"Of {sum(line.cases for line in those)} self-tests {silent} were silent, {untold} of them"
        f" of classes with {_NONE} in their row."
    )


def of_silence(lines: Sequence[Line]) -> str:
    """How many were silent of classes that something tells there, and of how much. Empty where none
    was.
    """
    known = bounds()
    told = [one for one in lines if known.get(one.fault_class, Bound()).rows_on(one.on)]
    silent = [one for one in told if one.silent]
    if not silent:
        return ""

    at_person = [one for one in silent if one.on != BENCH]
    at_bench = [one for one in silent if one.on == BENCH]
    most = [
        f"{_most_uc(those)}{where}"
        for those, where in ((at_person, ""), (at_bench, " in a self-test"))
        if those
    ]
    return (
        f"Of classes that something tells {sum(one.silent for one in silent)} of"
        f" {sum(one.cases for one in told)} cases were silent: {', and '.join(most)}."
    )


def _most_uc(those: Sequence[Line]) -> str:
    """The largest that was silent."""
    kept = [one.silent_most_uc for one in those if one.silent_most_uc is not None]
    if len(kept) < len(those):
        return f"{sum(one.silent for one in those)} of them of a size that was not kept"
    return f"{sum(one.silent for one in those)} of them of {max(kept):.3f} uC at most"


def _by(part: dict[str, Any]) -> str:
    taken = part["processor_s"]
    took = f" ({_in_hours(taken / _PROCESSORS)} of {_PROCESSORS} processors)" if taken else ""
    return f"{part['cases']} cases by {part['version']} on {part['day']}{took}"


def _in_hours(taken_s: float) -> str:
    hours, minutes = divmod(math.ceil(taken_s / 60), 60)
    return f"{hours} h {minutes} min" if hours else f"{minutes} min"


def _changed(first: dict[str, Any], part: dict[str, Any]) -> str:
    return "in the same way" if part["how"] == first["how"] else part["how"].lower()


def write(lines: Sequence[Line]) -> None:
    """Raises: ValueError, where the marks are not there."""
    text = PAGE.read_text(encoding="utf-8")
    before, has_begin, rest = text.partition(_BEGIN)
    _, has_end, after = rest.partition(_END)
    if not (has_begin and has_end):
        raise ValueError(f"{PAGE} has lost its marks: {_BEGIN!r} and {_END!r}")
    PAGE.write_text(before + _BEGIN + _part(lines) + _END + after, encoding="utf-8")


def _part(lines: Sequence[Line]) -> str:
    text = ["", *_folded(f"{said(lines)} {of_selftests(lines)} {of_silence(lines)}".strip())]
    for title, rows in tables(lines):
        text += [f"\n{title}:\n"]
        text += ["| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
        text += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([*text, "", ""])


def _folded(text: str) -> list[str]:
    return textwrap.wrap(text, 118, break_on_hyphens=False)
