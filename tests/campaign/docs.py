"""What a run of the campaign says in docs/safety.md.

Owns: the part of the page between two marks, which is not written by hand, and which classes of
faults need other hardware, with why. Must not know: how a case is played.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from campaign.case import Outcome
from campaign.results import CLONE, Figures, figures

PAGE = CLONE / "docs" / "safety.md"
_BEGIN, _END = "<!-- written by make campaign -->\n", "<!-- so far -->\n"
#: No guard of these boards bounds them: what would is in docs/hardware.md.
NEEDS_HARDWARE: Final[dict[str, str]] = {
    "the source is short": "a second limiter in series with the source",
}
COLUMNS = (
    *("fault", "cases", "halted", "refused", "ended", "harmless", "silent", "crashed"),
    *("halt after, p50", "most", "beyond, uC", "as a return, uC"),
)


def cells(found: Figures) -> tuple[str, ...]:
    """Of a row, in the order of `COLUMNS`."""
    return (
        found.fault_class,
        *map(str, (found.cases, found.halted, found.refused, found.ended)),
        *map(str, (found.harmless, found.silent, found.crashed)),
        _ms(found.halted_p50_ms),
        _ms(found.halted_most_ms),
        f"{found.most_alone_uc:.3f}",
        f"{found.most_shared_uc:.3f}",
    )


def _ms(time_ms: float | None) -> str:
    return "-" if time_ms is None else f"{time_ms:.2f} ms"


def write(found: Sequence[Outcome], said: str) -> None:
    """Raises: ValueError, where the marks are not there."""
    text = PAGE.read_text(encoding="utf-8")
    before, has_begin, rest = text.partition(_BEGIN)
    _, has_end, after = rest.partition(_END)
    if not (has_begin and has_end):
        raise ValueError(f"{PAGE} has lost its marks: {_BEGIN!r} and {_END!r}")
    PAGE.write_text(before + _BEGIN + _part(found, said) + _END + after, encoding="utf-8")


def _part(found: Sequence[Outcome], said: str) -> str:
    lines = ["", said]
    for board in dict.fromkeys(one.board for one in found):
        of_board = [one for one in found if one.board == board]
        lines += [f"\nOn `{board}`, {len(of_board)} cases:\n"]
        lines += ["| " + " | ".join(COLUMNS) + " |", "|" + "---|" * len(COLUMNS)]
        lines += ["| " + " | ".join(cells(figure)) + " |" for figure in figures(of_board)]
    return "\n".join([*lines, "", ""])
