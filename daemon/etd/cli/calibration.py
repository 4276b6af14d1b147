"""`etd calibration list|show|export|import|delete`: the calibrations that a daemon keeps.

Owns: the printed answers, and the files read and written. Must not know: where a calibration is
kept (`client/calibration_files.py`), how a calibration is made (calibrate).
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

import msgspec

from etd.apps.picture import Picture
from etd.cli import options
from etd.cli.calibration_shown import conditions_in_words, table_of
from etd.cli.doubts import doubts_of
from etd.cli.given_file import check_given
from etd.cli.new_file import check_new_file
from etd.cli.running import display_of
from etd.cli.taken_name import add_replace, check_name_is_theirs
from etd.client import Display
from etd.files.atomic_file import write_atomically
from etd.files.calibration import calibration_of_bytes, load_calibration, to_toml
from etd.files.calibration_folder import MOST_FILE_BYTES
from etd.files.check import check_file
from etd.files.paths import check_name
from etd.protocol.calibration import Calibration
from etd.protocol.calibration_set import digest_of
from etd.protocol.errors import FileError, Refused
from etd.protocol.frame import Returns, Ring
from etd.protocol.text import shown
from etd_hal.compose import wall_time

HELP = "list, show, export, import and delete the daemon's calibrations"
EPILOG = """
examples:
  etd calibration list
  etd calibration show P01
  etd calibration export P01 P01.toml         without FILE: to standard output
  etd calibration import P01.toml --as P01    array and body site must match
  etd calibration import - --as P01           the same, from standard input
  etd calibration delete P01

