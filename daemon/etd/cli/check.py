"""`etd check FILE...`: checks configuration and data files.

Owns: the printed answer. Must not know: the rules (`etd.files.check` calls the modules that have
them).
"""

from __future__ import annotations

import argparse
from pathlib import Path

import msgspec

from etd.files.check import Checked, check_file

HELP = "check configuration, board, calibration and pattern files"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        type=Path,
        help="board, machine, array, body site, calibration, etd.toml, pattern or layout file",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object for all files")


def run(args: argparse.Namespace) -> int:
    """Exit status 0: all files are valid. 1: a file is not valid, or does not exist."""
    answers = [check_file(path) for path in args.files]
    all_good = all(answer.error is None for answer in answers)
    if args.json:
        print(msgspec.json.encode({"ok": all_good, "files": answers}).decode())
    else:
        print("\n".join(line for answer in answers for line in _lines(answer)))
    return 0 if all_good else 1


def _lines(answer: Checked) -> list[str]:
    if answer.error is not None:
        return [f"BAD   {answer.error}"]
    return [
        f"good  {answer.file}: {answer.kind} {answer.name}: {answer.summary}",
        *(f"      mended: {sentence}" for sentence in answer.mended),
    ]
