"""What is known of a module from before: why mistakes survive, and of which sources it was clean.

Owns: `modules.toml`, `survivors.toml`, `digests.toml`; what counts as a module's sources; where the
outcomes of an interrupted run stand. Must not know: how a mistake is tried.
"""

from __future__ import annotations

import ast
import hashlib
import json
import tomllib
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mutants.judging import Baseline, Outcome

#: Of this folder: what shows results is not what makes them.
_SHOWS = {"run.py", "account.py"}
_HEAD = """\
# Written by `make mutants`: the sources over which each module was last found without a mistake
# unseen, a branch untaken, or an explanation too many.
"""


class Account:
    """Of the modules of one tree, which their paths begin at."""

    def __init__(self, tree: Path, kept: Path) -> None:
        """`kept`: a folder for outcomes."""
        folder = tree / "tests" / "mutants"
        self._tree = tree
        self._digests = folder / "digests.toml"
        self._kept = kept
        self._keys: dict[str, str] = {}
        self.modules: dict[str, list[str]] = _read(folder / "modules.toml")
        self._survivors: dict[str, dict[str, str]] = _read(folder / "survivors.toml")
        self._tool = sorted(
            path for path in Path(__file__).parent.glob("*.py") if path.name not in _SHOWS
        )
        unknown = set(self._survivors) - set(self.modules)
        if unknown:
            raise ValueError(f"survivors.toml explains what modules.toml does not name: {unknown}")

    def explained(self, module: str) -> dict[str, str]:
        """Why a mistake makes no difference, by its name."""
        return self._survivors.get(module, {})

    # --- sources -------------------------------------------------------------------------------

    def digest(self, module: str) -> str:
        """Of its source, its tests with what they load of ours in `tests`, the tool, and the names
        of what is explained.
        """
        names = json.dumps(sorted(self.explained(module)), ensure_ascii=False)
        return _digest([self.key(module).encode(), names.encode()])

    def key(self, module: str) -> str:
        """The same without what is explained; as it was when it was asked for first."""
        if module not in self._keys:
            tests = sorted(_with_helpers(self._tree, self.modules[module]))
            paths = [self._tree / module, *tests, *self._tool]
            self._keys[module] = _digest(path.read_bytes() for path in paths)
        return self._keys[module]

    def is_clean(self, module: str) -> bool:
        return self._found().get(module) == self.digest(module)

    def note(self, module: str, *, is_clean: bool) -> None:
        """For the next run, and for CI."""
        found = {name: one for name, one in self._found().items() if name in self.modules}
        found.pop(module, None)
        if is_clean:
            found[module] = self.digest(module)
        lines = [f'"{name}" = "{one}"\n' for name, one in sorted(found.items())]
        self._digests.write_text(_HEAD + "".join(lines), encoding="utf-8")

    def _found(self) -> dict[str, str]:
        return _read(self._digests)

    # --- outcomes ------------------------------------------------------------------------------

    def kept(self, module: str) -> tuple[Baseline | None, list[Outcome]]:
        """What a run over the same sources has found already."""
        path = self._path(module)
        if not path.exists():
            return None, []
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
        if not lines[-1].endswith("\n"):
            # It was cut short, and what follows must not continue it.
            lines.pop()
            path.write_text("".join(lines), encoding="utf-8")
        first, *rest = map(json.loads, lines)
        reached = {int(line): names for line, names in first["reached"].items()}
        loading = frozenset(first["loading"])
        baseline = Baseline(first["taken_s"], reached, loading, first["gaps"])
        return baseline, [Outcome(**one) for one in rest]

    def keep_baseline(self, module: str, baseline: Baseline) -> None:
        self._kept.mkdir(parents=True, exist_ok=True)
        told = {**asdict(baseline), "loading": sorted(baseline.loading)}
        new = self._path(module).with_suffix(".new")
        new.write_text(json.dumps(told) + "\n", encoding="utf-8")
        new.replace(self._path(module))

    def keep(self, module: str, outcome: Outcome) -> None:
        with self._path(module).open("a", encoding="utf-8") as file:
            file.write(json.dumps(asdict(outcome), ensure_ascii=False) + "\n")

    def _path(self, module: str) -> Path:
        stem = Path(module).with_suffix("").as_posix().replace("/", ".")
        return self._kept / f"{stem}-{self.key(module)}.jsonl"


def _read(path: Path) -> dict[str, Any]:
    return tomllib.loads(path.read_text(encoding="utf-8")) if path.exists() else {}


def _digest(parts: Iterable[bytes]) -> str:
    found = hashlib.sha256()
    for part in parts:
        found.update(hashlib.sha256(part).digest())
    return found.hexdigest()[:16]


def _with_helpers(tree: Path, tests: Sequence[str]) -> set[Path]:
    """Files of tests, the conftest.py above them, and what they import out of `tests`."""
    root = tree / "tests"
    found: set[Path] = set()
    left = [tree / test for test in tests]
    left += [
        one / "conftest.py"
        for test in list(left)
        for one in test.parents
        if one.is_relative_to(root)
    ]
    while left:
        path = left.pop()
        if path not in found and path.exists():
            found.add(path)
            left += [root / f"{name}.py" for name in _imported(path)]
    return found


def _imported(path: Path) -> Iterator[str]:
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module and not node.level:
            yield node.module.replace(".", "/")
            yield from (f"{node.module.replace('.', '/')}/{one.name}" for one in node.names)
        elif isinstance(node, ast.Import):
            yield from (one.name.replace(".", "/") for one in node.names)
