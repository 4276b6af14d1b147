"""What a TOML text may have before it is parsed: names joined by points, and tables.

Owns: that both are counted as TOML reads them, whatever stands in strings and comments.
"""

from __future__ import annotations

import resource
import tomllib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd_hal.toml_bounds import MOST_PARTS, MOST_TABLES, why_not

PARTS = ("a", "a-b_1", '"a b"', "'a.b'", r'"\"."', r'"\\"', "'\"'")
#: In none of these is a name joined to another, or a table begun.
VALUES = (
    "1.5",
    "[1.5, 2.5]",
    '"a.b.c = [1]"',
    r'"\"a.b\""',
    "'a.b'",
    '"""\n[a]\na.b = "" \\""" \n"""',
    "'''\n[a]\na.b = ''1\n'''",
    "{ a = 1, b = 'c.d' }",
    # A quote or two of its own before those that end it.
    '["""a.b""""", """[c].d""""]',
    "['''a.b''''', '''[c].d'''']",
    "{ \"a.1\" = 1, 'b.c' = 2 }",
)


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("point", [".", " .\t"])
def test_names_of_any_form_that_are_joined_are_counted(part: str, point: str) -> None:
    deep = point.join([part] * MOST_PARTS)
    for text in (f"{deep} = 1", f"[{deep}]", f"x = {{{deep} = 1}}"):
        tomllib.loads(text)
        assert why_not(text) is None
    for text in (f"{deep}.{part} = 1", f"[{deep}.{part}]", f"x = {{{deep}.{part} = 1}}"):
        assert "joined by points" in (why_not(text) or "")


@pytest.mark.parametrize(
    "table",
    ["[k{}]\n", "k{}.a = 1\n", r'"\"{}".a = 1' + "\n", "x{} = {{ k.a = 1 }}\n"],
)
def test_tables_of_any_form_are_counted(table: str) -> None:
    each = [table.format(number) for number in range(MOST_TABLES + 1)]
    assert why_not("".join(each[:-1])) is None
    assert "tables" in (why_not("".join(each)) or "")


@given(st.lists(st.sampled_from(VALUES), max_size=20), st.sampled_from(["", ' # "a.b" = [\'']))
def test_what_stands_in_values_and_comments_is_not_counted(values: list[str], end: str) -> None:
    lines = [f"k{number} = {value}{end}\n" for number, value in enumerate(values)]
    tomllib.loads("".join(lines))
    assert why_not("".join(lines) * (MOST_TABLES // 4)) is None


@pytest.mark.parametrize("text", ['x = ["""a"""", """b"""]', "x = ['''a'''', '''b''']"])
def test_nothing_is_hidden_behind_a_text_that_ends_in_more_quotes(text: str) -> None:
    tomllib.loads(text)
    assert "joined by points" in (why_not(f"{text}\n{'.'.join('a' * 17)} = 1") or "")
    assert "tables" in (why_not(text + "\n[[a]]" * (MOST_TABLES + 1)) or "")


@pytest.mark.parametrize("opened", ['"""', "'''", '"', "'", "a.", ""])
@pytest.mark.parametrize("piece", ['\\"""\n', "\\", '"', "'", ". ", '\\"'])
@pytest.mark.parametrize("end", ["\\", "", '"'])
def test_the_walk_takes_a_time_that_grows_with_the_text_alone(
    opened: str, piece: str, end: str
) -> None:
    """A text that never ends must not be walked to its end again from each of its places."""
    before_s = resource.getrusage(resource.RUSAGE_SELF).ru_utime
    why_not(f"{opened}\n{piece * 40_000}{end}")
    assert resource.getrusage(resource.RUSAGE_SELF).ru_utime - before_s < 2.0


@given(st.text("ab.=[]{}\"'\\# \n\t,", max_size=200))
def test_any_text_has_an_answer(text: str) -> None:
    assert why_not(text) is None
