"""Converts a caller's "one number per electrode" into a list for JSON.

Owns: lists, tuples, iterables and numpy arrays (without importing numpy), and the errors for other
values. Must not know: the array's size and the limits; the daemon checks those.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from numbers import Integral, Real
from typing import Protocol, TypeAlias, runtime_checkable

from etd.protocol.errors import Refused


@runtime_checkable
class ArrayLike(Protocol):
    """A numpy array, or another object with `tolist`."""

    def tolist(self) -> object: ...


#: One number for each electrode, rows of them shaped as the grid, or `{electrode: number}`.
Numbers: TypeAlias = Iterable[float] | Iterable[Iterable[float]] | Mapping[int, float] | ArrayLike


def levels(values: Numbers) -> list[float]:
    """One finite number per electrode. Raises: Refused (`bad_frame`), with the electrode."""
    return [
        value if type(value) is float and math.isfinite(value) else _finite("level", index, value)
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
    if isinstance(value, Real) and not isinstance(value, bool):
        seconds = float(value)
        if 0.0 < seconds < math.inf:
            return seconds
    raise Refused("bad_message", f"{key}={value!r}: a number of seconds above 0 is needed")


def up_to_s(key: str, value: object, most_s: float) -> float:
    """A duration that has a bound. Raises: Refused (`bad_message`)."""
    seconds = above_zero_s(key, value)
    if seconds > most_s:
        raise Refused("bad_message", f"{key}={value!r}: at most {most_s:g} s")
    return seconds


def tag(value: object) -> int | None:
    """The tag of a mark, if any. Raises: Refused (`bad_message`)."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, Integral):
        raise Refused("bad_message", f"tag={value!r}: a whole number is needed, or nothing")
    return int(value)


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


def _finite(key: str, index: int | None, value: object) -> float:
    where = key if index is None else f"{key}[{index}]"
    if isinstance(value, bool) or not isinstance(value, Real):
        flat = "" if not isinstance(value, (list, tuple)) else " (flatten the array first)"
        raise Refused("bad_frame", f"{where} is {_called(value)}: a number is needed{flat}", index)
    if not math.isfinite(value):
        raise Refused("bad_frame", f"{where} is {float(value)}: a finite number is needed", index)
    return int(value) if isinstance(value, Integral) else float(value)


def _whole(index: int, value: float) -> int:
    if value != int(value):
        raise Refused(
            "bad_frame", f"current_ua[{index}] is {value}: whole microamperes are needed", index
        )
    return int(value)


def _called(value: object) -> str:
    if isinstance(value, (str, bytes)):
        return f"the text {value!r:.40}"
    return f"a {type(value).__name__}" if value is not None else "missing"
