"""A person's calibration as maps: thresholds, comfortable currents, and the room to the cap.

Owns: which maps there are and what is said beside them. Must not know: files, limits.

As seen through the finger, like the array's file. An electrode that was not felt has neither
threshold nor room: its currents are bounds only.
"""

from __future__ import annotations

from collections.abc import Callable

from etd.draw.array_sheet import READABLE_MM, arrow_to_fingertip
from etd.draw.cells import NUMBERED, Cells, Scale, scale_bar, value_map
from etd.draw.palette import FAINT, SOFT, WARNING
from etd.draw.places import Spacing
from etd.draw.sheet import MARGIN_MM, MIDDLE_EM, PAGE_MM, Picture, Sheet
from etd.files.array import Array
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.frame import Returns, Ring

_BETWEEN_MM = 8.0
_COLUMN_MM = (PAGE_MM - _BETWEEN_MM) / 2
#: Below a map's title: the scale, the arrow, the map; and below the map.
_BAR_MM, _ARROW_MM, _BELOW_MM = 6.0, 9.0, 6.0
_MOST_LETTERS_MM = 2.6

_Value = Callable[[ElectrodeLimits], int]
_MAPS: tuple[tuple[str, str, str, _Value], ...] = (
    ("threshold", "Threshold, uA", "where feeling begins", lambda it: it.threshold_ua),
    ("comfortable", "Comfortable, uA", "what level 1 is", lambda it: it.comfortable_ua),
    (
        "room",
        "Room to the cap, uA",
        "cap less comfortable: what may still be added",
        lambda it: it.cap_ua - it.comfortable_ua,
    ),
)


def calibration_map(calibration: Calibration, array: Array) -> Picture:
    """Three maps of a calibration, which has the limits of each electrode of `array`."""
    sheet = Sheet(f"Calibration {calibration.participant} on {calibration.array}")
    y = _head(sheet, calibration) + 4.0
    cells = Cells.of(array, Spacing.of(array), NUMBERED)
    column = max(_COLUMN_MM, cells.width)
    shown = [limits for limits in calibration.electrode if limits.felt]
    bottom, left, letters_mm = y, MARGIN_MM, _letters_mm(calibration, cells)
    for number, (mark, title, what, value) in enumerate(_MAPS):
        if number == 2:
            y, left = bottom + 4.0, MARGIN_MM
        values = [value(limits) if limits.felt else None for limits in calibration.electrode]
        sheet.text(left, y + 3.6, title, size=3.6, bold=True)
        sheet.text(left, y + 7.6, what, size=2.6, color=SOFT)
        top = y + 9.4
        if shown:
            scale = Scale(min(map(value, shown)), max(map(value, shown)))
            scale_bar(sheet, left, top, _COLUMN_MM, (f"{scale.low:g}", f"{scale.high:g}"))
        else:
            scale = Scale(0.0, 0.0)
            sheet.text(left, top + 2.8, "no electrode was felt", size=2.6, color=WARNING)
        here = cells.moved(left, top + _BAR_MM + _ARROW_MM)
        arrow_to_fingertip(sheet, here.at, here.diameter / 2)
        value_map(sheet, here, values, scale, mark, letters_mm)
        bottom = max(bottom, top + _BAR_MM + _ARROW_MM + here.height + _BELOW_MM)
        left += column + _BETWEEN_MM
    _legend(sheet, left, y)
    if letters_mm < READABLE_MM:
        bottom = sheet.paragraph(
            MARGIN_MM, bottom, "The electrodes are too near to one another for numbers that can be"
            " read on paper: enlarge this file on a screen.", PAGE_MM, color=WARNING,
        )  # fmt: skip
    summary = (
        f"thresholds, comfortable currents and room to the cap of {len(shown)} electrodes"
        f" on {array.name}"
    )
    unfelt = len(calibration.electrode) - len(shown)
    if unfelt:
        summary += f"; {unfelt} without values are crossed out"
    return sheet.picture(MARGIN_MM + 2 * column + _BETWEEN_MM, bottom, summary)


def _letters_mm(calibration: Calibration, cells: Cells) -> float:
    """One size for all maps: of the longest number that is on any."""
    longest = max((limits.cap_ua for limits in calibration.electrode), default=0)
    return min(_MOST_LETTERS_MM, cells.letters_mm(len(str(longest))))


def _head(sheet: Sheet, calibration: Calibration) -> float:
    y = sheet.paragraph(
        MARGIN_MM, MARGIN_MM, f"Calibration of {calibration.participant}", PAGE_MM, size=5.0,
        bold=True,
    )  # fmt: skip
    method = f", method {calibration.method}" if calibration.method else ""
    caps_ua = [limits.cap_ua for limits in calibration.electrode]
    sentences = [
        f"{calibration.array} on the {calibration.body_site}, {calibration.date.isoformat()},"
        f" {calibration.program}{method}",
        f"{calibration.polarity}, {calibration.width_us} us, {calibration.rate_hz:g} Hz, returns:"
        f" {_returns(calibration.returns)}; {calibration.shape}; gamma {calibration.gamma:g};"
        f" caps up to {max(caps_ua, default=0)} uA",
        "Seen through the finger onto the electrodes. Not to scale.",
    ]
    other_days = sum(limits.date is not None for limits in calibration.electrode)
    if other_days:
        sentences.append(f"Values of another day: {other_days} electrodes (the file says which).")
    for sentence in sentences:
        y = sheet.paragraph(MARGIN_MM, y, sentence, PAGE_MM)
    return y


def _returns(returns: Returns) -> str:
    if isinstance(returns, Ring):
        return f"a ring of {returns.ring_mm:g} mm"
    return "all others" if isinstance(returns, str) else "a list for each electrode"


def _legend(sheet: Sheet, x: float, y: float) -> None:
    """Beside the last map."""
    middle = y + 14.0
    sheet.text(x + 10.0, middle - 5.0, "small: the electrode; bold: the current in uA", size=2.6)
    sheet.circle(x + 4.0, middle, 3.2, stroke=SOFT, dashes="0.8 0.6")
    sheet.line(x + 1.8, middle + 2.2, x + 6.2, middle - 2.2, stroke=FAINT, width=0.15)
    sheet.text(
        x + 10.0, middle + MIDDLE_EM * 2.6, "crossed out: not felt up to its cap, or not tried",
        size=2.6,
    )  # fmt: skip
    sheet.text(x + 10.0, middle + 5.0, "each map has its own scale, light is little", size=2.6)
