"""Options that several verbs share.

Owns: `--name`, `--host`, `--folder`, `--json`, `--seconds`, `--returns`, `--config`, `--board
fake[:BOARD]`, `--array`, `--timeout-factor`, `--machine`, numbers within bounds, how a verb reports
a failure that is not an exception, and wrong use that shows late. Must not know: verbs.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NamedTuple

from etd.files.paths import DEFAULT_NAME, address_of, check_name
from etd.protocol.errors import FileError
from etd.protocol.text import shown
from etd_hal.modelled_fingers import KINDS, Finger, finger_named
from etd_hal.modelled_machines import MODELLED_MACHINES

#: A frame on the fake is shown for at most 100 s after its client has died.
MAX_TIMEOUT_FACTOR = 100
#: Of a verb's own daemon: no person is connected, and a busy machine must not end what is shown.
PRIVATE_TIMEOUT_FACTOR = 20


def add_daemon_and_json(parser: argparse.ArgumentParser) -> None:
    add_daemon(parser)
    add_json(parser)


def add_daemon(parser: argparse.ArgumentParser) -> None:
    """Which running daemon: its name or its folder, here or on another computer."""
    add_name(parser)
    add_host(parser)
    add_folder(parser)


def add_host(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--host",
        metavar="[USER@]HOST",
        help="the daemon on another computer, over ssh (default: ETD_HOST, or else this one)",
    )


def add_folder(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--folder", metavar="DIR", help="the daemon of `etd run --folder DIR`, instead of --name"
    )


def address_named(args: argparse.Namespace) -> str | None:
    """The control address of the daemon in `--folder`; None: `--name` says which."""
    return None if args.folder is None else address_of(Path(args.folder))


def add_name(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--name",
        type=daemon_name,
        default=DEFAULT_NAME,
        help="the daemon's name (default: %(default)s)",
    )


def daemon_name(text: str) -> str:
    """Raises: ArgumentTypeError."""
    try:
        return check_name(text)
    except FileError as error:
        raise argparse.ArgumentTypeError(f"{error.value}; {error.allowed}") from None


def add_json(parser: argparse.ArgumentParser, what: str = "one JSON object") -> None:
    parser.add_argument("--json", action="store_true", help=f"print {what}, also for errors")


def add_action(
    actions: argparse._SubParsersAction[argparse.ArgumentParser],
    name: str,
    act: object,
    what: str,
) -> argparse.ArgumentParser:
    """One of several things that a verb does with a running daemon. `act` is in the arguments."""
    said = f"{what[0].upper()}{what[1:]}."
    parser = actions.add_parser(name, help=what, description=said, allow_abbrev=False)
    add_daemon(parser)
    add_json(parser)
    parser.set_defaults(act=act)
    return parser


def answer_no(args: argparse.Namespace, code: str, reason: str, **more: object) -> None:
    """Print it like an error: a sentence, or with `--json` the object, which has `more`."""
    if args.json:
        print(json.dumps({"ok": False, "error": code, "reason": reason, **more}))
    else:
        print(f"etd: {shown(reason)}", file=sys.stderr, flush=True)


@contextmanager
def wrong_use(args: argparse.Namespace) -> Iterator[None]:
    """A wrong value on the command line, or in a file that it names: status 2."""
    try:
        yield
    except FileError as error:
        args.misused(str(error))
        raise


def add_seconds(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--seconds", type=positive, metavar="N", help="end after N seconds (default: on Ctrl-C)"
    )


def add_returns(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--returns",
        type=returns,
        metavar="all|ring:MM",
        help="return electrodes: all others, or those on a ring of this radius around each"
        " electrode (boards with relays)",
    )


def add_configuration(parser: argparse.ArgumentParser, fake: str) -> None:
    """`--config`, or else `--board fake[:BOARD]` with `--array`; `fake` says what the fake is."""
    which = parser.add_mutually_exclusive_group()
    which.add_argument("--config", type=Path, metavar="FILE", help="default: /etc/etd/NAME.toml")
    which.add_argument("--board", type=fake_board, metavar="fake[:BOARD]", help=fake)
    _add_array(parser)


def add_fake(parser: argparse.ArgumentParser, fake: str) -> None:
    """`--board fake[:BOARD]` with `--array` and `--timeout-factor`, for a daemon of the verb's."""
    parser.add_argument("--board", type=fake_board, metavar="fake[:BOARD]", help=fake)
    _add_array(parser)
    add_timeout_factor(parser, f"default: {PRIVATE_TIMEOUT_FACTOR}")


