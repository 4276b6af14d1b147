"""A sheet of paper in millimetres, and the marks on it, as SVG.

Owns: the units (a user unit is 1 mm, nothing is transformed, so that every number in the file can
be checked with a ruler), letters and how wide they may get, what is escaped. Must not know: what a
picture is about.

The only font is `sans-serif`, which differs from machine to machine. So widths are estimated by
those of a wide one (DejaVu Sans): what fits by the estimate fits.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from html import escape
from unicodedata import east_asian_width

from etd.draw.palette import INK, PAPER, SOFT
from etd.protocol.text import escaped

#: What is drawn on, and what is left around it. With the 10 mm that browsers leave on each side of
#: the paper, this is the width of A4, and fits on Letter.
PAGE_MM, MARGIN_MM = 184.0, 3.0
#: From the baseline to the middle of a digit, in ems.
MIDDLE_EM = 0.36
#: From one baseline to the next, in ems.
LINE_EM = 1.35
#: No title, mark or note of a file is shown beyond this.
MOST_LETTERS = 400

_NARROW, _WIDE = frozenset(" iljtfrI.,:;|!'()[]/-"), frozenset("mwMW@%—…&")
_NO_XML = re.compile("[\ud800-\udfff\ufffe\uffff]")


def text_width_mm(text: str, size_mm: float, bold: bool = False) -> float:
    """No usual font makes Latin letters and digits wider than this."""
    return size_mm * sum(_letter_em(letter) + (0.09 if bold else 0.0) for letter in text)


def _letter_em(letter: str) -> float:
    if letter in _NARROW:
        return 0.42
    if letter in _WIDE or east_asian_width(letter) in "WF":
        return 1.02
    if letter.isascii() and (letter.islower() or letter.isdigit()):
        return 0.64
    return 0.84


def shown(text: str) -> str:
    """As it can stand in XML: on one line, without what acts on a reader, and cut where it is
    endless.
    """
    plain = _NO_XML.sub(lambda found: f"\\u{ord(found[0]):04x}", escaped(text))
    return plain if len(plain) <= MOST_LETTERS else f"{plain[: MOST_LETTERS - 1]}…"


def wrapped(text: str, size_mm: float, width_mm: float, bold: bool = False) -> list[str]:
    """The text as lines that fit into the width; a word that does not is broken."""
    lines: list[str] = []
    line = ""
    for word in shown(text).split(" "):
        longer = f"{line} {word}" if line else word
        if text_width_mm(longer, size_mm, bold) <= width_mm:
            line = longer
            continue
        if line:
            lines.append(line)
        line = ""
        for letter in word:
            if line and text_width_mm(line + letter, size_mm, bold) > width_mm:
                lines.append(line)
                line = ""
            line += letter
    return [*lines, line]


def mm(value: float) -> str:
    """A length or a place to a thousandth of a millimetre, as short as it can be written."""
    text = f"{value:.3f}".rstrip("0").rstrip(".")
    return "0" if text == "-0" else text


@dataclass(frozen=True, slots=True)
class Picture:
    """A finished picture: the SVG, its size on paper, and a sentence about what it shows."""

    svg: str
    width_mm: float
    height_mm: float
    summary: str


class Sheet:
    """Marks in the order in which they are drawn; places in mm from the upper left corner."""

    def __init__(self, title: str) -> None:
        self._title = shown(title)
        self._marks: list[str] = []

    @contextmanager
    def group(self, mark: str, stroke: str, width: float) -> Iterator[None]:
        """What is drawn meanwhile has this edge, where it has none of its own."""
        self._marks.append(f"<g{_id(mark)}{_look('', stroke, width, '')}>")
        yield
        self._marks.append("</g>")

    def circle(
        self,
        x: float,
        y: float,
        radius: float,
        *,
        fill: str = "none",
        stroke: str = SOFT,
        width: float = 0.1,
        dashes: str = "",
        mark: str = "",
        tip: str = "",
    ) -> None:
        """`mark` becomes the id, by which a drawing program finds it; `tip` is shown beside the
        pointer.
        """
        self._marks.append(
            f"<circle{_id(mark)} {_numbers(cx=x, cy=y, r=radius)}"
            f"{_look(fill, stroke, width, dashes)}{_end('circle', tip)}"
        )

    def rect(
        self,
        x: float,
        y: float,
        across: float,
        down: float,
        *,
        fill: str = "none",
        stroke: str = "none",
        width: float = 0.1,
        mark: str = "",
    ) -> None:
        self._marks.append(
            f"<rect{_id(mark)} {_numbers(x=x, y=y, width=across, height=down)}"
            f"{_look(fill, stroke, width, '')}/>"
        )

    def line(
        self,
        x1: float,
        y1: float,
        x2: float,
        y2: float,
        *,
        stroke: str = SOFT,
        width: float = 0.2,
        dashes: str = "",
        mark: str = "",
    ) -> None:
        self._marks.append(
            f"<line{_id(mark)} {_numbers(x1=x1, y1=y1, x2=x2, y2=y2)}"
            f"{_look('', stroke, width, dashes)}/>"
        )

    def polygon(
        self, points: list[tuple[float, float]], *, fill: str, stroke: str = "none", mark: str = ""
    ) -> None:
        places = " ".join(f"{mm(x)},{mm(y)}" for x, y in points)
        self._marks.append(f'<polygon{_id(mark)} points="{places}"{_look(fill, stroke, 0.2, "")}/>')

    def text(
        self,
        x: float,
        y: float,
        text: str,
        *,
        size: float = 3.0,
        anchor: str = "start",
        color: str = INK,
        bold: bool = False,
        slanted: bool = False,
        mark: str = "",
    ) -> None:
        """`y` is the baseline."""
        look = ' font-weight="700"' if bold else ""
        look += ' font-style="italic"' if slanted else ""
        look += f' text-anchor="{anchor}"' if anchor != "start" else ""
        self._marks.append(
            f'<text{_id(mark)} {_numbers(x=x, y=y)} font-size="{mm(size)}"'
            f' fill="{color}"{look}>{escape(shown(text), quote=False)}</text>'
        )

    def paragraph(
        self,
        x: float,
        y: float,
        text: str,
        width_mm: float,
        *,
        size: float = 3.0,
        color: str = INK,
        bold: bool = False,
    ) -> float:
        """Lines below `y`, which is their upper edge. Returns their lower edge."""
        for line in wrapped(text, size, width_mm, bold):
            self.text(x, y + size, line, size=size, color=color, bold=bold)
            y += LINE_EM * size
        return y

    def picture(self, right_mm: float, bottom_mm: float, summary: str) -> Picture:
        """Of the width of a page at least, and as large as what was drawn, which ends at
        `right_mm` and `bottom_mm`.
        """
        width, height = max(PAGE_MM + MARGIN_MM, right_mm) + MARGIN_MM, bottom_mm + MARGIN_MM
        head = (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{mm(width)}mm"'
            f' height="{mm(height)}mm" viewBox="0 0 {mm(width)} {mm(height)}"'
            f' font-family="sans-serif" role="img">'
        )
        paper = f'<rect width="{mm(width)}" height="{mm(height)}" fill="{PAPER}"/>'
        title = f"<title>{escape(self._title, quote=False)}</title>"
        return Picture(
            "\n".join([head, title, paper, *self._marks, "</svg>"]) + "\n", width, height, summary
        )


def _numbers(**values: float) -> str:
    return " ".join(f'{name}="{mm(value)}"' for name, value in values.items())


def _look(fill: str, stroke: str, width: float, dashes: str) -> str:
    look = f' fill="{fill}"' if fill else ""
    if stroke != "none":
        look += f' stroke="{stroke}" stroke-width="{mm(width)}"'
    return look + (f' stroke-dasharray="{dashes}"' if dashes else "")


def _id(mark: str) -> str:
    return f' id="{escape(mark)}"' if mark else ""


def _end(name: str, tip: str) -> str:
    return f"><title>{escape(shown(tip), quote=False)}</title></{name}>" if tip else "/>"