A calibration contains a person's limits: import and delete write the daemon's folder as the user
who runs them, who needs the group etd-operators. With --host they run there. NAME is a code for
the participant, never the person's name. `etd calibrate` makes a calibration.
"""


WHOSE = "the calibration's name"
_INPUT = Path("-")
#: Of calibrations that cannot be used, so many are told one by one.
_MOST_UNREADABLE = 10


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(
        title="what", metavar="list|show|export|import|delete", required=True
    )
    options.add_action(actions, "list", _list, "list the calibrations and their conditions")
    show = options.add_action(actions, "show", _show, "show a calibration, electrode by electrode")
    export = options.add_action(actions, "export", _export, "write a calibration as a TOML file")
    taking = options.add_action(
        actions, "import", _import, "store a calibration file in the daemon"
    )
    delete = options.add_action(actions, "delete", _delete, "delete a calibration from the daemon")
    for each in (show, export, delete):
        each.add_argument("which", metavar="NAME", help=WHOSE)
    export.add_argument("file", nargs="?", type=Path, metavar="FILE", help="a new file")
    taking.add_argument(
        "file", type=Path, metavar="FILE", help="a calibration file; - is the input"
    )
    taking.add_argument("--as", dest="which", metavar="NAME", help="default: the file's own name")
    add_replace(taking)


def run(args: argparse.Namespace) -> int:
    """Raises: Refused (`not_found`, `not_permitted`, `bad_calibration`, `wrong_state`), FileError,
    DaemonGone.
    """
    if args.act in (_show, _export, _delete):
        check_name(args.which, WHOSE)
    return int(args.act(args))


def _display(args: argparse.Namespace) -> Display:
    return display_of(args, "etd calibration")


# --- what is there -----------------------------------------------------------------------------


def _list(args: argparse.Namespace) -> int:
    """One that `open` would refuse is named, with why; the others are listed all the same."""
    found, unreadable = {}, {}
    with _display(args) as display:
        for name in display.calibrations():
            try:
                found[name] = display.calibration(name)
            except Refused as refused:
                unreadable[name] = refused.reason
    status = 1 if unreadable else 0
    if args.json:
        about = {name: _conditions(calibration) for name, calibration in found.items()}
        _print_json({"ok": not unreadable, "calibrations": about, "unreadable": unreadable})
        return status
    for name, why in list(unreadable.items())[:_MOST_UNREADABLE]:
        print(shown(f"etd: {name} cannot be used: {why}"), file=sys.stderr)
    more = len(unreadable) - _MOST_UNREADABLE
    if more > 0:
        print(f"etd: {more} more cannot be used: --json has why", file=sys.stderr)
    if unreadable and not found:
        return status
    if not found:
        print("the daemon has no calibrations: `etd calibrate` makes one")
    else:
        wide = max(map(len, found))
        print(
            "\n".join(
                shown(f"{name:<{wide}}  {_sentence(calibration)}")
                for name, calibration in found.items()
            )
        )
    return status


def _show(args: argparse.Namespace) -> int:
    with _display(args) as display:
        calibration = display.calibration(args.which)
        array = display.facts.array
    digest = digest_of(calibration)
    if args.json:
        about = {"name": args.which, "digest": digest, "calibration": calibration}
        _print_json({"ok": True, **about})
        return 0
    conditions = {**_conditions(calibration), "digest": digest}
    today = wall_time().date()
    print("\n".join(map(shown, conditions_in_words(conditions, calibration.date, today))))
    if calibration.array == array.name and len(calibration.electrode) == array.electrodes:
        signs = _signs([limits.threshold_ua for limits in calibration.electrode])
        print("thresholds, low to high from 0 to 9:")
        print("\n".join(Picture(array.x_mm, array.y_mm).rows(signs)))
    print("\n".join(table_of(calibration)))
    for doubt in doubts_of(calibration, today):
        print(shown(doubt))
    return 0


def _conditions(calibration: Calibration) -> dict[str, object]:
    """All fields except the electrodes, as in the file."""
    fields = msgspec.structs.asdict(calibration)
    del fields["electrode"]
    return {
        **fields,
        "returns": _returns(calibration.returns),
        "shape": str(calibration.shape),
        "date": calibration.date.isoformat(),
        "electrodes": len(calibration.electrode),
        "largest_cap_ua": max((limits.cap_ua for limits in calibration.electrode), default=0),
    }


def _returns(returns: Returns) -> str:
    if isinstance(returns, str):
        return returns
    return f"ring of {returns.ring_mm:g} mm" if isinstance(returns, Ring) else "one list each"


def _sentence(calibration: Calibration) -> str:
    caps_ua = [limits.cap_ua for limits in calibration.electrode]
    return (
        f"{calibration.participant}, {calibration.body_site}, {calibration.array},"
        f" {calibration.polarity}, {calibration.width_us} us, {calibration.rate_hz:g} Hz, caps up"
        f" to {max(caps_ua, default=0)} uA, {calibration.date.isoformat()}"
    )


def _signs(values: list[int]) -> list[str]:
    """A digit for each value, from the smallest to the largest."""
    least = min(values)
    span = max(max(values) - least, 1)
    return [str((value - least) * 9 // span) for value in values]


# --- files ---------------------------------------------------------------------------------------


def _export(args: argparse.Namespace) -> int:
    """An existing file is not overwritten."""
    check_new_file(args.file)
    with _display(args) as display:
        text = to_toml(display.calibration(args.which))
    if args.file is None:
        sys.stdout.write(text)
        return 0
    try:
        write_atomically(args.file, text.encode(), mode=0o640)
    except OSError as error:
        raise FileError(
            str(args.file), "", f"it cannot be written ({error.strerror})", "name another file"
        ) from error
    _done(args, f"{args.which} is written to {args.file}")
    return 0


def _import(args: argparse.Namespace) -> int:
    if args.file == _INPUT and args.which is None:
        args.misused("import from standard input needs --as NAME")
    advice = "name a file, or - for standard input"
    is_input = args.file == _INPUT
    calibration = _from_input() if is_input else _loaded(check_given(args.file, advice))
    name = check_name(args.which or args.file.stem, WHOSE)
    with _display(args) as display:
        check_name_is_theirs(args, display, name, calibration)
        display.set_calibration(name, calibration)
    _done(args, f"{name}: {_sentence(calibration)}", name)
    return 0


def _from_input() -> Calibration:
    """Raises: FileError."""
    return calibration_of_bytes(Path("standard input"), sys.stdin.buffer.read(MOST_FILE_BYTES + 1))


def _loaded(path: Path) -> Calibration:
    """Raises: FileError, which names the kind where the file is of another kind."""
    try:
        return load_calibration(path)
    except FileError as error:
        kind = check_file(path).kind
        if kind in ("", "calibration"):
            raise
        raise FileError(
            str(path),
            "",
            f"it is a {kind} file, not a calibration",
            "name a file that `etd calibration export` or `etd calibrate --out` wrote",
        ) from error


def _delete(args: argparse.Namespace) -> int:
    with _display(args) as display:
        display.delete_calibration(args.which)
    _done(args, f"{args.which} is deleted")
    return 0


def _done(args: argparse.Namespace, sentence: str, name: str | None = None) -> None:
    if args.json:
        _print_json({"ok": True, "name": name or args.which})
    else:
        print(shown(sentence))


def _print_json(answer: object) -> None:
    print(msgspec.json.encode(answer).decode())
