"""What the benchmark of steadiness writes into the docs."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench import steady_docs
from bench.run import at_most
from bench.steady_figures import SteadyFigures

ROW = SteadyFigures("contact", 2.0, 0.4, 0.1, 0.05, 0.01, 10, 10, 1.5, 1.1, 0.5, 0, 3, 20, 4, 1_000)
SAID = "64 electrodes; fingers of seeds [7]"


def page(at: Path) -> Path:
    path = at / "page.md"
    marks = "<!-- written by make bench-steady -->\nold\n<!-- so far -->\n"
    path.write_text(f"before\n{marks}after\n", encoding="utf-8")
    return path


def test_only_what_lies_between_the_marks_is_written_anew(tmp_path: Path) -> None:
    path = page(tmp_path)
    for _ in range(2):
        steady_docs.write(path, [ROW], [at_most("a bound", 1.3, 1.2)], SAID)
    text = path.read_text(encoding="utf-8")
    assert text.startswith("before\n<!-- written")
    assert text.endswith("<!-- so far -->\nafter\n")
    assert "old" not in text
    assert text.count(SAID) == 1
    assert "| contact | 2.00 | 40.0% | 10.0% | 5.0% | 1.000% (10) | 1.50 | 1.10 | 0.50 |" in text
    assert "| 0.50 | 0 of 20, 4 not judged | 3 |\n" in text
    assert "**Not met**: a bound: 1.3 (bound 1.2)" in text


def test_a_page_without_the_marks_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "page.md"
    path.write_text("nothing\n", encoding="utf-8")
    with pytest.raises(ValueError, match="lost its marks"):
        steady_docs.write(path, [ROW], [], SAID)
    assert path.read_text(encoding="utf-8") == "nothing\n"


def test_the_docs_have_the_marks() -> None:
    text = steady_docs.PAGE.read_text(encoding="utf-8")
    assert text.count("<!-- written by make bench-steady -->\n") == 1
    assert text.count("<!-- so far -->\n") == 1
