"""docs/files.md says of each maximum of a body site what the code allows at most."""

from __future__ import annotations

import re
from pathlib import Path

from etd.files.body_site import SiteMaxima
from etd_hal import ceilings

PAGE = Path(__file__).parents[2] / "docs" / "files.md"


def test_the_ceilings_in_brackets_are_those_of_the_code() -> None:
    found = re.findall(
        r"^([a-z_]+) = [\d_]+ .*# .*\[([\d ]+)\]$", PAGE.read_text(encoding="utf-8"), re.MULTILINE
    )
    said = {key.upper(): int(number.replace(" ", "")) for key, number in found}
    assert said == {
        name: getattr(ceilings, name)
        for name in map(str.upper, SiteMaxima.__struct_fields__)
        if hasattr(ceilings, name)
    }
