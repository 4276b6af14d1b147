"""What `make check` leaves out, it leaves out by a rule, and no package with it.

Owns: which files are fast, read from their source. Must not know: how long they take
(`processor_time.py`).
"""

from __future__ import annotations

import ast
import re
import subprocess
from functools import cache
from pathlib import Path

import pytest

TESTS = Path(__file__).parent
CLONE = TESTS.parent
MAKEFILE = (CLONE / "Makefile").read_text(encoding="utf-8")
CI = (CLONE / ".ci" / "run").read_text(encoding="utf-8")
MODELS = TESTS / "models"
PAGES = TESTS / "pages"
#: What runs inside a kernel of its own is another matter.
FILES = [path for path in sorted(TESTS.rglob("test_*.py")) if TESTS / "kernel" not in path.parents]
PACKAGES = sorted(
    ".".join(path.parent.relative_to(root).parts)
    for root in (CLONE / "daemon", CLONE / "hal")
    for path in root.rglob("__init__.py")
)


@cache
def marks(path: Path) -> list[str]:
    """What a file as a whole is marked as."""
    text = path.read_text(encoding="utf-8")
    for node in ast.parse(text).body if "pytestmark" in text else ():
        if isinstance(node, ast.Assign) and ast.unparse(node.targets[0]) == "pytestmark":
            return re.findall(r"pytest\.mark\.(\w+)", ast.unparse(node.value))
    return []


def is_fast(path: Path) -> bool:
    return "slow" not in marks(path) and not {MODELS, PAGES} & set(path.parents)


def packages_of(path: Path) -> set[str]:
    """Whose modules a file imports itself."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names = {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
        elif isinstance(node, ast.Import):
            names = {alias.name for alias in node.names}
        else:
            continue
        found |= {name if name in PACKAGES else name.rpartition(".")[0] for name in names}
    return found & set(PACKAGES)


def test_each_package_has_fast_tests() -> None:
    covered = set().union(*(packages_of(path) for path in FILES if is_fast(path)))
    assert set(PACKAGES) - covered == set()


def test_slow_is_a_file_as_a_whole_and_none_of_the_models() -> None:
    text = {path: path.read_text(encoding="utf-8") for path in FILES}
    mark = re.compile(r"^pytestmark = .*pytest\.mark\.slow", re.MULTILINE)
    other = re.compile(r"@pytest\.mark\.slow")
    assert [path.name for path in FILES if other.search(text[path])] == []
    assert [path.name for path in FILES if mark.search(text[path]) and MODELS in path.parents] == []
    assert {path for path in FILES if mark.search(text[path])} == {
        path for path in FILES if "slow" in marks(path)
    }


def recipe(target: str) -> str:
    found = re.search(rf"^{target}:.*\n((?:\t.*\n)+)", MAKEFILE, re.MULTILINE)
    assert found is not None
    return found[1]


def test_whatever_check_leaves_out_the_other_targets_run() -> None:
    assert "$(PYTEST) $(SLOW) $(APART) $(ARGS)" in recipe("check")
    telling = ["make", "--no-print-directory", "--eval=said: ; @echo $(SLOW) $(APART)", "said"]
    said = subprocess.run(telling, cwd=CLONE, capture_output=True, text=True, check=True)
    ignored = {CLONE / name for name in re.findall(r"--ignore (\S+)", said.stdout)}
    assert ignored == {MODELS, PAGES, *(path for path in FILES if "slow" in marks(path))}
    assert "$(APART)" in recipe("test")
    assert "slow" not in recipe("test")
    assert "APART := --ignore $(MODELS) --ignore $(PAGES)\n" in MAKEFILE
    assert "$(PYTEST) $(MODELS)" in recipe("test-models")
    assert "$(PYTEST) $(PAGES)" in recipe("test-pages")


@pytest.mark.parametrize(
    "target",
    ["test", "test-models", "test-pages", "fuzz", "mutants", "kernel-test", "kernel-mutants"],
)
def test_ci_runs_them_all(target: str) -> None:
    assert re.search(rf"^stage make {target}( |$)", CI, re.MULTILINE)
