"""Tests stand at the wire: they replace no method of our classes, and read nothing that is private.

Owns: how that is seen in the source of a test, and the few that may. A fault comes in through a
port (`Backend`, `Bench`), through the fake's second door, or through a file.
"""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
OURS = ("etd", "etd_hal", "etd_body")
#: Of other people's, public in spite of their names.
OF_OTHERS = {"os._exit"}

#: Where it is done all the same: the file, what is reached for, and why.
EXCEPTIONS = {
    # The commands of a package that is not there, and of a machine that has no SPI.
    "daemon/test_cli_calibrate.py": {"quest_plus._fresh"},
    "daemon/test_cli_safe_lines.py": {
        "linux_gpio.LinuxGpio",
        "linux_gpio.DEVICES",
        "linux._open_spi",
    },
    "hal/test_linux_gpio_request.py": {"linux_gpio.DEVICES"},
    "hal/test_linux_open.py": {"linux._open_spi"},
    "hal/test_linux_kill_test_process.py": {"kill_test_process.open_lines"},
    # The whole command runs, and opens its own bench: there is no port to hand in.
    "daemon/test_cli_main.py": {"etd.cli.disarm.run"},
    "daemon/test_cli_selftest.py": {
        *("FakeOperator.clip", "Table.stage", "Board.safe_off", "selftest_ending.MOST_S"),
        "etd.cli.selftest.open_linux_bench",
    },
    # The folders of a system that tests must not write to.
    "daemon/test_client_paths.py": {
        *("paths.SYSTEM_RUNTIME", "paths.SYSTEM_STATE", "paths.USER_RUNTIMES")
    },
    "daemon/test_selftest_gate.py": {
        "etd.files.paths.SYSTEM_STATE",
        "etd.selftest.arming_gate.arming_refusal",
    },
    # A channel is filled to its last byte; and the turn in which the engine's end is not read yet.
    "daemon/test_gateway_engine.py": {"gateway._engine", "_engine._channels"},
    "daemon/test_gateway_streams.py": {"gateway._engine", "_engine._channels"},
    # A signal may come behind any step of a call, also within the fake.
    "models/test_selftest_interrupted.py": {"*place"},
    # What is published must fall with the model, and with the engine's softening.
    "daemon/test_explain.py": {"Membrane.step_response", "Membrane.final"},
    "models/test_steady_bodies.py": {"SoftStart.touched_again"},
    # A law breaks down; pressure without sensors.
    "daemon/test_engine_probe_first.py": {"rig.engine.components.adapter.readapt"},
    "daemon/test_engine_stabilize_properties.py": {"adapter._pressure_source"},
}


class Reaching(ast.NodeVisitor):
    """What one test file reaches for."""

    def __init__(self, source: str) -> None:
        self.found: set[str] = set()
        #: What names stand for in the file, of what it imports.
        self._modules: dict[str, str] = {}
        self._lines = ["", *source.splitlines()]
        self.visit(ast.parse(source))

    def visit_Import(self, node: ast.Import) -> None:
        self._modules |= {alias.asname or alias.name: alias.name for alias in node.names}

    def visit_ImportFrom(self, node: ast.ImportFrom) -> None:
        module = node.module or ""
        for alias in node.names:
            self._modules[alias.asname or alias.name] = f"{module}.{alias.name}"
            if _is_ours(module) and _is_private(alias.name):
                self.found.add(f"{module}.{alias.name}")

    def visit_Attribute(self, node: ast.Attribute) -> None:
        owner = _last(node.value)
        if _is_private(node.attr) and owner not in ("self", "cls"):
            self.found.add(f"{owner}.{node.attr}")
        self.generic_visit(node)

    def visit_Assign(self, node: ast.Assign) -> None:
        """Of a method that is assigned to, mypy wants to be told."""
        if "method-assign" in self._lines[node.end_lineno or 0]:
            self.found |= {ast.unparse(target) for target in node.targets}
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        function = node.func
        is_patch = isinstance(function, ast.Attribute) and function.attr in ("setattr", "delattr")
        if is_patch and node.args:
            self.found |= set(self._patched(node.args))
        self.generic_visit(node)

    def _patched(self, args: list[ast.expr]) -> Iterator[str]:
        first = args[0]
        if isinstance(first, ast.Starred):
            yield ast.unparse(first)
        elif isinstance(first, ast.Constant):
            if _is_ours(str(first.value)):
                yield str(first.value)
        elif _is_ours(self._modules.get(ast.unparse(first), "")) and len(args) > 1:
            yield f"{ast.unparse(first)}.{ast.literal_eval(args[1])}"


def _last(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else ast.unparse(node)


def _is_private(name: str) -> bool:
    return name.startswith("_") and not name.startswith("__")


def _is_ours(module: str) -> bool:
    return module.split(".")[0] in OURS


@cache
def reached() -> dict[str, set[str]]:
    found: defaultdict[str, set[str]] = defaultdict(set)
    for path in TESTS.rglob("test_*.py"):
        of_file = Reaching(path.read_text(encoding="utf-8")).found - OF_OTHERS
        if of_file:
            found[str(path.relative_to(TESTS))] = of_file
    return found


def test_no_test_replaces_a_method_of_ours_or_reads_what_is_private() -> None:
    beyond = {name: found - EXCEPTIONS.get(name, set()) for name, found in reached().items()}
    assert {name: found for name, found in beyond.items() if found} == {}


def test_no_exception_is_left_that_nothing_needs() -> None:
    found = reached()
    left = {name: wanted - found.get(name, set()) for name, wanted in EXCEPTIONS.items()}
    assert {name: unneeded for name, unneeded in left.items() if unneeded} == {}


@pytest.mark.parametrize(
    ("source", "found"),
    [
        ("rig.engine._dialogue.hang_up()", {"engine._dialogue"}),
        ("self._mine = 1", set()),
        ("from etd.engine.engine import _STALL_NS", {"etd.engine.engine._STALL_NS"}),
        (
            "from etd_hal.board import Board\nmonkeypatch.setattr(Board, 'fire', other)",
            {"Board.fire"},
        ),
        ("monkeypatch.setattr('etd.files.paths.STATE', folder)", {"etd.files.paths.STATE"}),
        ("import os\nmonkeypatch.setattr(os, 'getuid', user)", set()),
        ("rig.listen = gone  # type: ignore[method-assign]", {"rig.listen"}),
        ("rig.engine.answer = lambda _: None", set()),
    ],
)
def test_the_search_sees_what_it_is_for(source: str, found: set[str]) -> None:
    assert Reaching(source).found == found
