"""A picture that etd drew, read back as XML: where its marks lie on paper, in mm.

Owns: what holds for every picture (well-formed, alone, no program, everything on the paper), and
boxes around letters. Must not know: what a picture shows, how it was drawn.
"""

from __future__ import annotations

import xml.etree.ElementTree as ET
from dataclasses import dataclass
from itertools import pairwise

SVG = "{http://www.w3.org/2000/svg}"
ALLOWED = {"svg", "title", "rect", "circle", "line", "polygon", "text", "g"}
#: Advances of the letters from space to tilde in DejaVu Sans, which is wide, and in its bold: in
#: thousandths of an em.
_PLAIN = """
    318 401 460 838 636 950 780 275 390 390 500 838 318 361 318 337 636 636 636 636 636 636 636
    636 636 636 337 337 838 838 838 531 1000 684 686 698 770 632 575 775 752 295 295 656 557 863
    748 787 603 787 695 635 611 732 684 989 685 611 685 390 337 390 838 500 500 613 635 550 635
    615 352 635 634 278 278 579 278 974 634 612 635 635 411 521 392 634 592 818 592 592 525 636
    337 636 838
"""
_BOLD = """
    348 456 521 838 696 1002 872 306 457 457 523 838 380 415 380 365 696 696 696 696 696 696 696
    696 696 696 400 400 838 838 838 580 1000 774 762 734 830 683 683 821 837 372 372 775 637 995
    837 850 733 850 770 720 682 812 774 1103 771 724 725 457 365 457 838 500 500 675 716 593 716
    678 435 716 712 343 343 665 343 1042 712 687 716 716 493 595 478 712 652 924 645 652 582 712
    365 712 838
"""
_ADVANCES = {
    is_bold: dict(zip(map(chr, range(32, 127)), map(int, table.split()), strict=True))
    for is_bold, table in ((False, _PLAIN), (True, _BOLD))
}


def advance_em(text: str, is_bold: bool) -> float:
    """Letters beyond ASCII count as the widest."""
    return sum(_ADVANCES[is_bold].get(letter, 1000) for letter in text) / 1000


@dataclass(frozen=True)
class Box:
    left: float
    top: float
    right: float
    bottom: float
    what: str

    def overlaps(self, other: Box) -> bool:
        return (
            self.left < other.right
            and other.left < self.right
            and self.top < other.bottom
            and other.top < self.bottom
        )


class Drawing:
    """An SVG of ours; its making checks what holds for all of them."""

    def __init__(self, svg: str) -> None:
        self.root = ET.fromstring(svg)
        assert self.root.tag == f"{SVG}svg"
        assert self.root[0].tag == f"{SVG}title"
        assert self.root[0].text
        assert {element.tag.removeprefix(SVG) for element in self.root.iter()} <= ALLOWED
        assert self.root.get("font-family") == "sans-serif"
        assert "font-family" not in svg.replace('font-family="sans-serif"', "", 1)
        for element in self.root.iter():
            names = set(element.keys())
            assert not any(name.startswith("on") or "href" in name for name in names)
            assert "transform" not in names
            assert "style" not in names
        marks = [element.get("id") for element in self.root.iter() if element.get("id")]
        assert len(marks) == len(set(marks))
        self.marks = {element.get("id"): element for element in self.root.iter()}
        self.width, self.height = (self._mm(self.root.get(it)) for it in ("width", "height"))
        assert self.root.get("viewBox") == f"0 0 {self.width:g} {self.height:g}" or [
            float(it) for it in str(self.root.get("viewBox")).split()
        ] == [0.0, 0.0, self.width, self.height]

    @staticmethod
    def _mm(length: str | None) -> float:
        assert length is not None
        assert length.endswith("mm")
        return float(length.removesuffix("mm"))

    def __contains__(self, mark: str) -> bool:
        return mark in self.marks

    def circle(self, mark: str) -> tuple[float, float, float]:
        """Its middle and its radius."""
        element = self.marks[mark]
        assert element.tag == f"{SVG}circle"
        x, y, radius = (float(element.attrib[it]) for it in ("cx", "cy", "r"))
        return x, y, radius

    def text(self, mark: str) -> str:
        element = self.marks[mark]
        assert element.tag == f"{SVG}text"
        return element.text or ""

    def fill(self, mark: str) -> str:
        return str(self.marks[mark].get("fill"))

    def words(self) -> str:
        """All that is written, line by line."""
        return "\n".join(element.text or "" for element in self.root.iter(f"{SVG}text"))

    def boxes(self) -> list[Box]:
        """Around every text, as wide as in a wide font."""
        return [_box(element) for element in self.root.iter(f"{SVG}text")]

    def check_on_paper(self) -> None:
        found = self.boxes()
        for element in self.root.iter(f"{SVG}circle"):
            x, y, radius = (float(element.attrib[it]) for it in ("cx", "cy", "r"))
            found.append(Box(x - radius, y - radius, x + radius, y + radius, "circle"))
        beyond = [
            box
            for box in found
            if box.left < 0 or box.top < 0 or box.right > self.width or box.bottom > self.height
        ]
        assert beyond == []

    def overlapping(self) -> list[tuple[str, str]]:
        """Pairs of texts that lie on one another."""
        boxes = sorted(self.boxes(), key=lambda box: box.left)
        found = []
        for at, box in enumerate(boxes):
            for other in boxes[at + 1 :]:
                if other.left >= box.right:
                    break
                if box.overlaps(other):
                    found.append((box.what, other.what))
        return found


def _box(element: ET.Element) -> Box:
    text, size = element.text or "", float(element.attrib["font-size"])
    is_bold = element.get("font-weight") == "700"
    width = size * advance_em(text, is_bold)
    above, below = (0.75, 0.02) if text.isdecimal() else (0.76, 0.24)
    x, y = float(element.attrib["x"]), float(element.attrib["y"])
    before = {"middle": width / 2, "end": width}.get(element.get("text-anchor", "start"), 0.0)
    what = element.get("id") or text
    return Box(x - before, y - above * size, x - before + width, y + below * size, what)


def is_rising(values: list[float]) -> bool:
    return all(one <= other for one, other in pairwise(values))
