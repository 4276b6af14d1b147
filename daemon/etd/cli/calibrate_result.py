"""What a calibration's command does with its result, and says of what it has kept.

Owns: storing it in the daemon and in a file, naming the table of trials, and the command that
continues. Must not know: what is asked, keys, what the result says.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from msgspec.structs import replace

from etd.calibrate.trial import Stopped
from etd.cli.arming import safe_again
from etd.client import Display
from etd.files.atomic_file import write_atomically
from etd.files.calibration import to_toml
from etd.protocol.calibration import Calibration, ElectrodeLimits


def store(
    args: argparse.Namespace,
    display: Display,
    which: str,
    made: Calibration,
    progress: Path | None = None,
) -> None:
    """As `which` in the daemon, and in `--out`; the saved progress, if any, is over. Raises:
    Refused.
    """
    safe_again(display)
    made = marked(display, made)
    display.set_calibration(which, made)
    if args.out is not None:
        write_atomically(args.out, to_toml(made).encode(), mode=0o640)
    if progress is not None:
        progress.unlink(missing_ok=True)


def marked(display: Display, made: Calibration) -> Calibration:
    """What is stored: of a fake board, that it is modelled."""
    is_fake = display.facts.board.backend == "fake"
    return replace(made, modelled=True) if is_fake else made


def stored_of_same(display: Display, which: str, made: Calibration) -> Calibration | None:
    """What is stored as `which` of the same person and pulses: what they may be using. Raises:
    Refused.
    """
    if which not in display.calibrations():
        return None
    stored = display.calibration(which)
    fields = ("participant", "body_site", "array", "polarity", "width_us")
    same = all(getattr(stored, field) == getattr(made, field) for field in fields)
    return stored if same else None


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
