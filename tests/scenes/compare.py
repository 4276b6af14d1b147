"""`make compare OLD=folder NEW=folder`: whether two recordings are the same.

Owns: what "the same" means: traces to the byte, messages as objects once the table of renamed keys
(`renamed.toml`) has been applied to the old ones. Must not know: scenes, engines.
"""

from __future__ import annotations

import argparse
import json
import sys
import tomllib
from pathlib import Path
from typing import Any

RENAMED = Path(__file__).with_name("renamed.toml")


class Names:
    """The table: `keys` and `values` by what they were, `in.NAME` the keys below the key NAME where
    they are called otherwise there; `sentences` are keys whose text may be worded otherwise, and
    must be there in both.
    """

    def __init__(self, table: dict[str, Any]) -> None:
        self._keys: dict[str, str] = table.get("keys", {})
        self._within: dict[str, dict[str, str]] = table.get("in", {})
        self._values: dict[str, str] = table.get("values", {})
        self._sentences = frozenset(table.get("sentences", ()))

    def renamed(self, told: Any) -> Any:
        """An old message in new names."""
        return self._renamed(told, self._keys)

    def _renamed(self, told: Any, keys: dict[str, str]) -> Any:
        if isinstance(told, dict):
            return {
                keys.get(key, key): self._renamed(value, keys | self._within.get(key, {}))
                for key, value in told.items()
            }
        if isinstance(told, list):
            return [self._renamed(entry, keys) for entry in told]
        return self._values.get(told, told) if isinstance(told, str) else told

    def without_sentences(self, told: Any, key: str = "") -> Any:
        """With every sentence reduced to whether it is there."""
        if isinstance(told, dict):
            return {name: self.without_sentences(value, name) for name, value in told.items()}
        if isinstance(told, list):
            return [self.without_sentences(entry, key) for entry in told]
        return bool(told) if key in self._sentences and isinstance(told, str) else told


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split(":")[1].splitlines()[0].strip())
    parser.add_argument("old", type=Path)
    parser.add_argument("new", type=Path)
    asked = parser.parse_args()
    names = Names(tomllib.loads(RENAMED.read_text(encoding="utf-8")))
    scenes = _scenes(asked.old) | _scenes(asked.new)
    differences = [
        difference
        for scene in sorted(scenes)
        for difference in (
            _trace_difference(asked.old, asked.new, scene),
            _told_difference(asked.old, asked.new, scene, names),
        )
        if difference
    ]
    for difference in differences:
        print(difference)
    print(f"{len(scenes)} scenes, {len(differences)} differences")
    return 1 if differences or not scenes else 0


def _scenes(folder: Path) -> set[str]:
    return {path.name.split(".")[0] for path in folder.glob("*.trace.jsonl")}


def _trace_difference(old: Path, new: Path, scene: str) -> str | None:
    lines = [_lines(folder / f"{scene}.trace.jsonl") for folder in (old, new)]
    return _first_difference(f"{scene}, trace", *lines)


def _told_difference(old: Path, new: Path, scene: str, names: Names) -> str | None:
    before, after = (_lines(folder / f"{scene}.told.jsonl") for folder in (old, new))
    was = [_plain(names.without_sentences(names.renamed(json.loads(line)))) for line in before]
    now = [_plain(names.without_sentences(json.loads(line))) for line in after]
    return _first_difference(f"{scene}, told", was, now)


def _plain(told: Any) -> str:
    return json.dumps(told, sort_keys=True)


def _lines(path: Path) -> list[str]:
    return path.read_text(encoding="utf-8").splitlines() if path.exists() else []


def _first_difference(what: str, old: list[str], new: list[str]) -> str | None:
    if old == new:
        return None
    at = next((i for i, (a, b) in enumerate(zip(old, new, strict=False)) if a != b), None)
    if at is None:
        return f"{what}: {len(old)} lines, now {len(new)}"
    return f"{what}, line {at + 1}:\n  was {old[at][:400]}\n  now {new[at][:400]}"


if __name__ == "__main__":
    sys.exit(main())
