"""A sheet to print and lay an array on: its electrodes in true size, from both sides.

Owns: which pictures stand on the sheet, at which scale, and the sentences with which to check it.
Must not know: files, boards, people.

From the skin is how the array file has it (`view = "through-finger"`): the electrodes face the
reader, the fingertip is up. Mirrored is the same array from its back.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

from etd.draw.palette import BLUE, FAINT, INK, SOFT, WARNING
from etd.draw.places import LINE_EM, Labels, Places, Spacing
from etd.draw.sheet import MARGIN_MM, MIDDLE_EM, PAGE_MM, Picture, Sheet
from etd.files.array import Array

#: What Letter has room for between a browser's margins; A4 has more.
_PAGE_DOWN_MM = 256.0
#: Two columns of pictures, where they are narrow enough.
_BETWEEN_MM = 5.0
_COLUMN_MM = (PAGE_MM - _BETWEEN_MM) / 2
#: Around the electrodes: for the arrow, the axes' marks, and the sensors' names.
_AROUND_MM, _ABOVE_MM = 6.0, 9.0

#: Letters that are read without effort; where a 1 : 1 picture has smaller ones, there is an
#: enlarged picture too.
READABLE_MM, _WANTED_MM, _MOST_MM = 1.5, 1.8, 2.4
#: Below this a circle is no longer kept free of letters, and outputs are left to the enlarged
#: picture.
_LEAST_MM = 1.0
#: Between the names of two sensors.
_APART_MM = 3.0
#: Electrode 0, in whose place the array's mark is looked for.
_FIRST = "#F3CB6B"
#: No enlarged picture is larger, in scale and on paper.
_MOST_SCALE, _MOST_PAPER_MM = 10, 500.0

SIDES = (
    (False, "Seen from the skin", "electrodes up, as if seen through the finger"),
    (True, "Mirrored", "electrodes down: the array's back, or the skin itself"),
)


@dataclass(frozen=True, slots=True)
class _Row:
    """Both sides of the array at one scale."""

    scale: int
    labels: Labels
    outputs: bool

    @property
    def lines(self) -> int:
        """Of a label."""
        return 2 if self.outputs else 1


def array_sheet(array: Array, notes: tuple[str, ...] = ()) -> Picture:
    """The sheet of an array; `notes` are what was mended or assumed when its file was read."""
    spacing = Spacing.of(array)
    sheet = Sheet(f"Array {array.name}: sheet at 1 : 1")
    y = _head(sheet, array, spacing, notes)
    y = _ruler(sheet, y + 3.0)
    right = MARGIN_MM + PAGE_MM
    rows = _rows(array, spacing)
    for row in rows:
        reached, y = _both_sides(sheet, array, row, y + 6.0)
        right = max(right, reached)
    if rows[-1].labels.size_mm < READABLE_MM or not rows[-1].outputs:
        y = sheet.paragraph(
            MARGIN_MM, y + 3.0, "The electrodes are too near to one another for numbers that can be"
            " read on paper: enlarge this file on a screen.", PAGE_MM, color=WARNING,
        )  # fmt: skip
    for number, sensor in enumerate(array.pressure):
        y = sheet.paragraph(
            MARGIN_MM, y + (3.0 if number == 0 else 0.0),
            f"P{number}: pressure sensor, ADS1115 at 0x{sensor.address:02x}, input"
            f" {sensor.channel}; x {sensor.x_mm:g} mm, y {sensor.y_mm:g} mm", PAGE_MM,
        )  # fmt: skip
    if right > MARGIN_MM + PAGE_MM or y > _PAGE_DOWN_MM:
        y = sheet.paragraph(
            MARGIN_MM, y + 3.0, "This sheet is larger than a page: print it on larger paper, or on"
            " several pages, at 100 %.", PAGE_MM, color=WARNING,
        )  # fmt: skip
    return sheet.picture(right, y, _summary(array, rows))


def _summary(array: Array, rows: tuple[_Row, ...]) -> str:
    larger = f", and {rows[-1].scale} : 1 for the numbers" if len(rows) > 1 else ""
    return (
        f"{array.count} electrodes at 1 : 1{larger}, seen from the skin and mirrored; print it at"
        " 100 %"
    )


def _rows(array: Array, spacing: Spacing) -> tuple[_Row, ...]:
    """The pictures in true size, and enlarged ones where its letters are too small: with all
    circles free where there is room for both sides on the page.
    """
    at_size = _in_true_size(array, spacing)
    if at_size.outputs and at_size.labels.size_mm >= READABLE_MM:
        return (at_size,)
    place = Places(array)
    most = min(_MOST_SCALE, int(_MOST_PAPER_MM / max(place.width, place.height)))
    if most < 2:
        return (at_size,)
    scales = range(2, most + 1)
    narrow = [scale for scale in scales if place.width * scale + 2 * _AROUND_MM <= _COLUMN_MM]
    rows = [_Row(scale, _free(array, spacing, scale, 2), outputs=True) for scale in narrow]
    rows += [_Row(scale, _largest(array, spacing, scale, 2), outputs=True) for scale in scales]
    readable = (row for row in rows if row.labels.size_mm >= _WANTED_MM)
    return at_size, next(readable, rows[-1])


def _in_true_size(array: Array, spacing: Spacing) -> _Row:
    """Circles are kept free as long as the letters can be made out."""
    for lines in (2, 1):
        free = _free(array, spacing, 1, lines)
        if free.size_mm >= _LEAST_MM:
            return _Row(1, free, outputs=lines == 2)
    return _Row(1, _largest(array, spacing, 1, 1), outputs=False)


def _free(array: Array, spacing: Spacing, scale: int, lines: int) -> Labels:
    """The largest that do not lie across a circle."""
    inside, below, _ = _labels(array, spacing, scale, lines)
    return max(inside, below)


def _largest(array: Array, spacing: Spacing, scale: int, lines: int) -> Labels:
    return max(_labels(array, spacing, scale, lines))


def _labels(array: Array, spacing: Spacing, scale: int, lines: int) -> tuple[Labels, ...]:
    numbers = (array.count - 1, *(array.outputs() if lines == 2 else ()))
    diameter, digits = array.diameter_mm * scale, len(str(max(numbers)))
    return spacing.labels(scale, diameter, digits, lines, most=_MOST_MM)


# --- the head ----------------------------------------------------------------------------------


def _head(sheet: Sheet, array: Array, spacing: Spacing, notes: tuple[str, ...]) -> float:
    y = sheet.paragraph(MARGIN_MM, MARGIN_MM, array.title, PAGE_MM, size=5.0, bold=True)
    y = sheet.paragraph(
        MARGIN_MM, y,
        f"array {array.name}: {array.count} electrodes of {array.diameter_mm:g} mm,"
        f" {spacing.pitch_mm:.4g} mm apart at the least", PAGE_MM,
    )  # fmt: skip
    y = sheet.paragraph(MARGIN_MM, y, f"Electrode 0 (filled): {array.mark}", PAGE_MM)
    for note in notes:
        y = sheet.paragraph(MARGIN_MM, y, f"Note: {note}", PAGE_MM, color=WARNING)
    return _legend(sheet, y + 2.0)


def _legend(sheet: Sheet, y: float) -> float:
    x, size = MARGIN_MM + 3.0, 2.6
    sheet.circle(x, y + 2.0, 1.8, stroke=BLUE)
    sheet.text(x, y + 2.0 + MIDDLE_EM * size, "12", size=size, anchor="middle", bold=True)
    sheet.text(x, y + 6.4, "40", size=size, anchor="middle", color=WARNING, slanted=True)
    sheet.text(x + 5.0, y + 2.9, "upright and bold: the number of the electrode")
    sheet.text(x + 5.0, y + 6.9, "slanted: its output in the switch chain", color=WARNING)
    return y + 8.0


def _ruler(sheet: Sheet, y: float) -> float:
    """10 mm with a mark at each mm, and what to do with it."""
    for tick in range(11):
        high = {0: 3.0, 5: 2.2}.get(tick % 10, 1.4)
        sheet.line(MARGIN_MM + tick, y + 3.0 - high, MARGIN_MM + tick, y + 3.0, stroke=INK)
    sheet.line(MARGIN_MM, y + 3.0, MARGIN_MM + 10.0, y + 3.0, stroke=INK, mark="ruler-10-mm")
    sheet.text(MARGIN_MM + 5.0, y + 6.4, "10 mm", size=2.6, anchor="middle")
    return sheet.paragraph(
        MARGIN_MM + 14.0, y,
        "This bar is 10 mm long: check it with a ruler. If it is not, print again at 100 %"
        ' ("actual size"), without fitting to the page.', PAGE_MM - 14.0,
    )  # fmt: skip


# --- the array, from a side --------------------------------------------------------------------


def _both_sides(sheet: Sheet, array: Array, row: _Row, y: float) -> tuple[float, float]:
    """Side by side, or one below the other where that is too wide. Returns the right and the
    lower edge.
    """
    place = Places(array, float(row.scale))
    wide = place.width + 2 * _AROUND_MM
    columns = wide <= _COLUMN_MM
    x, bottom = MARGIN_MM, y
    for mirrored, name, how in SIDES:
        if mirrored and columns:
            x += _COLUMN_MM + _BETWEEN_MM
        elif mirrored:
            y = bottom + _BETWEEN_MM
        sheet.text(x, y + 3.6, f"{name}, {row.scale} : 1", size=3.6, bold=True)
        sheet.text(x, y + 8.0, how, size=2.6, color=SOFT)
        at = replace(place, mirrored=mirrored, left=x + _AROUND_MM, top=y + 9.0 + _ABOVE_MM)
        bottom = _side(sheet, at, row)
    return x + wide, bottom


def _side(sheet: Sheet, at: Places, row: _Row) -> float:
    """Circles above letters, so that their true size is seen wherever a number crosses them.
    Returns the lower edge.
    """
    side = f"{'mirrored' if at.mirrored else 'skin'}-{row.scale}"
    arrow_to_fingertip(sheet, at)
    lowest = _sensors(sheet, at, side)
    bottom = _axes(sheet, at, max(lowest, at.top + at.height + row.labels.down_mm(row.lines)))
    x, y = at.of_electrode(0)
    sheet.circle(x, y, at.diameter / 2, fill=_FIRST, stroke="none")
    outputs = at.array.outputs()
    for index, output in enumerate(outputs):
        _label(sheet, at, row, index, output, side)
    for index, output in enumerate(outputs):
        x, y = at.of_electrode(index)
        electrode = at.array.electrode[index]
        sheet.circle(
            x, y, at.diameter / 2, stroke=BLUE, mark=f"{side}-electrode-{index}",
            tip=f"electrode {index}, output {output}: x {electrode.x_mm:g} mm,"
            f" y {electrode.y_mm:g} mm",
        )  # fmt: skip
    return bottom


def _label(sheet: Sheet, at: Places, row: _Row, index: int, output: int, side: str) -> None:
    x, y = at.of_electrode(index)
    size, where = row.labels
    below = y + at.diameter / 2 + 0.85 * size
    if where == "inside":
        first = y + MIDDLE_EM * size - 0.5 * LINE_EM * size * (row.lines - 1)
        second = first + LINE_EM * size
    elif where == "below":
        first, second = below, below + LINE_EM * size
    else:
        first = y + MIDDLE_EM * size
        second = max(below, first + LINE_EM * size)
    sheet.text(
        x, first, str(index), size=size, anchor="middle", bold=True, mark=f"{side}-number-{index}"
    )
    if row.outputs:
        sheet.text(
            x, second, str(output), size=size, anchor="middle", color=WARNING, slanted=True,
            mark=f"{side}-output-{index}",
        )  # fmt: skip


def arrow_to_fingertip(sheet: Sheet, at: Places, above: float = 0.0) -> None:
    """Above the electrodes, by 2 mm and `above`: y rises towards the fingertip."""
    middle, foot = at.left + at.width / 2, at.top - 2.0 - above
    head = foot - 5.0
    sheet.line(middle, foot, middle, head + 1.5, stroke=INK, width=0.4)
    sheet.polygon(
        [(middle, head), (middle - 1.0, head + 1.8), (middle + 1.0, head + 1.8)], fill=INK
    )
    sheet.text(middle + 2.0, foot - 1.2, "to the fingertip", size=2.6)


def _axes(sheet: Sheet, at: Places, bottom: float) -> float:
    """Marks outside the electrodes where x and y are 0, and to which side x rises. Returns the
    lower edge.
    """
    if at.axes is not None:
        x, y = at.axes
        for upper in (at.top - 1.6, bottom + 0.6):
            sheet.line(x, upper, x, upper + 1.0, stroke=FAINT)
        for outer in (at.left - 3.0, at.left + at.width + 2.0):
            sheet.line(outer, y, outer + 1.0, y, stroke=FAINT)
    start, y = at.left + at.width / 2, bottom + 3.6
    end, back = (start - 6.0, 1.2) if at.mirrored else (start + 6.0, -1.2)
    sheet.line(start, y, end, y, width=0.3)
    sheet.polygon([(end, y), (end + back, y - 0.7), (end + back, y + 0.7)], fill=SOFT)
    sheet.text(
        end - back, y + 0.9, "x", size=2.6, color=SOFT, anchor="end" if at.mirrored else "start"
    )
    return y + 2.0


def _sensors(sheet: Sheet, at: Places, side: str) -> float:
    """A diamond at each place, since a sensor's size is not in the file; its name stands outside
    the electrodes, at the end of a line. Returns the lower edge of the names.
    """
    size, lowest = 2.2, at.top - _APART_MM
    for number, sensor in sorted(enumerate(at.array.pressure), key=lambda it: -it[1].y_mm):
        x, y = at.at(sensor.x_mm, sensor.y_mm)
        lowest = max(y, lowest + _APART_MM)
        outside = at.left + at.width + 3.4
        sheet.line(x + 1.1, y, outside, lowest, stroke=FAINT, dashes="0.6 0.4", width=0.15)
        corners = [(x, y - 1.1), (x + 1.1, y), (x, y + 1.1), (x - 1.1, y)]
        sheet.polygon(corners, fill="none", stroke=SOFT, mark=f"{side}-pressure-{number}")
        sheet.text(outside + 0.4, lowest + MIDDLE_EM * size, f"P{number}", size=size, color=SOFT)
    return lowest + size
