"""Letters on paper: how wide they get, where lines break, and what may stand in XML."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import pytest
from hypothesis import given
from hypothesis import strategies as st

from drawn_svg import advance_em
from etd.draw.sheet import Sheet, mm, shown, text_width_mm, wrapped


@given(st.text(st.characters(min_codepoint=32, max_codepoint=126)), st.booleans())
def test_no_text_is_wider_than_estimated(text: str, is_bold: bool) -> None:
    assert advance_em(text, is_bold) <= text_width_mm(text, 1.0, is_bold) + 1e-9


@given(st.text(max_size=60), st.floats(5.0, 100.0), st.booleans())
def test_lines_fit_and_lose_no_word(text: str, width_mm: float, is_bold: bool) -> None:
    lines = wrapped(text, 3.0, width_mm, is_bold)
    assert all(text_width_mm(line, 3.0, is_bold) <= width_mm for line in lines)
    assert "".join(lines).replace(" ", "") == shown(text).replace(" ", "")


@given(st.text(st.characters(codec=None), max_size=50))
def test_any_text_is_well_formed_xml(text: str) -> None:
    sheet = Sheet(text)
    sheet.text(10.0, 10.0, text)
    sheet.circle(10.0, 10.0, 1.0, tip=text)
    root = ET.fromstring(sheet.picture(20.0, 20.0, "").svg.encode())
    assert [element.text for element in root.iter() if element.text and element.text.strip()] == [
        it for it in [shown(text)] * 3 if it.strip()
    ]


@pytest.mark.parametrize(
    ("value", "text"),
    [(0.0, "0"), (-0.0001, "0"), (1.0, "1"), (2.5, "2.5"), (0.1234, "0.123"), (-12.0, "-12"),
     (100.0, "100")],
)  # fmt: skip
def test_lengths_are_short_and_to_a_thousandth(value: float, text: str) -> None:
    assert mm(value) == text


def test_a_user_unit_is_a_millimetre() -> None:
    root = ET.fromstring(Sheet("a").picture(20.0, 20.0, "").svg)
    assert (root.get("width"), root.get("height")) == ("190mm", "23mm")
    assert root.get("viewBox") == "0 0 190 23"


def test_a_sheet_is_as_wide_as_paper_takes_and_larger_where_needed() -> None:
    page = Sheet("a").picture(187.0, 254.0, "")
    assert (page.width_mm, page.height_mm) == (190.0, 257.0)
    larger = Sheet("a").picture(187.1, 300.0, "")
    assert (larger.width_mm, larger.height_mm) == (190.1, 303.0)
