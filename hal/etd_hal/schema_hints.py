"""What a type allows at a key of a file, in words for the person who edits the file.

Owns: the way from a struct's type to a sentence: bounds, choices, keys, the nearest right word.
Must not know: what any file is about, what was wrong.
"""

from __future__ import annotations

import difflib
import json
import re
from collections.abc import Iterable, Iterator, Sequence

from msgspec import inspect

from etd_hal import names

#: More keys than this are no help in the middle of a sentence.
_FEW_KEYS = 4

Alternatives = tuple[inspect.Type, ...]


def key_path(kind: type, data: object, key: str) -> tuple[Alternatives, object]:
    """What may stand at `key` (msgspec's path: `a.b[1].c`), and what stands there.

    The alternatives are empty where the path leads out of the type; the data are None where it
    leads out of them.
    """
    found = _flat(inspect.type_info(kind))
    for index, name in re.findall(r"\[([^\]]*)\]|([^.\[\]]+)", key):
        found = tuple(_step(_of_tag(found, data), name or index))
        data = _inside(data, name, index)
    return _of_tag(found, data), data


def in_words(alternatives: Alternatives) -> str:
    """`a whole number from 2 to 27 or "absent"`."""
    choices = [word for each in alternatives for word in _words(each)]
    return _either(dict.fromkeys(choices))


def keys_of(alternatives: Alternatives) -> tuple[str, ...]:
    """The keys of the tables among the alternatives."""
    return tuple(dict.fromkeys(key for alternative in alternatives for key in _keys(alternative)))


def meant(wrong: object, right: Iterable[str]) -> str:
    """A question with the nearest right word, if one is near."""
    near = difflib.get_close_matches(str(wrong), list(right), 1)
    return f" (is {near[0]} meant?)" if near else ""


def words_of_choice(alternatives: Alternatives) -> tuple[str, ...]:
    """The texts to choose from."""
    values = (
        alternative.values
        for alternative in alternatives
        if isinstance(alternative, inspect.LiteralType)
    )
    return tuple(value for each in values for value in each if isinstance(value, str))


# --- the way through a type ----------------------------------------------------------------------


def _flat(kind: inspect.Type) -> Alternatives:
    if isinstance(kind, inspect.Metadata):
        return _flat(kind.type)
    if isinstance(kind, inspect.UnionType):
        return tuple(alternative for each in kind.types for alternative in _flat(each))
    return (kind,)


def _step(alternatives: Alternatives, part: str) -> Iterator[inspect.Type]:
    tags: list[str | int] = []
    for kind in alternatives:
        if isinstance(kind, inspect.StructType):
            if kind.tag_field == part and kind.tag is not None:
                tags.append(kind.tag)
            for field in kind.fields:
                if field.encode_name == part:
                    yield from _flat(field.type)
        elif isinstance(kind, inspect.VarTupleType | inspect.ListType):
            yield from _flat(kind.item_type)
        elif isinstance(kind, inspect.DictType):
            yield from _flat(kind.value_type)
    if tags:
        yield inspect.LiteralType(tuple(tags))


def _of_tag(alternatives: Alternatives, data: object) -> Alternatives:
    """Of tables distinguished by a tag, only the table that the data name, if they name one."""
    if not isinstance(data, dict):
        return alternatives
    named = tuple(
        alternative
        for alternative in alternatives
        if isinstance(alternative, inspect.StructType)
        and alternative.tag_field
        and data.get(alternative.tag_field) == alternative.tag
    )
    return named or alternatives


def _inside(data: object, name: str, index: str) -> object:
    if name and isinstance(data, dict):
        return data.get(name)
    if index.isdigit() and isinstance(data, list | tuple) and int(index) < len(data):
        return data[int(index)]
    return None


# --- words ---------------------------------------------------------------------------------------


def _words(kind: inspect.Type) -> Iterator[str]:
    match kind:
        case inspect.LiteralType():
            yield from (json.dumps(one) for one in kind.values)
        case inspect.IntType():
            yield f"a whole number{_range(kind)}"
        case inspect.FloatType():
            yield f"a number{_range(kind)}"
        case inspect.BoolType():
            yield "true or false"
        case inspect.DateType():
            yield "a date such as 2025-01-15"
        case inspect.StrType():
            yield f"text in quotes{_text_bounds(kind)}"
        case inspect.VarTupleType() | inspect.ListType():
            tables = any(
                isinstance(alternative, inspect.StructType) for alternative in _flat(kind.item_type)
            )
            yield f"a list{' of tables' if tables else ''}{_lengths(kind, ' entries')}"
        case inspect.StructType():
            keys = _keys(kind)
            yield f"a table of {_either(keys, 'and')}" if len(keys) <= _FEW_KEYS else "a table"
        case inspect.DictType():
            yield "a table"


def _range(kind: inspect.IntType | inspect.FloatType) -> str:
    if kind.ge is not None and kind.le is not None:
        return f" from {_number(kind.ge)} to {_number(kind.le)}"
    told = " and ".join(
        f"{word} {_number(bound)}"
        for word, bound in (
            ("at least", kind.ge), ("above", kind.gt), ("at most", kind.le), ("below", kind.lt)
        )
        if bound is not None
    )  # fmt: skip
    return f" of {told}" if told.startswith("at ") else f" {told}".rstrip()


def _text_bounds(kind: inspect.StrType) -> str:
    if kind.pattern is not None:
        return f" that fits {names.in_words(kind.pattern)}"
    return _lengths(kind, " characters")


def _lengths(kind: inspect.StrType | inspect.VarTupleType | inspect.ListType, what: str) -> str:
    least, most = kind.min_length, kind.max_length
    if least is not None and most is not None:
        return f" of {least} to {most}{what}"
    if least is not None:
        return f" of at least {least}{what}"
    return f" of at most {most}{what}" if most is not None else ""


def _number(bound: float) -> str:
    return repr(bound).removesuffix(".0")


def _keys(kind: inspect.Type) -> tuple[str, ...]:
    if not isinstance(kind, inspect.StructType):
        return ()
    tag = (kind.tag_field,) if kind.tag_field else ()
    return (*tag, *(field.encode_name for field in kind.fields))


def _either(each: Iterable[str], word: str = "or") -> str:
    said: Sequence[str] = list(each)
    if len(said) < 2:
        return "".join(said)
    return f"{', '.join(said[:-1])} {word} {said[-1]}"
