"""Plain records in tests: compared by what is in them, and changed in a part.

Owns: both, for records compiled or not; they themselves are the same only if they are one object.
What a record makes of its fields, and keeps to itself, is left out. Must not know: which records
there are.
"""

from __future__ import annotations

from inspect import isgetsetdescriptor, ismemberdescriptor
from typing import Any, TypeVar

T = TypeVar("T")


def changed(record: T, **values: Any) -> T:
    """The same record, these fields apart: each is an argument of its class by name."""
    fields = {name: getattr(record, name) for name in _names(record)}
    return type(record)(**{**fields, **values})


def told(value: Any) -> Any:
    """What is in a record, and in the records in it: to be compared."""
    if isinstance(value, list):
        return [told(one) for one in value]
    is_plain = type(value).__eq__ is object.__eq__  # type: ignore[comparison-overlap]
    if is_plain and type(value).__module__.startswith("etd"):
        return type(value), {name: told(getattr(value, name)) for name in _names(value)}
    return value


def _names(record: object) -> list[str]:
    members = [pair for each in type(record).__mro__[:-1] for pair in vars(each).items()]
    return [
        name
        for name, member in members
        if (ismemberdescriptor(member) or isgetsetdescriptor(member)) and not name.startswith("_")
    ]
