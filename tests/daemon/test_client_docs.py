"""The page of the client is that of the code."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from client_docs import page, public
from etd import AsyncDisplay, Display

PAGE = Path(__file__).parents[2] / "docs" / "client.md"


def test_the_page_is_the_one_that_the_docstrings_make() -> None:
    assert PAGE.read_text("utf-8") == page(), "run: python tests/client_docs.py > docs/client.md"


@pytest.mark.parametrize("name", sorted(public(Display)))
def test_it_has_every_method(name: str) -> None:
    assert re.search(rf"^\*\*`{name}[(:]", page(), re.MULTILINE)


def test_both_displays_have_the_same_methods() -> None:
    assert public(AsyncDisplay) - public(Display) == {"connect", "greet"}
    assert public(Display) <= public(AsyncDisplay)
