"""What is compiled, and what a compiled module must not hold: mypyc would drop it silently."""

from __future__ import annotations

import ast
import tomllib
from dataclasses import dataclass
from importlib import import_module
from importlib.machinery import EXTENSION_SUFFIXES
from pathlib import Path
from typing import Any

import pytest

import engine_rig
from engine_scenes import only
from etd.pulse.request import MaxGain, PulseRequest
from etd.stabilize.pipeline import ElectrodeEstimate
from etd_hal import compiled

CLONE = Path(__file__).parents[1]
PROJECT = tomllib.loads((CLONE / "pyproject.toml").read_text("utf-8"))
WHEEL = PROJECT["tool"]["hatch"]["build"]["targets"]["wheel"]
MODULES: list[str] = WHEEL["hooks"]["custom"]["modules"]


def classes(path: str) -> list[ast.ClassDef]:
    tree = ast.parse((CLONE / path).read_text("utf-8"))
    return [node for node in ast.walk(tree) if isinstance(node, ast.ClassDef)]


def imported(path: str) -> Any:
    return import_module(".".join(Path(path).with_suffix("").parts[1:]))


def test_the_list_of_compiled_modules_is_in_order() -> None:
    assert sorted(set(MODULES)) == MODULES


@pytest.mark.parametrize("path", MODULES)
def test_a_compiled_module_has_no_struct_and_no_class_keyword(path: str) -> None:
    for found in classes(path):
        assert found.keywords == [], f"{path}: {found.name} has keywords, which mypyc drops"
        bases = [ast.unparse(base) for base in found.bases]
        assert "msgspec.Struct" not in bases, f"{path}: {found.name} is a struct"


@pytest.mark.parametrize("path", MODULES)
def test_a_compiled_class_has_no_default_that_is_made(path: str) -> None:
    """mypyc leaves such an attribute out of its objects."""
    for found in classes(path):
        assigned = [node for node in found.body if isinstance(node, (ast.Assign, ast.AnnAssign))]
        is_plain = not found.decorator_list and "NamedTuple" not in map(ast.unparse, found.bases)
        made = [ast.unparse(node) for node in assigned if isinstance(node.value, ast.Call)]
        assert made == [] or not is_plain, f"{path}: {found.name}"


@pytest.mark.parametrize("clock", ["hal/etd_hal/linux/clock.py", "hal/etd_hal/fake/clock.py"])
def test_clocks_stay_interpreted(clock: str) -> None:
    assert (CLONE / clock).exists()
    assert clock not in MODULES


def test_all_of_them_are_compiled_or_none() -> None:
    are_compiled = {imported(path).__file__.endswith(tuple(EXTENSION_SUFFIXES)) for path in MODULES}
    assert are_compiled == {compiled.runs() == "compiled"}


@dataclass
class Liar:
    """A stabilizer that says nothing of the kind that its annotation promises."""

    max_gain = MaxGain()

    def reset(self) -> None:
        pass

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        return "400 uA, 100 us"  # type: ignore[return-value]


def test_an_annotation_that_lies_ends_the_engine_in_safe() -> None:
    """Compiled it is a TypeError where the lie is told; interpreted, what comes of it later."""
    rig = engine_rig.make(electrodes=16, stabilizers=[Liar()])
    rig.open()
    rig.arm()
    with pytest.raises(TypeError if compiled.runs() == "compiled" else AttributeError):
        rig.hold(200, current_ua=only(16, e3=400))
    # What `run_engine` does with whatever a step raises.
    assert rig.engine.supervisor.end() == ()
    assert rig.engine.supervisor.states.state == "SAFE"
    assert rig.close() == ()
