"""What holds for the house as a whole: who imports what, and what each file says of itself."""

from __future__ import annotations

import ast
import re
import tomllib
from functools import cache
from pathlib import Path

import pytest

CLONE = Path(__file__).parents[1]
SOURCES = sorted(path for root in ("daemon", "hal") for path in (CLONE / root).rglob("*.py"))
ALL_PYTHON = SOURCES + sorted((CLONE / "tests").rglob("*.py"))
LINUX = CLONE / "hal" / "etd_hal" / "linux"
#: An application's own clock: it runs where there is no daemon, on systems without its HAL.
CLIENT_CLOCK = CLONE / "daemon" / "etd" / "client" / "clock.py"
#: The wall's time in a record, beside the clock that times; nothing is timed with it.
WALL_CLOCK = CLONE / "daemon" / "etd" / "gateway" / "wall_clock.py"
ONLY_IN_LINUX = {"gpiod", "spidev", "smbus2", "time"}
MAX_LINES = 450


def name(path: Path) -> str:
    return str(path.relative_to(CLONE))


@cache
def tree(path: Path) -> ast.Module:
    return ast.parse(path.read_text(encoding="utf-8"))


def imported(path: Path) -> set[str]:
    """The top-level names that a module imports, wherever in it the import stands."""
    found: set[str] = set()
    for node in ast.walk(tree(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name.partition(".")[0] for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            found.add(node.module.partition(".")[0])
    return found


def docstring(path: Path) -> str:
    return ast.get_docstring(tree(path)) or ""


def test_only_the_linux_package_knows_devices_and_clocks() -> None:
    outside = [path for path in SOURCES if not path.is_relative_to(LINUX)]
    found = {name(path): imported(path) & ONLY_IN_LINUX for path in outside}
    for path in (CLIENT_CLOCK, WALL_CLOCK):
        found[name(path)] = found.get(name(path), set()) - {"time"}
    assert {path: names for path, names in found.items() if names} == {}


@pytest.mark.parametrize("port", ["spi", "gpio", "i2c", "clock"])
def test_the_search_finds_the_imports_that_are_there(port: str) -> None:
    assert len(imported(LINUX / f"{port}.py") & ONLY_IN_LINUX) == 1


def test_every_module_of_the_hal_is_under_the_contract_that_keeps_backends_apart() -> None:
    linter = tomllib.loads((CLONE / "pyproject.toml").read_text("utf-8"))["tool"]["importlinter"]
    contract = next(
        entry for entry in linter["contracts"] if entry["name"].startswith("only compose")
    )
    hal = (CLONE / "hal" / "etd_hal").iterdir()
    modules = {f"etd_hal.{path.stem}" for path in hal if not path.name.startswith("__")}
    apart = {"etd_hal.compose", "etd_hal.fake", "etd_hal.linux"}
    assert modules - apart == set(contract["source_modules"]) - {"etd"}


def test_every_module_has_a_docstring() -> None:
    assert [name(path) for path in SOURCES if not docstring(path)] == []


def test_every_module_says_what_it_owns() -> None:
    spared = ("__init__.py", "__main__.py", "version.py")
    found = {name(path): docstring(path) for path in SOURCES if path.name not in spared}
    assert [path for path, told in found.items() if not re.search(r"\b[Oo]wns\b", told)] == []
    assert [path for path, told in found.items() if len(told.splitlines()) < 2] == []


def test_no_file_is_too_long_to_be_read_in_one_sitting() -> None:
    lengths = {name(path): len(path.read_text("utf-8").splitlines()) for path in ALL_PYTHON}
    assert {path: length for path, length in lengths.items() if length > MAX_LINES} == {}


def test_no_module_is_named_after_nothing() -> None:
    empty = {"utils", "util", "helpers", "common", "misc", "manager"}
    assert [name(path) for path in ALL_PYTHON if path.stem in empty] == []


def test_nothing_is_mocked() -> None:
    mock = re.compile(r"^\s*(import|from) (mock|unittest)\b", re.MULTILINE)
    assert [name(path) for path in ALL_PYTHON if mock.search(path.read_text("utf-8"))] == []


@pytest.mark.parametrize("folder", ["config", "systemd"])
def test_data_folders_hold_no_python(folder: str) -> None:
    assert list((CLONE / folder).rglob("*.py")) == []
    assert any((CLONE / folder).iterdir())


def project_texts() -> list[Path]:
    folders = ("config", "daemon", "docs", "hal", "systemd", "tests", ".ci")
    files = [path for folder in folders for path in (CLONE / folder).rglob("*") if path.is_file()]
    files += [path for path in CLONE.iterdir() if path.is_file() and path.name != ".git"]
    return [path for path in files if "__pycache__" not in path.parts]


def test_every_link_between_our_texts_leads_somewhere() -> None:
    texts = [*CLONE.glob("*.md"), *(CLONE / "docs").rglob("*.md")]
    link = re.compile(r"\]\((?!https?:|#)([^)#\s]+)")
    found = [(text, target) for text in texts for target in link.findall(text.read_text("utf-8"))]
    assert len(found) > 10
    broken = [f"{name(text)}: {to}" for text, to in found if not (text.parent / to).exists()]
    assert broken == []


def test_nothing_points_to_a_folder_of_one_persons_machine() -> None:
    private = re.compile(rb"(?<![\w.])/(home|root|Users|work|mnt)/\w")
    found = [name(path) for path in project_texts() if private.search(path.read_bytes())]
    assert found == []
