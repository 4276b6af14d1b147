"""Options that several verbs share.

Owns: `--name`, `--json`, `--seconds`, `--returns`, `--machine`, the value of
`--board fake[:BOARD]`, and how a verb reports a failure that is not an exception. Must not know:
verbs.
"""

from __future__ import annotations

import argparse
import json
import sys
from typing import NamedTuple

from etd.files.paths import DEFAULT_NAME
from etd_hal.compose import MODELLED_MACHINES

#: A frame on the fake is shown for at most 100 s after its client has died.
MAX_TIMEOUT_FACTOR = 100


def add_name(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--name", default=DEFAULT_NAME, help="the daemon's name (default: %(default)s)"
    )


def add_json(parser: argparse.ArgumentParser, what: str = "one JSON object") -> None:
    parser.add_argument("--json", action="store_true", help=f"print {what}, also for errors")


def answer_no(args: argparse.Namespace, code: str, reason: str) -> None:
    """Print it like an error: a sentence, or with `--json` the object."""
    if args.json:
        print(json.dumps({"ok": False, "error": code, "reason": reason}))
    else:
        print(f"etd: {reason}", file=sys.stderr, flush=True)


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


def positive(text: str) -> float:
    """A number above 0. Raises: ArgumentTypeError."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0 < value < 1e9:
        raise argparse.ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def timeout_factor(text: str) -> int:
    """A whole number from 1 to MAX_TIMEOUT_FACTOR. Raises: ArgumentTypeError."""
    if not text.isascii() or not text.isdigit() or not 1 <= int(text) <= MAX_TIMEOUT_FACTOR:
        raise argparse.ArgumentTypeError(
            f"{text!r} is not a whole number from 1 to {MAX_TIMEOUT_FACTOR}"
        )
    return int(text)


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
    kind, _, board = text.partition(":")
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
        help="with --board fake: show what this machine would do; its calls, messages and computing"
        " take as long as is modelled (default: calls as on a pi4, computing as fast as here)",
    )


def any_board_faked(text: str) -> FakeBoard:
    """As `fake_board`, for a verb that has fakes only: BOARD alone is a fake too."""
    return fake_board(text) if text.partition(":")[0] == "fake" else FakeBoard(text)
