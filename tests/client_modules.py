"""The modules that the client and its verbs load, found by loading them.

Owns: the search. Must not know: what is checked of them.

`python tests/client_modules.py` prints their files. Beside what is loaded at once it has what a
function of these modules imports later, unless it checks for the daemon's Python before.
"""

from __future__ import annotations

import argparse
import ast
import importlib
import itertools
import pkgutil
import sys
from collections.abc import Iterator
from pathlib import Path

#: Of its functions a client uses those that it imports, `open_...` apart: these open a board, or
#: play one, after a check.
COMPOSE = "etd_hal.compose"
CHECKS = {"check_fake", "check_python"}
#: A client may import these one by one.
PACKAGES = ("etd.client", "etd.protocol")


def client_files() -> list[Path]:
    """To be called in a process of its own: what else is loaded would count."""
    _load_client()
    read: set[str] = set()
    while unread := sorted(_loaded().keys() - read - {COMPOSE}):
        read |= set(unread)
        trees = [_tree(_loaded()[name]) for name in unread]
        used = {name for tree in trees for name in _used_of_compose(tree)}
        composing = [each for each in _functions(_tree(_loaded()[COMPOSE])) if each.name in used]
        for function in itertools.chain(composing, *map(_functions, trees)):
            for later in _imported_late(function):
                importlib.import_module(later)
    return sorted(_loaded().values())


def _load_client() -> None:
    import etd
    from etd import cli

    for name in etd.__all__:
        getattr(etd, name)
    for package in PACKAGES:
        for module in pkgutil.iter_modules(importlib.import_module(package).__path__):
            importlib.import_module(f"{package}.{module.name}")
    for verb in cli.VERBS:
        if verb not in cli.DAEMON_VERBS:
            module_of_verb = importlib.import_module(f"etd.cli.{verb}")
            module_of_verb.add_arguments(argparse.ArgumentParser())


def _loaded() -> dict[str, Path]:
    return {
        name: Path(str(module.__file__))
        for name, module in list(sys.modules.items())
        if name.partition(".")[0] in ("etd", "etd_hal", "etd_body")
    }


def _tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def _functions(tree: ast.Module) -> Iterator[ast.FunctionDef | ast.AsyncFunctionDef]:
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            yield node


def _used_of_compose(tree: ast.Module) -> Iterator[str]:
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module == COMPOSE:
            yield from (each.name for each in node.names if not each.name.startswith("open_"))


def _imported_late(function: ast.FunctionDef | ast.AsyncFunctionDef) -> Iterator[str]:
    """The project's modules that it imports without a check before."""
    unchecked = itertools.takewhile(lambda statement: not _is_check(statement), function.body)
    for node in itertools.chain.from_iterable(map(ast.walk, unchecked)):
        if isinstance(node, ast.ImportFrom) and node.module and node.module.startswith("etd"):
            yield node.module
            for each in node.names:
                if _is_module(node.module, each.name):
                    yield f"{node.module}.{each.name}"


def _is_module(package: str, name: str) -> bool:
    path = getattr(importlib.import_module(package), "__path__", ())
    return any(module.name == name for module in pkgutil.iter_modules(path))


def _is_check(statement: ast.stmt) -> bool:
    return (
        isinstance(statement, ast.Expr)
        and isinstance(statement.value, ast.Call)
        and isinstance(statement.value.func, ast.Name)
        and statement.value.func.id in CHECKS
    )


if __name__ == "__main__":
    print(*client_files())
