"""What a run of the campaign says in docs/safety.md.

Owns: the part of the page between two marks, which is not written by hand. Must not know: how a
case is played, what must hold.
"""

from __future__ import annotations

import textwrap
from collections import Counter
from collections.abc import Callable, Sequence

from campaign.case import Outcome
from campaign.judge import BENCH, GUARDED, RELAYS, Bound, bounds, where_of
from campaign.results import CLONE, PC_PER_UC, Figures, figures

PAGE = CLONE / "docs" / "safety.md"
_BEGIN, _END = "<!-- written by make campaign -->\n", "<!-- so far -->\n"
_NONE = "**none**"
COLUMNS = (
    *("fault", "told by", "cases", "told", "latent", "silent"),
    *("ms to safe, p50", "most", "uC, electrode", "uC, return"),
)
#: Which boards a table shows side by side.
_TABLES = (("kajimoto-hv507", GUARDED), (RELAYS,), (BENCH,))


def cells(rows: Sequence[Figures | None], bound: Bound, boards: Sequence[str]) -> tuple[str, ...]:
    """Of a class, in the order of `COLUMNS`: the figures of each board, one beside the other."""

    def each(figure: Callable[[Figures], str]) -> str:
        return " / ".join("-" if row is None else figure(row) for row in rows)

    there = [board for board, row in zip(boards, rows, strict=True) if row is not None]
    return (
        next(row.fault_class for row in rows if row is not None),
        " / ".join(dict.fromkeys("; ".join(bound.rows_on(board)) or _NONE for board in there)),
        each(lambda row: str(row.cases)),
        each(lambda row: str(row.told)),
        each(lambda row: str(row.latent)),
        each(lambda row: str(row.silent)),
        each(lambda row: _ms(row.safe_p50_ms)),
        each(lambda row: _ms(row.safe_most_ms)),
        each(lambda row: f"{row.most_alone_uc:.3f}"),
        each(lambda row: f"{row.most_shared_uc:.3f}"),
    )


def _table(found: Sequence[Outcome], boards: Sequence[str]) -> list[tuple[str, ...]]:
    """A row for each class that one of these boards can have."""
    by_board = [
        {one.fault_class: one for one in figures(one for one in found if where_of(one) == board)}
        for board in boards
    ]
    names = dict.fromkeys(one.fault_class for one in found if where_of(one) in boards)
    known = bounds()
    return [
        cells([of.get(name) for of in by_board], known.get(name, Bound()), boards)
        for name in sorted(names, key=list(known).index if set(names) <= set(known) else None)
    ]


def tables(found: Sequence[Outcome]) -> list[tuple[str, list[tuple[str, ...]]]]:
    """Titles, and rows: first those with the pulses of most scenes."""
    made = []
    for pulse_pc in sorted({one.pulse_pc for one in found}):
        those = [one for one in found if one.pulse_pc == pulse_pc]
        there = Counter(where_of(one) for one in those)
        for boards in _TABLES:
            if shown := [board for board in boards if board in there]:
                names = " / ".join(f"`{board}`" for board in shown)
                cases = sum(there[board] for board in shown)
                title = f"On {names}, pulses of {pulse_pc / PC_PER_UC:.3f} uC, {cases} cases"
                made.append((title, _table(those, shown)))
    return made


def _ms(time_ms: float | None) -> str:
    return "-" if time_ms is None else f"{time_ms:.1f}"


def played(found: Sequence[Outcome]) -> str:
    """Of a run that was not played to its end."""
    counts = Counter((one.board, one.scene) for one in found)
    each = "; ".join(f"{board}, {scene}: {count}" for (board, scene), count in counts.items())
    return f"What has been played so far of the whole, in cases: {each}."


def write(found: Sequence[Outcome], said: str) -> None:
    """Raises: ValueError, where the marks are not there."""
    text = PAGE.read_text(encoding="utf-8")
    before, has_begin, rest = text.partition(_BEGIN)
    _, has_end, after = rest.partition(_END)
    if not (has_begin and has_end):
        raise ValueError(f"{PAGE} has lost its marks: {_BEGIN!r} and {_END!r}")
    PAGE.write_text(before + _BEGIN + _part(found, said) + _END + after, encoding="utf-8")


def _part(found: Sequence[Outcome], said: str) -> str:
    lines = ["", *_folded(said)]
    for title, rows in tables(found):
        lines += [f"\n{title}:\n"]
        lines += ["| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
        lines += ["| " + " | ".join(row) + " |" for row in rows]
    return "\n".join([*lines, "", ""])


def _folded(text: str) -> list[str]:
    return textwrap.wrap(text, 118, break_on_hyphens=False)