def add_timeout_factor(parser: argparse.ArgumentParser, more: str) -> None:
    parser.add_argument(
        "--timeout-factor",
        type=whole(1, MAX_TIMEOUT_FACTOR),
        metavar="N",
        help="with --board fake, on a busy machine: a frame's ttl, the lease, and how long gateway"
        f" and stopper may be silent last N times as long ({more})",
    )


def _add_array(parser: argparse.ArgumentParser) -> None:
    what = "with --board fake: a shipped array, or a file (eTactileKit's layouts too)"
    parser.add_argument("--array", help=what)


def positive(text: str) -> float:
    """A number above 0. Raises: ArgumentTypeError."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0 and below a billion")
    return value


def whole(least: int, most: int, unit: str = "") -> Callable[[str], int]:
    """The `type` of an option. It raises: ArgumentTypeError."""

    def read(text: str) -> int:
        if text.isascii() and text.isdecimal() and least <= int(text) <= most:
            return int(text)
        bounds = f"{least} to {most} {unit}".rstrip()
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number from {bounds}")

    return read


def returns(text: str) -> str | dict[str, float]:
    """`all`, or `ring:MM`. Raises: ArgumentTypeError."""
    if text == "all":
        return text
    kind, _, radius = text.partition(":")
    if kind != "ring":
        raise argparse.ArgumentTypeError(f"{text!r} is neither all nor ring:MM (ring:5.0)")
    return {"ring_mm": positive(radius)}


class FakeBoard(NamedTuple):
    """The value of `--board fake[:BOARD]`; `board` None: any that fits."""

    board: str | None


def fake_board(text: str) -> FakeBoard:
    """`fake` or `fake:BOARD`. Raises: ArgumentTypeError."""
    kind, colon, board = text.partition(":")
    if colon and not board:
        raise argparse.ArgumentTypeError(
            f"{text!r} names no board after its colon: give fake, or fake:BOARD"
        )
    if kind != "fake":
        raise argparse.ArgumentTypeError(
            f"{text!r}: only a fake board is named here (fake, or fake:BOARD); a real one is named"
            " in the configuration"
        )
    return FakeBoard(board or None)


def add_machine(parser: argparse.ArgumentParser) -> None:
    """With `--board fake`; what the fake charges for computing follows from it."""
    parser.add_argument(
        "--machine",
        choices=MODELLED_MACHINES,
        help="with --board fake: show what this machine would do; its calls, messages and"
        " computing take as long as is modelled, on a computer with nothing else to do (default:"
        " calls as on a pi4, computing as fast as here)",
    )


def add_finger(parser: argparse.ArgumentParser) -> None:
    """With `--board fake`, in the daemon's own process."""
    parser.add_argument(
        "--finger",
        type=finger,
        metavar="KIND[:SEED]",
        help="with --board fake: another modelled finger than the fake's own, of one of the kinds"
        f" {', '.join(KINDS)} (docs/body.md); the shipped calibrations are of its own one",
    )


def add_breathing(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--breathing",
        action="store_true",
        help="with --board fake: the finger becomes damp, dry, damp and pressed, and dry again, one"
        " after each quarter of a minute without a pulse, as `etd calibrate --fit` asks for",
    )


def finger_arguments(named: Finger | None, *, is_breathing: bool) -> list[str]:
    """For a part of the same daemon."""
    arguments = [] if named is None else ["--finger", f"{named.kind}:{named.seed}"]
    return [*arguments, "--breathing"] if is_breathing else arguments


def finger(text: str) -> Finger:
    """`KIND` or `KIND:SEED`. Raises: ArgumentTypeError."""
    try:
        return finger_named(text)
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def any_board_faked(text: str) -> FakeBoard:
    """As `fake_board`, for a verb that has fakes only: BOARD alone is a fake too."""
    return fake_board(text) if text.partition(":")[0] == "fake" else FakeBoard(text)
