"""What is saved of a calibration under way: of which daemon it is, and that one command has it.

Owns: how board and daemon are named in it, and the lock. Must not know: what is saved, questions.
"""

from __future__ import annotations

import argparse
import fcntl
import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from etd.calibrate.begun_anew import Kept, kept_anew
from etd.calibrate.conditions import Conditions
from etd.calibrate.progress import check_progress_folder
from etd.client import Display
from etd.files.paths import calibrating_file
from etd.files.trust import open_own
from etd.protocol.errors import FileError

#: The daemon of `--board fake` ends with its command: what is saved is by this name.
_OF_FAKE = "fake"


def name_of_daemon(args: argparse.Namespace) -> str:
    """By which its progress is saved."""
    return _OF_FAKE if args.board is not None else str(args.name)


def made_on(args: argparse.Namespace, display: Display) -> str:
    """The board, whether it is a fake one, and which modelled finger is on that: what was found on
    a fake board is of no person, and must not be taken for a person's. And which daemon it is:
    several have one name, in another folder or on another computer.
    """
    board, finger = display.facts.board, args.finger
    named = f"{board.name} ({board.backend})"
    if finger is not None:
        named = f"{named}, finger {finger.kind}:{finger.seed}"
    return named if args.board is not None else f"{named}, daemon {display.place}"


def kept_of_restart(args: argparse.Namespace, file: Path, conditions: Conditions) -> Kept:
    """What was too strong outlives `--restart`, unless it is to be forgotten by name; one sentence
    says so.
    """
    if args.forget_too_strong:
        return Kept({}, {}, None, "")
    kept = kept_anew(file, conditions)
    if kept.said:
        print(kept.said, file=sys.stderr, flush=True)
    return kept


@contextmanager
def alone(args: argparse.Namespace, which: str) -> Iterator[None]:
    """Until the command ends, however it ends: of two that go on with the same each would save what
    it knows, and undo what was too strong for the other. Raises: FileError.
    """
    path = calibrating_file(name_of_daemon(args), which).with_suffix(".lock")
    check_progress_folder(path)
    lock = _locked(path, which)
    try:
        yield
    finally:
        os.close(lock)


def _locked(path: Path, which: str) -> int:
    """The file stays: otherwise two could lock different files. Raises: FileError."""
    try:
        lock = open_own(path, os.O_RDWR | os.O_CREAT, 0o600)
    except OSError as error:
        why = f"it cannot be opened ({error.strerror})"
        raise FileError(str(path), "", why, "check its permissions") from error
    try:
        fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        os.ftruncate(lock, 0)
        os.write(lock, f"{os.getpid()}\n".encode())
    except BlockingIOError:
        holder = os.read(lock, 32).decode("ascii", "replace").strip() or "unknown"
        os.close(lock)
        raise FileError(
            str(path),
            "",
            f"process {holder} calibrates {which} on a daemon of this name already",
            "wait until it has ended, or end it (q pauses it); another person has another code",
        ) from None
    except OSError as error:
        os.close(lock)
        why = f"it cannot be locked ({error.strerror})"
        raise FileError(str(path), "", why, "keep the state on a disk of this computer") from error
    return lock
