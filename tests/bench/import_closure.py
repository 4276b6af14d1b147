"""The files of this clone that a module is made of: itself, and all that it imports, and so on.

Owns: finding them, by the import statements in the text, wherever in a module they stand. Must not
know: what the modules do.

What a module imports by a name that it makes up is not found.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator, Sequence
from pathlib import Path


def closure(first: Sequence[Path], roots: Sequence[Path]) -> set[Path]:
    """Of these files; `roots`: the folders that modules are looked for in, in this order."""
    found: set[Path] = set()
    left = [path.resolve() for path in first]
    while left:
        path = left.pop()
        if path in found:
            continue
        found.add(path)
        left += [file for name in _named(path) for file in _files(name, roots)]
    return found


def _named(path: Path) -> Iterator[str]:
    """Modules, and what is taken from one: that may be a module as well."""
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            yield from (one.name for one in node.names)
        elif isinstance(node, ast.ImportFrom):
            if node.level or node.module is None:
                raise ValueError(f"{path}: a relative import is not followed")
            yield node.module
            yield from (f"{node.module}.{one.name}" for one in node.names)


def _files(name: str, roots: Sequence[Path]) -> Iterator[Path]:
    """The module's, with the packages that it lies in; none where it is not of this clone."""
    parts = name.split(".")
    for root in roots:
        for end in range(1, len(parts) + 1):
            place = root.joinpath(*parts[:end])
            for file in (place / "__init__.py", place.with_suffix(".py")):
                if file.is_file():
                    yield file.resolve()
