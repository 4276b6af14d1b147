"""`make record OUT=folder`: play every scene, and keep what crossed the wires and what was told.

Owns: the files of a recording: for each scene NAME.trace.jsonl, the bus trace as it is, and
NAME.told.jsonl, the engine's messages. Must not know: scenes, what they are compared with.
"""

from __future__ import annotations

import argparse
import json
import sys
from multiprocessing import Pool
from pathlib import Path
from typing import Any

# Run as a script, from a clone: it stands beside the test rigs.
sys.path[:0] = [str(Path(__file__).resolve().parents[1])]

from rich.progress import track  # noqa: E402

from scenes.plots import plots  # noqa: E402


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split(":")[1].splitlines()[0].strip())
    parser.add_argument("out", type=Path, help="a new folder for the recording")
    parser.add_argument("--only", default="", help="scenes whose name has this in it")
    asked = parser.parse_args()
    names = [name for name, _, _ in plots() if asked.only in name]
    asked.out.mkdir(parents=True)
    with Pool() as pool:
        recorded = pool.imap_unordered(record, [(name, asked.out) for name in names])
        for _ in track(recorded, description="scenes", total=len(names)):
            pass
    print(f"{len(names)} scenes in {asked.out}")
    return 0


def record(job: tuple[str, Path]) -> None:
    """Play the scene of this name, and write its two files."""
    name, folder = job
    stage, play = next((stage, play) for known, stage, play in plots() if known == name)
    played = stage()
    try:
        play(played)
    finally:
        left = played.end()
    (folder / f"{name}.trace.jsonl").write_bytes(left.trace)
    lines = "".join(json.dumps(entry) + "\n" for entry in map(_of_any_code, left.told))
    (folder / f"{name}.told.jsonl").write_text(lines, encoding="utf-8")


def _of_any_code(entry: Any) -> Any:
    """Without how the code runs: scenes are the same compiled and interpreted."""
    if isinstance(entry, dict):
        return {key: _of_any_code(value) for key, value in entry.items() if key != "code"}
    return entry


if __name__ == "__main__":
    sys.exit(main())
