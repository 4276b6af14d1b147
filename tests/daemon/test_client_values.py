"""What a program may give for a level, a width, a tag: numbers of any kind, masks, words."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest

from etd import Display, Refused
from etd.protocol.link import SetMark
from gateway_rig import ServedRig

pytestmark = pytest.mark.slow


@pytest.fixture
def rig() -> Iterator[ServedRig]:
    with ServedRig() as rig:
        yield rig


def display(rig: ServedRig) -> Display:
    return Display(address=rig.address, max_current_ua=3000, width_us=100, client="me")


@pytest.mark.parametrize(
    "mask",
    [
        [True, False, False, True],
        np.array([1, 0, 0, 1], dtype=bool),
        {0: True, 3: np.bool_(True)},
        [np.bool_(True), 0, 0, True],
    ],
    ids=["list", "array", "mapping", "numpy scalars"],
)
def test_true_is_level_1(rig: ServedRig, mask: Any) -> None:
    with display(rig) as d:
        d.show(mask)
    assert rig.engine.frames[0].frame.level == (1, 0, 0, 1)


@pytest.mark.parametrize("mask", [[True, False, False, True], np.array([1, 0, 0, 1], dtype=bool)])
def test_true_is_no_current(rig: ServedRig, mask: Any) -> None:
    with display(rig) as d, pytest.raises(Refused, match=r"\[0\] is a bool.*by microamperes"):
        d.show_current(mask)
    assert rig.engine.heard == []


def test_a_width_of_100_0_is_100(rig: ServedRig) -> None:
    with display(rig) as d:
        d.show_current([900, 0, 0, 0], width_us=100.0)  # type: ignore[arg-type]
    assert rig.engine.frames[0].frame.width_us == 100


def test_a_frame_has_no_text_for_a_tag_and_says_what_has(rig: ServedRig) -> None:
    with display(rig) as d, pytest.raises(Refused, match=r"whole number.*mark\('\.\.\.'\)"):
        d.show([0] * 4, tag="block 2")  # type: ignore[arg-type]
    assert rig.engine.heard == []


@pytest.mark.parametrize("tag", [math.nan, 1.5, True, "x" * 65])
def test_a_mark_has_a_whole_number_or_a_short_text(rig: ServedRig, tag: Any) -> None:
    with display(rig) as d:
        d.arm()
        with pytest.raises(Refused, match="tag="):
            d.mark(tag)


@pytest.mark.parametrize(
    ("tag", "marked"),
    [
        (None, None),
        (7, 7),
        (np.int64(7), 7),
        ("begin block 2", "begin block 2"),
        (np.str_("é" * 64), "é" * 64),
    ],
)
def test_a_mark_reaches_the_engine_as_it_was_given(rig: ServedRig, tag: Any, marked: Any) -> None:
    with display(rig) as d:
        d.arm()
        assert d.mark(tag).marked_ns == 42
    marks = [command.tag for command in rig.engine.heard if isinstance(command, SetMark)]
    assert marks == [marked]


def test_a_mark_that_would_act_on_a_terminal_is_refused(rig: ServedRig) -> None:
    with display(rig) as d:
        d.arm()
        with pytest.raises(Refused, match="tag: a text has no control characters, line breaks"):
            d.mark("one\ntwo")
