"""`etd check FILE...`: checks configuration and data files, and draws one of them.

Owns: the printed answer. Must not know: the rules (`etd.files.check` calls the modules that have
them), pictures (`check_draw.py`).
"""

from __future__ import annotations

import argparse
import datetime
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec
from msgspec.structs import replace

from etd.cli.doubts import doubts_of
from etd.cli.new_file import check_new_file
from etd.files.calibration import load_calibration
from etd.files.check import Checked, check_file
from etd.protocol.calibration_set import check_together
from etd.protocol.errors import Refused
from etd.protocol.text import shown
from etd_hal.compose import wall_time

if TYPE_CHECKING:
    from etd.cli.check_draw import Drawn

HELP = "check configuration, board, calibration and pattern files; draw one of them"
EPILOG = """
examples:
  etd check /etc/etd/main.toml my-board.toml    checks files of any kind
  etd check --together P01-a.toml P01-c.toml    two polarities: can one lease have both?
  etd check --draw sheet.svg my-array.toml      a sheet to print: true size, from both sides
  etd check --draw wiring.svg my-board.toml     the 40-pin header: every wire, pull and guard
  etd check --draw P01.svg P01.toml             maps of thresholds and of the room to the cap
  etd check --draw wave.svg wave.json           the frames of a pattern, with their times

A picture is an SVG file, which a browser shows and prints. Print an array's sheet at 100 %.
A calibration is drawn on the array that it names, a pattern on the shipped array of as many
electrodes; --array names another one. eTactileKit's layouts and patterns can be drawn too.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "files",
        nargs="+",
        metavar="FILE",
        type=Path,
        help="board, machine, array, body site, calibration, etd.toml, pattern or layout file",
    )
    parser.add_argument(
        "--draw",
        type=Path,
        metavar="OUT.svg",
        help="draw the file (one array, board, calibration or pattern) into this new file",
    )
    parser.add_argument(
        "--array",
        help="with --draw, of a calibration or a pattern: the shipped array, or the file of the"
        " array, on which it is drawn",
    )
    parser.add_argument(
        "--together",
        action="store_true",
        help="whether the files, calibrations for several polarities, can open one lease",
    )
    parser.add_argument("--json", action="store_true", help="one JSON object for all files")


def run(args: argparse.Namespace) -> int:
    """Exit status 0: all files are valid. 1: a file is not valid, or does not exist; with
    `--together` also where one lease cannot have them.

    With `--draw`, nothing is drawn of a file that is not valid. Raises: FileError, for a file that
    is no calibration, or cannot be drawn, or a picture that cannot be written.
    """
    _check_wish(args)
    today = wall_time().date()
    answers = [_checked(path, today) for path in args.files]
    all_good = all(answer.error is None for answer in answers)
    together = _together(args) if args.together and all_good else None
    drawn = _draw(args, answers[0]) if args.draw is not None and all_good else None
    all_good = all_good and together in (None, "")
    if args.json:
        found: dict[str, object] = {"ok": all_good, "files": answers}
        if args.together:
            found["together"] = together
        if args.draw is not None:
            found["drawn"] = drawn
        print(msgspec.json.encode(found).decode())
    else:
        print("\n".join(line for answer in answers for line in lines_of(answer)))
        if together is not None:
            print(
                f"BAD   {shown(together)}"
                if together
                else "good  together: one lease can have them"
            )
        if args.draw is not None:
            print(_about(drawn))
    return 0 if all_good else 1


def _checked(path: Path, today: datetime.date) -> Checked:
    answer = check_file(path, today)
    if answer.error is not None or answer.kind != "calibration":
        return answer
    return replace(answer, doubts=tuple(doubts_of(load_calibration(path), today)))


def _together(args: argparse.Namespace) -> str:
    """Why one lease cannot have these calibrations; empty where it can."""
    try:
        check_together([load_calibration(path) for path in args.files])
    except Refused as refusal:
        return refusal.reason
    return ""


def _check_wish(args: argparse.Namespace) -> None:
    """Before any file is read. Wrong use ends with status 2. Raises: FileError, where the picture
    cannot be written.
    """
    if args.draw is None:
        if args.array is not None:
            args.misused("--array goes with --draw: it says where the electrodes are")
        return
    if len(args.files) != 1:
        args.misused(f"--draw draws one file, {len(args.files)} are named")
    if args.draw.suffix.lower() != ".svg":
        args.misused(
            f"--draw {args.draw}: pictures are SVG: name a file that ends in .svg, before the file"
            " that is to be drawn"
        )
    check_new_file(args.draw)


def _draw(args: argparse.Namespace, checked: Checked) -> Drawn:
    # Imported here: what checks files needs no pictures.
    from etd.cli.check_draw import draw

    return draw(args, checked)


def _about(drawn: Drawn | None) -> str:
    if drawn is None:
        return "nothing is drawn"
    size = f"{drawn.width_mm:.0f} x {drawn.height_mm:.0f} mm"
    return f"drew  {shown(drawn.file)}: {shown(drawn.summary)} ({size})"


def lines_of(answer: Checked) -> list[str]:
    if answer.error is not None:
        return [f"BAD   {shown(answer.error)}"]
    return [
        shown(f"good  {answer.file}: {answer.kind} {answer.name}: {answer.summary}"),
        *(f"      mended: {shown(sentence)}" for sentence in answer.mended),
        *(f"      in doubt: {shown(sentence)}" for sentence in answer.doubts),
    ]
