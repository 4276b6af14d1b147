"""What a calibration's command does with its result, and says of what it has kept.

Owns: storing it in the daemon and in a file, naming the table of trials, and the command that
continues. Must not know: what is asked, keys, what the result says.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from msgspec.structs import replace

from etd.calibrate.conditions import Conditions
from etd.calibrate.trial import Stopped
from etd.cli.arming import safe_again
from etd.cli.stored_lowered import StoredLowered
from etd.client import Display
from etd.files.atomic_file import write_atomically
from etd.files.calibration import to_toml
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.errors import Refused
from etd_hal.compose import wall_time


def store(
    args: argparse.Namespace,
    display: Display,
    which: str,
    made: Calibration,
    stored: StoredLowered,
    progress: Path | None = None,
) -> None:
    """As `which` in the daemon, and in `--out`; the saved progress, if any, is over. What another
    program has stored meanwhile stays, and the result is in a file. Raises: Refused, OSError.
    """
    safe_again(display)
    made = marked(display, made)
    changed, file = stored.changed, args.out
    if changed and file is None:
        file = Path(f"{which}_{wall_time():%Y%m%d-%H%M%S}.toml")
    if not changed:
        display.set_calibration(which, made)
    if file is not None:
        write_atomically(file, to_toml(made).encode(), mode=0o640)
    if progress is not None:
        progress.unlink(missing_ok=True)
    if changed:
        raise Refused(
            "bad_calibration",
            f"another program has stored {' and '.join(changed)} since this command began, so the"
            f" result is not stored over that: it is in {file}. Compare them; `etd calibration"
            f" import {file} --as {which}` stores the result",
        )


def stored_lowered(
    args: argparse.Namespace, display: Display, which: str, made: Conditions
) -> StoredLowered:
    """What the command stands on, and what its result is to replace. Raises: Refused."""
    names = (args.baseline, which)
    return StoredLowered(display, names, made, lambda one: marked(display, one))


def marked(display: Display, made: Calibration) -> Calibration:
    """What is stored: of a fake board, that it is modelled."""
    is_fake = display.facts.board.backend == "fake"
    return replace(made, modelled=True) if is_fake else made


def kept_lower(made: Calibration, stored: Calibration) -> Calibration:
    """`made` without what was too strong since: an electrode of `stored` that has its threshold and
    a lower cap stays as it is.
    """
    both = zip(made.electrode, stored.electrode, strict=True)
    each = tuple(
        old if _felt_from_ua(old) == _felt_from_ua(new) and old.cap_ua < new.cap_ua else new
        for new, old in both
    )
    if each == made.electrode:
        return made
    # What was found of all of them together is of others.
    return replace(made, electrode=each, is_whole_accepted=None, adaptation=None)


def _felt_from_ua(limits: ElectrodeLimits) -> int:
    """Its threshold, also where the cap was taken down below that."""
    return limits.threshold_ua if limits.felt_from_ua is None else limits.felt_from_ua


def same_command(args: argparse.Namespace) -> str:
    """The command that continues from the saved progress."""
    return "the same command" + (" without --restart" if args.restart else "")


def until_cleared(args: argparse.Namespace, stopped: Stopped) -> str:
    """What follows on a stop's sentence: it has halted the daemon, and nothing arms until that is
    cleared. A fake's own daemon ends with this command.
    """
    is_halted = stopped.answer == "stop" and args.board is None
    return ", until `etd clear`" if is_halted else ""


def tell_trials(args: argparse.Namespace, trials: str | None) -> None:
    """On standard error, where nothing is told on standard output."""
    if trials is not None and not args.json:
        print(f"trials: {trials}", file=sys.stderr, flush=True)
