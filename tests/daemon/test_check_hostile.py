"""`etd check` of files that nobody would write: a result or a sentence, soon.

Owns: sizes, numbers and words that a reader could choke on.
"""

from __future__ import annotations

import json
import resource
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from etd.cli.check import lines_of
from etd.files.check import Checked, check_file
from etd.files.json_file import MAX_BYTES

pytestmark = pytest.mark.slow

#: What a file of 240 kB may take of the processor; before, some took minutes.
SOON_S = 3.0
SIZE_BYTES = 240_000
DIGITS = 5_000
#: The longest sentence about a file.
MOST_CHARACTERS = 1_200


def taken_s() -> float:
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def checked(folder: Path, name: str, data: bytes) -> Checked:
    path = folder / name
    path.write_bytes(data)
    return check_file(path)


def filled(piece: bytes, end: bytes = b"") -> bytes:
    return piece * (SIZE_BYTES // len(piece)) + end


HOSTILE = {
    "words.json": filled(b"word "),
    "lines.json": filled(b"word\n"),
    "list.json": b"[" + filled(b"word, ", b"word]"),
    "quotes.json": filled(b'"'),
    "escapes.json": filled(b'"\\'),
    "commas.json": b"[" + filled(b", ", b"1]"),
    "digits.json": filled(b"1"),
    "keys.json": b"{" + b"".join(b'"%d":1,' % one for one in range(24_000)) + b'"a":1,"a":2}',
    "words.toml": filled(b"word "),
    "dots.toml": filled(b"a.", b"b = 1"),
    "header.toml": b"[" + filled(b"a.", b"b]"),
    "quoted.toml": filled(b'"a" . ', b"b = 1"),
    "literal.toml": filled(b"'a'.", b"b = 1"),
    "escaped.toml": filled(b'"\\"".', b'"\\"" = 1'),
    "escaped-tables.toml": b"".join(b'"\\"%d".a = 1\n' % one for one in range(SIZE_BYTES // 16)),
    "inline-tables.toml": b"x = {" + b",".join(b"k%d.a=1" % one for one in range(20_000)) + b"}",
    "open.toml": b'"' + filled(b'\\"'),
    "inline.toml": b"x = {" + filled(b"a.", b"b = 1}"),
    "brackets.toml": b"x = " + filled(b"[1,"),
    "keys.toml": b"".join(b"word%d = 1\n" % number for number in range(SIZE_BYTES // 14)),
    "digits.toml": b"width_us = " + filled(b"1"),
    "spaces.toml": b"a" + filled(b" ", b"= 1"),
    "text.toml": b'title = "' + filled(b"a", b'"'),
    "strings.toml": b'title = """' + filled(b'"a'),
}


@pytest.mark.parametrize("name", HOSTILE)
def test_it_is_told_soon_and_in_short(tmp_path: Path, name: str) -> None:
    before_s = taken_s()
    answer = checked(tmp_path, name, HOSTILE[name])
    assert taken_s() - before_s < SOON_S
    assert answer.error is not None
    printed = lines_of(answer)
    assert all(len(line) <= MOST_CHARACTERS for line in printed)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", f'{{"etd_pattern": {"1" * DIGITS}}}'),
        ("b.json", f'{{"etd_pattern": 1, "electrodes": -{"1" * 4299}, "frames": [1]}}'),
        ("a.toml", f"width_us = {'1' * DIGITS}\n"),
        ("b.toml", f"participant = 0x{'f' * DIGITS}\n"),
        ("c.toml", f"participant = 0o{'7' * DIGITS}\n"),
        ("d.toml", f"participant = [0b{'1' * 4 * DIGITS}]\n"),
        ("e.toml", f"width_us = -{'1' * DIGITS}\n"),
        ("f.toml", f"polarity = 0x{'f' * DIGITS}\n"),
    ],
)
def test_a_number_of_thousands_of_digits_is_refused_in_a_sentence(
    tmp_path: Path, name: str, text: str
) -> None:
    answer = checked(tmp_path, name, text.encode())
    assert answer.error is not None
    assert "set_int_max_str_digits" not in answer.error
    assert len(answer.error) < 500


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("key.json", '{"etd_pattern": 1, "electro\\ud800des": 4}'),
        ("value.json", '{"electrodes": [{"x": "\\uDFFF", "y": 0}, {"x": 1, "y": 0}]}'),
        ("mended.json", '{"Pattern_Data": [[1]], "half\\udc00": word,}'),
    ],
)
def test_half_of_a_pair_of_surrogates_is_refused_in_a_sentence(
    tmp_path: Path, name: str, text: str
) -> None:
    answer = checked(tmp_path, name, text.encode())
    assert "half of a character" in str(answer.error)
    whole = '{"etd_pattern": 1, "electrodes\\ud83d\\ude00": 4}'
    assert "half of a character" not in str(checked(tmp_path, name, whole.encode()).error)


def test_names_of_many_parts_are_refused_and_numbers_with_points_are_not(tmp_path: Path) -> None:
    answer = checked(tmp_path, "a.toml", b".".join([b"a"] * 40) + b" = 1\n")
    assert answer.error is not None
    assert "joined by points" in answer.error
    for line in (b"[" + b", ".join([b"1.5"] * 500) + b"]", b"'" + b"1.5 " * 500 + b"'"):
        answer = checked(tmp_path, "b.toml", b"width_us = " + line + b"\n")
        assert "joined by points" not in str(answer.error)


@pytest.mark.parametrize(
    "line", [b"[a%d.b.c.d.e.f]", b"a%d.b.c.d.e = 1", b" 'a%d' . b = 1", b"[[a%d]]"]
)
def test_more_tables_than_any_file_has_are_refused_before_they_are_read(
    tmp_path: Path, line: bytes
) -> None:
    """Half a megabyte of these takes 160 MB."""
    few, many = (b"\n".join(line % number for number in range(n)) for n in (2_000, 2_001))
    assert "more than 2000 tables" in str(checked(tmp_path, "many.toml", many).error)
    assert "more than" not in str(checked(tmp_path, "few.toml", few).error)


def test_bare_words_beyond_a_hundred_are_counted(tmp_path: Path) -> None:
    words = b"[" + b",\n".join(b"w%d" % number for number in range(150)) + b"]"
    data = b'{"electrodes": [{"x": 0, "y": 0}, {"x": 2, "y": 0}], "note": ' + words + b"}"
    answer = checked(tmp_path, "kit.json", data)
    assert answer.error is None, answer.error
    told = [sentence for sentence in answer.mended if "bare word" in sentence]
    assert len(told) == 100
    assert told[99] == "line 100: the bare word w99 was taken as text"
    assert "50 more" in "; ".join(answer.mended)


def test_a_file_that_is_too_large_is_told_its_bound(tmp_path: Path) -> None:
    answer = checked(tmp_path, "a.json", b" " * (MAX_BYTES + 1))
    assert str(MAX_BYTES) in str(answer.error)
    answer = checked(tmp_path, "a.toml", b"#" * (1024 * 1024 + 1))
    assert "1048576" in str(answer.error)


BYTES = st.binary(max_size=3_000)
TOML_LIKE = st.lists(
    st.sampled_from(
        ["name", "=", '"a"', "[", "]", "{", "}", "0xffffffffffffffffffff", "1e999", "nan", ".",
         ",", "\n", "'", "electrode", "width_us", "-1", "polarity", "1979-05-27", "\u2028",
         "\x1b", "'''"]
    ), max_size=60,
).map(lambda pieces: " ".join(pieces).encode())  # fmt: skip
JSON_LIKE = st.recursive(
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=8)
    | st.sampled_from([10**400, -(10**400)]),
    lambda inner: (
        st.lists(inner, max_size=4)
        | st.dictionaries(
            st.sampled_from(["etd_pattern", "electrodes", "frames", "Pattern_Data", "x", "level"]),
            inner,
            max_size=4,
        )
    ),
    max_leaves=20,
).map(lambda data: json.dumps(data).encode())


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    data=BYTES | TOML_LIKE | JSON_LIKE | JSON_LIKE.map(lambda data: data[:-1]),
    name=st.sampled_from(["a.json", "a.toml", "a"]),
)
def test_any_bytes_give_a_result_or_a_sentence(tmp_path: Path, data: bytes, name: str) -> None:
    answer = checked(tmp_path, name, data)
    assert answer.error is not None or answer.summary
    for line in lines_of(answer):
        assert line.isprintable()
        assert len(line) <= MOST_CHARACTERS
