"""A pattern as a strip: its frames one after another, each at its time.

Owns: which frames are shown when there are many, and what stands under each. Must not know: files,
currents (a level is relative to what the player is told).
"""

from __future__ import annotations

from etd.draw.array_sheet import arrow_to_fingertip
from etd.draw.cells import Cells, CellSize, key_map, scale_bar
from etd.draw.palette import FAINT, PAPER, SOFT, WARNING, shade
from etd.draw.places import Spacing
from etd.draw.sheet import LINE_EM, MARGIN_MM, PAGE_MM, Picture, Sheet, text_width_mm
from etd.files.array import Array
from etd.files.pattern import Pattern, PatternFrame

#: More frames are sampled.
MOST_FRAMES = 60
#: A frame's cells, and those of the picture that says which electrode is where.
_FRAME = CellSize(4.0, 1.6, 24.0, 60.0)
_KEY = CellSize(8.0, 4.4, 40.0, 120.0)
_BETWEEN_MM, _ROW_MM, _WORDS_MM = 4.0, 4.0, 2.1


def pattern_strip(
    pattern: Pattern, array: Array, name: str, notes: tuple[str, ...] = ()
) -> Picture:
    """The frames of a pattern on an array of as many electrodes; `notes` are what was mended or
    left out when its file was read.
    """
    sheet = Sheet(f"Pattern {name} on {array.name}")
    step = -(-len(pattern.frames) // MOST_FRAMES)
    spacing = Spacing.of(array)
    y = _head(sheet, pattern, array, name, step, notes)
    y = _key(sheet, Cells.of(array, spacing, _KEY), y + 3.0)
    bottom, right = _strip(sheet, pattern, Cells.of(array, spacing, _FRAME), step, y + 3.0)
    summary = f"{_which(pattern, step)}, on {array.name}"
    return sheet.picture(max(MARGIN_MM + PAGE_MM, right), bottom, summary)


def _which(pattern: Pattern, step: int) -> str:
    count = len(pattern.frames)
    if step == 1:
        return "its only frame" if count == 1 else f"all {count} frames"
    return f"every {_ordinal(step)} of {count} frames"


def _ordinal(number: int) -> str:
    endings = {1: "st", 2: "nd", 3: "rd"}
    is_teen = number % 100 in (11, 12, 13)
    return f"{number}{'th' if is_teen else endings.get(number % 10, 'th')}"


def _head(
    sheet: Sheet, pattern: Pattern, array: Array, name: str, step: int, notes: tuple[str, ...]
) -> float:
    y = sheet.paragraph(MARGIN_MM, MARGIN_MM, f"Pattern {name}", PAGE_MM, size=5.0, bold=True)
    most = max(len(frame.active) for frame in pattern.frames)
    y = sheet.paragraph(
        MARGIN_MM, y, f"{len(pattern.frames)} frames for {pattern.electrodes} electrodes,"
        f" {_seconds(pattern.duration_ms)}, up to {most} active; shown on {array.name}, seen"
        " through the finger, not to scale", PAGE_MM,
    )  # fmt: skip
    if step > 1:
        y = sheet.paragraph(
            MARGIN_MM, y, f"Shown: {_which(pattern, step)}, beginning with frame 0. The frames"
            " between them are not in this picture.", PAGE_MM, color=WARNING, bold=True,
        )  # fmt: skip
    for note in notes:
        y = sheet.paragraph(MARGIN_MM, y, f"Note: {note}", PAGE_MM, color=WARNING)
    return y


def _key(sheet: Sheet, cells: Cells, y: float) -> float:
    """Which electrode is where, and what a shade means."""
    here = cells.moved(MARGIN_MM, y + 9.0)
    arrow_to_fingertip(sheet, here.at, here.diameter / 2)
    key_map(sheet, here, "key")
    x = MARGIN_MM + max(here.width, 30.0) + 12.0
    sheet.rect(x, y + 10.0, 4.0, 4.0, fill=level_shade(0.0), stroke=SOFT)
    sheet.text(x + 5.2, y + 12.9, "level 0: silent", size=2.4)
    ends = ("above 0", "1: full strength")
    scale_bar(sheet, x, y + 16.0, 100.0, ends, _felt_shade)
    words = (
        "Under each frame: its number and when it begins, how long it is up and the silence after"
        " it, rate and polarity where the file gives them."
    )
    lower = sheet.paragraph(x, y + 22.0, words, MARGIN_MM + PAGE_MM - x, size=2.6)
    return max(here.at.top + here.height, lower)


def _strip(
    sheet: Sheet, pattern: Pattern, cells: Cells, step: int, y: float
) -> tuple[float, float]:
    """Rows of frames. Returns the lower and the right edge."""
    begins_ms, shown = 0, []
    for number, frame in enumerate(pattern.frames):
        if number % step == 0:
            shown.append((number, frame, _words(number, frame, begins_ms)))
        begins_ms += frame.duration_ms + frame.off_ms
    widest = max(text_width_mm(line, _WORDS_MM) for _, _, words in shown for line in words)
    lines = max(len(words) for _, _, words in shown)
    across = max(cells.width, widest) + _BETWEEN_MM
    down = cells.height + lines * LINE_EM * _WORDS_MM + _ROW_MM
    columns = max(1, int((PAGE_MM + _BETWEEN_MM) / across))
    for place, (number, frame, words) in enumerate(shown):
        row, column = divmod(place, columns)
        left, top = MARGIN_MM + column * across, y + row * down
        _frame(sheet, cells.moved(left, top), number, frame)
        for at, line in enumerate(words, start=1):
            baseline = top + cells.height + at * LINE_EM * _WORDS_MM
            sheet.text(
                left, baseline, line, size=_WORDS_MM, color=SOFT,
                mark=f"frame-{number}-time" if at == 1 else "",
            )  # fmt: skip
    rows = -(-len(shown) // columns)
    return y + rows * down, MARGIN_MM + min(columns, len(shown)) * across


def _frame(sheet: Sheet, cells: Cells, number: int, frame: PatternFrame) -> None:
    """A circle for each electrode, in the order of the electrodes."""
    with sheet.group(f"frame-{number}", stroke=FAINT, width=0.1):
        for index, level in enumerate(frame.level):
            x, y = cells.at.of_electrode(index)
            sheet.circle(x, y, cells.diameter / 2, fill=level_shade(level), stroke="none")


def level_shade(level: float) -> str:
    """Of 0 to 1: silent is white, and the least that is felt can be told from it."""
    return _felt_shade(level) if level > 0.0 else PAPER


def _felt_shade(level: float) -> str:
    return shade(0.15 + 0.85 * level)


def _words(number: int, frame: PatternFrame, begins_ms: int) -> list[str]:
    off = f", then {frame.off_ms} ms off" if frame.off_ms else ""
    words = [f"{number}: at {_seconds(begins_ms)}", f"{frame.duration_ms} ms{off}"]
    said = [
        *([f"{frame.rate_hz:g} Hz"] if frame.rate_hz is not None else []),
        *([frame.polarity] if frame.polarity is not None else []),
    ]
    return [*words, ", ".join(said)] if said else words


def _seconds(duration_ms: int) -> str:
    """Exact, without an exponent."""
    whole, rest = divmod(duration_ms, 1000)
    return f"{whole}.{rest:03d}".rstrip("0").rstrip(".") + " s"
