"""Converts a caller's "one number per electrode" into a list for JSON.

Owns: lists, tuples, iterables and numpy arrays (without importing numpy), and the errors for other
values. Must not know: the array's size and the limits; the daemon checks those.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from numbers import Integral, Real
from typing import Protocol, TypeAlias, get_args, runtime_checkable

from etd.protocol.errors import Refused
from etd.protocol.frame import MAX_ELECTRODES, MOST_OF_A_TAG, POLARITIES, RETURNS_IN_WORDS
from etd.stabilize.offset_estimate import Answer


@runtime_checkable
class ArrayLike(Protocol):
    """A numpy array, or another object with `tolist`."""

    def tolist(self) -> object: ...


#: One number for each electrode, rows of them shaped as the grid, or `{electrode: number}`.
Numbers: TypeAlias = Iterable[float] | Iterable[Iterable[float]] | Mapping[int, float] | ArrayLike


#: Longer than any session; in nanoseconds it is far from what a clock counts to.
MOST_S = 604_800.0


def levels(values: Numbers) -> list[float]:
    """One number from 0 to 1 per electrode; of a mask True is 1, False is 0. Raises: Refused
    (`bad_frame`), with the electrode.
    """
    return [
        # False for nan, too.
        value if type(value) is float and 0.0 <= value <= 1.0 else _level(index, value)
        for index, value in enumerate(_items("level", values))
    ]


def currents_ua(values: Numbers) -> list[int]:
    """One whole number of microamperes per electrode. Raises: Refused (`bad_frame`)."""
    return [
        # Nearly all are plain numbers, which need no closer look.
        value if type(value) is int else _whole(index, _finite("current_ua", index, value))
        for index, value in enumerate(_items("current_ua", values))
    ]


def option(key: str, value: object, *, is_whole: bool = False) -> object:
    """One value, or one per electrode, as plain numbers or text; `is_whole`: 100.0 is 100. Raises:
    Refused.
    """
    if isinstance(value, (str, bool)) or value is None or type(value) is int:
        return value
    if isinstance(value, Mapping):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        number = _finite(key, None, value)
        return int(number) if is_whole and number == int(number) else number
    return [option(key, item, is_whole=is_whole) for item in _items(key, value)]


def above_zero_s(key: str, value: object) -> float:
    """A duration in seconds. Raises: Refused (`bad_message`)."""
    seconds = above_zero(key, value, "a number of seconds")
    if seconds > MOST_S:
        raise Refused("bad_message", f"{key}={_said(value)}: at most {MOST_S:g} s, a week")
    return seconds


def above_zero(key: str, value: object, what: str = "a number") -> float:
    """Raises: Refused (`bad_message`)."""
    if isinstance(value, Real) and not isinstance(value, bool):
        try:
            number = float(value)
        except OverflowError:  # a whole number may have any number of digits
            number = math.inf
        if 0.0 < number < math.inf:
            return number
    raise Refused("bad_message", f"{key}={_said(value)}: {what} above 0 is needed")


def up_to_s(key: str, value: object, most_s: float) -> float:
    """A duration that has a bound. Raises: Refused (`bad_message`)."""
    seconds = above_zero_s(key, value)
    if seconds > most_s:
        raise Refused("bad_message", f"{key}={_said(value)}: at most {most_s:g} s")
    return seconds


def mark_tag(value: object) -> int | str | None:
    """The tag of a mark, if any. Raises: Refused (`bad_message`)."""
    if value is None:
        return None
    if isinstance(value, str):
        if len(value) > MOST_OF_A_TAG:
            why = f"{len(value)} characters, and at most {MOST_OF_A_TAG} are allowed"
            raise Refused("bad_message", f"tag={value!r:.40}: {why}")
        return str(value)
    if isinstance(value, bool) or not isinstance(value, Integral):
        reason = f"tag={value!r}: a whole number or a text is needed, or nothing"
        raise Refused("bad_message", reason)
    return int(value)


def check_frame_tag(value: object) -> None:
    """A number: each report of the frame repeats it. Raises: Refused (`bad_frame`) for a text."""
    if isinstance(value, str):
        raise Refused(
            "bad_frame",
            f"tag={value!r:.40}: the tag of a frame is a whole number, which every report repeats"
            " that tells of the frame; mark('...') takes a text",
        )


def check_polarity(value: object) -> None:
    """One, or one per electrode. Raises: Refused (`bad_frame`), with the electrode."""
    for index, polarity in enumerate(value if isinstance(value, list) else [value]):
        if polarity not in POLARITIES:
            electrode = index if isinstance(value, list) else None
            where = "polarity" if electrode is None else f"polarity[{electrode}]"
            choices = ", ".join(POLARITIES)
            raise Refused("bad_frame", f"{where}={polarity!r:.40}: choose of {choices}", electrode)


def check_returns(value: object) -> None:
    """Their kind; the daemon checks electrodes and radius. Raises: Refused (`bad_frame`)."""
    is_ring = isinstance(value, Mapping) and set(value) == {"ring_mm"}
    if value != "all" and not is_ring and not isinstance(value, list):
        raise Refused("bad_frame", f"returns={value!r:.60}: give {RETURNS_IN_WORDS}")


def _items(key: str, values: object) -> list[object]:
    if isinstance(values, (list, tuple)):
        return list(values)
    if isinstance(values, ArrayLike):
        values = values.tolist()
    if isinstance(values, (str, bytes, Mapping)) or not isinstance(values, Iterable):
        raise Refused(
            "bad_frame",
            f"{key} is {_called(values)}: give a list, a tuple or an array, one number for each"
            " electrode",
        )
    return list(values)


def _level(index: int, value: object) -> float:
    if isinstance(value, ArrayLike):
        value = value.tolist()
    level = float(value) if isinstance(value, bool) else _finite("level", index, value)
    if not 0.0 <= level <= 1.0:
        raise Refused(
            "bad_frame",
            f"level[{index}] is {level:g}: levels go from 0, silent, to 1, the calibration's"
            " strongest; microamperes are given as current_ua",
            index,
        )
    return level


def _finite(key: str, index: int | None, value: object) -> float:
    where = key if index is None else f"{key}[{index}]"
    if isinstance(value, bool) or not isinstance(value, Real):
        hint = ""
        if isinstance(value, (list, tuple)):
            hint = " (flatten the array first)"
        elif isinstance(value, bool) and key == "current_ua":
            hint = " (a mask says where, not how much: multiply it by microamperes)"
        raise Refused("bad_frame", f"{where} is {_called(value)}: a number is needed{hint}", index)
    if isinstance(value, Integral) and abs(int(value)) >= 2**63:
        raise Refused("bad_frame", f"{where} is a number of more than 64 bits", index)
    if not math.isfinite(value):
        raise Refused("bad_frame", f"{where} is {float(value)}: a finite number is needed", index)
    return int(value) if isinstance(value, Integral) else float(value)


def _whole(index: int, value: float) -> int:
    if value != int(value):
        raise Refused(
            "bad_frame", f"current_ua[{index}] is {value}: whole microamperes are needed", index
        )
    return int(value)


def _said(value: object) -> str:
    """A value as a sentence quotes it."""
    try:
        return f"{value!r:.40}"
    except ValueError:  # Python writes no whole number of thousands of digits
        return "a number of thousands of digits"


def _called(value: object) -> str:
    if isinstance(value, (str, bytes)):
        return f"the text {value!r:.40}"
    return f"a {type(value).__name__}" if value is not None else "missing"


def felt(answer: str, electrodes: Iterable[int] | None) -> dict[str, object]:
    """What a person said, and of which electrodes. Raises: Refused (`bad_message`)."""
    if answer not in get_args(Answer):
        said = ", ".join(get_args(Answer))
        raise Refused("bad_message", f"answer is {answer!r}: it can be {said}")
    if electrodes is None:
        return {"answer": answer}
    return {"answer": answer, "electrodes": _numbers_of(electrodes)}


def _numbers_of(electrodes: object) -> list[int]:
    """Raises: Refused (`bad_message`): a number that is not whole names no electrode."""
    if isinstance(electrodes, ArrayLike):
        electrodes = electrodes.tolist()
    if isinstance(electrodes, (str, bytes, Mapping)) or not isinstance(electrodes, Iterable):
        raise Refused(
            "bad_message",
            f"electrodes={electrodes!r:.40}: give a list of their numbers, as [27], or leave it out"
            " for all",
        )
    named: list[int] = []
    for number in electrodes:
        if isinstance(number, bool) or not isinstance(number, Integral) or number < 0:
            raise Refused(
                "bad_message",
                f"electrodes: {number!r:.40} is no electrode: give whole numbers, from 0 on",
            )
        if int(number) >= MAX_ELECTRODES:
            raise Refused(
                "bad_message",
                f"electrodes: there is no electrode {number!r:.40}: an array has"
                f" {MAX_ELECTRODES} at most, from 0 on",
            )
        named.append(int(number))
    if not named:
        raise Refused("bad_message", "electrodes is empty: name some, or leave it out for all")
    return named
