"""A module of ours with a mistake, loaded instead of the one in its file; or put into one that is.

Owns: both ways. Must not know: which mistakes there are, tests.
"""

from __future__ import annotations

import gc
import importlib.abc
import importlib.machinery
import importlib.util
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from importlib.machinery import ModuleSpec
from pathlib import Path
from types import CodeType, FunctionType, ModuleType

#: Where a module's package begins, from the root of the tree.
ROOTS = ("daemon", "hal")

_Key = tuple[str, int]


class NotSo(Exception):
    """This mistake cannot be put into a module that is loaded."""


def module_name(path: str) -> str:
    """Of a path within the tree: `hal/etd_hal/guard.py` is `etd_hal.guard`."""
    parts = Path(path).with_suffix("").parts
    return ".".join(parts[1:] if parts[0] in ROOTS else parts)


class _Loader(importlib.machinery.SourceFileLoader):
    def __init__(self, name: str, path: str, code: CodeType) -> None:
        super().__init__(name, path)
        self._code = code

    def get_code(self, fullname: str) -> CodeType:
        return self._code


class _Finder(importlib.abc.MetaPathFinder):
    def __init__(self, name: str, path: Path, code: CodeType) -> None:
        self._name = name
        self._path = str(path)
        self._code = code

    def find_spec(
        self, fullname: str, path: Sequence[str] | None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        if fullname != self._name:
            return None
        loader = _Loader(fullname, self._path, self._code)
        return importlib.util.spec_from_file_location(fullname, self._path, loader=loader)


def load_instead(name: str, path: Path, code: CodeType) -> None:
    """Whoever imports the module from now on gets this code. Nobody may have imported it yet."""
    assert name not in sys.modules, f"{name} is loaded already"
    sys.meta_path.insert(0, _Finder(name, path, code))


class Loaded:
    """The functions of a module that is loaded, wherever they are known."""

    def __init__(self, path: Path, code: CodeType) -> None:
        """`code`: as it was loaded. What was frozen by the garbage collector is looked at too."""
        self._before = dict(_codes(code))
        gc.unfreeze()
        self._functions: dict[CodeType, list[FunctionType]] = {}
        for one in gc.get_objects():
            if isinstance(one, FunctionType) and one.__code__.co_filename == str(path):
                self._functions.setdefault(one.__code__, []).append(one)
        gc.freeze()

    def put(self, code: CodeType) -> None:
        """The functions are those of `code` from now on. Raises: NotSo."""
        after = dict(_codes(code))
        changed = [key for key, one in self._before.items() if after.get(key) != one]
        for key in changed:
            # Of two functions that begin in one line under one name it is not known which is which.
            if key not in after or after[key] is None or self._before[key] is None:
                raise NotSo(key)
            for function in self._functions.get(self._before[key], ()):  # type: ignore[arg-type]
                try:
                    function.__code__ = after[key]  # type: ignore[assignment]
                except ValueError as error:
                    raise NotSo(key) from error


def _codes(code: CodeType) -> Iterator[tuple[_Key, CodeType | None]]:
    """Of all functions in it; None: where a name and a line are those of several."""
    found = list(_within(code))
    counts = Counter(key for key, _ in found)
    for key, one in found:
        yield key, one if counts[key] == 1 else None


def _within(code: CodeType) -> Iterator[tuple[_Key, CodeType]]:
    for one in code.co_consts:
        if isinstance(one, CodeType):
            yield (one.co_qualname, one.co_firstlineno), one
            yield from _within(one)
