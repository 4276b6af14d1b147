"""The page on safety names the hard ceilings as they are, and files that there are."""

from __future__ import annotations

import re
from pathlib import Path

from etd_hal import ceilings

CLONE = Path(__file__).resolve().parents[1]
PAGE = (CLONE / "docs" / "safety.md").read_text(encoding="utf-8")


def test_the_ceilings_on_the_page_are_those_in_force() -> None:
    (table,) = re.findall(r"\| \| at most \|\n\|---\|---\|\n((?:\|.*\n)+)", PAGE)
    figures = [int(figure) for figure in re.findall(r"\b(\d+)\b", table)]
    assert figures == [
        ceilings.CURRENT_UA,
        ceilings.WIDTH_US,
        ceilings.CHARGE_NC,
        ceilings.RATE_HZ,
        ceilings.INTERVAL_US,
        ceilings.MEAN_CURRENT_UA,
        ceilings.ARRAY_MEAN_CURRENT_UA,
        ceilings.NET_CHARGE_NC // 1_000,
        ceilings.PROBE_CURRENT_UA,
        ceilings.PROBE_WIDTH_US,
    ]


def test_the_files_that_it_names_are_there() -> None:
    named = re.findall(r"`((?:daemon|hal)/[\w/]+\.py)`", PAGE)
    assert len(named) >= 5
    assert [name for name in named if not (CLONE / name).is_file()] == []
