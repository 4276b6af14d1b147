"""What a self-test found: each check, the report, its file, and whether it lets a board be armed.

Owns: the format of a report, keeping it whole, and the sentence why a board may not be armed.
Must not know: how anything is checked.
"""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Literal

import msgspec

from etd.files.atomic_file import write_atomically
from etd.protocol.errors import FileError
from etd.selftest.subject import Subject, difference
from etd_hal.boardfile import BoardFile, HalfBridgeLines

Result = Literal["pass", "fail", "skip", "absent"]

#: What no check can see, whatever the board: a person has to, once (docs/bring-up.md).
UNPROVED = (
    "other pulses than of a probe's width: no other one is fired; the machine's planned times and"
    " the board file's figures are what longer ones lean on",
    "the current through the load itself: all figures lean on the load's value and on the divider",
    "a source that fails short, and what the supply's store holds then",
    "a pull on the board's side: at the pin, the Raspberry Pi's own pull reads alike",
    "a clock lost now and then that moves no output of the load: clip it to the outputs that are"
    " farthest along the chain",
    "an LE that misses one edge in several hundred: a single miss in the walk looks like a touch"
    " that bounces",
    "SPI mode 0 or 2 in place of 1: both chips read alike as long as the cable leaves the DAC its"
    " hold time",
    "a switch that gives way to strong pulses only: all but the load's two were seen with probes",
    "what a source makes in the first 10 us of a pulse, between its two samples, or for some us"
    " after its end: an oscilloscope at the load shows it",
    "a source more than 24 times too strong, or that jumps between two probes, before it fired one"
    " pulse: that pulse exceeds the bound, and is the last",
    "hands that come to the array while stage 8 fires: its strong pulses go to whatever is there",
)


_UNWATCHED = (
    "without a rail_monitor nobody sees when the supply begins to fall, only that it is gone"
)


def unproved_of(board: BoardFile) -> tuple[str, ...]:
    """What no check of this board can see."""
    guards = board.guards
    found = list(UNPROVED)
    if isinstance(board.switch.lines, HalfBridgeLines):
        swapped = "" if board.sync_line == "absent" else ", or swapped with SYNC"
        found.append(
            f"a wire of POL that is cut beyond the pin, or held low there{swapped}: either polarity"
            " loads the source alike"
        )
    if board.sync_line != "absent":
        found.append("a wire of SYNC that is cut beyond the pin: only what listens to it sees that")
    if guards.rail_monitor != "absent":
        return tuple(found)
    if guards.heartbeat != "absent":
        found.append(
            f"whether the heartbeat's window is {guards.heartbeat.window_ms} ms: {_UNWATCHED}"
        )
    if guards.stop_cuts_supply and {guards.emergency_stop, guards.wearer_stop} != {"absent"}:
        found.append(f"how soon a stop cuts the supply: {_UNWATCHED}")
    return tuple(found)


class Check(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A check. `advice` is empty where nothing is to be done."""

    stage: str
    name: str
    result: Result
    measured: str = ""
    expected: str = ""
    advice: str = ""

    @property
    def is_good(self) -> bool:
        """A skip is never a pass; a guard that the board file declares absent is no failure."""
        return self.result in ("pass", "absent")

    @property
    def title(self) -> str:
        return f"{self.stage}: {self.name}"


class ProbeBound(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What no pulse exceeds while no dummy load was found; a third of it is what is asked for.

    It holds for a source that is up to 24 times too strong from the first pulse on. One that is
    stronger, or that becomes so between two pulses, is seen by the pulse that exceeds it.
    """

    current_ua: int
    width_us: int
    charge_nc: float


class Report(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A whole self-test, to be kept with a study's records. Lists are in the order of checking."""

    etd_selftest: Literal[3] = 3
    passed: bool
    date: datetime.datetime
    subject: Subject
    versions: dict[str, str]
    machine_facts: tuple[str, ...]
    absent_guards: tuple[str, ...]
    bound: ProbeBound
    dummy_load_ohm: int | None
    second_load_ohm: int | None
    load_electrodes: tuple[int, int] | None
    not_seen: tuple[str, ...]
    checks: tuple[Check, ...]

    @property
    def is_pass(self) -> bool:
        """It says so, and so do its checks; without any, nothing was looked at."""
        return self.passed and bool(self.checks) and self.first_bad is None

    @property
    def first_bad(self) -> Check | None:
        """A failed check before a skipped one."""
        bad = [check for check in self.checks if not check.is_good]
        return next((check for check in bad if check.result == "fail"), bad[0] if bad else None)


def to_json(report: Report) -> bytes:
    return msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n"


def save(report: Report, path: Path) -> None:
    """Whole or not at all: a power cut leaves the old one or the new one. Raises: FileError."""
    try:
        path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
        write_atomically(path, to_json(report), mode=0o644)
    except OSError as error:
        raise FileError(
            str(path),
            "",
            f"the report cannot be kept ({error.strerror})",
            "run it as the user who owns that folder (sudo on an installed system)",
        ) from error


def load(path: Path) -> Report | None:
    """None where there is none. Raises: FileError for one that cannot be read."""
    try:
        return msgspec.json.decode(path.read_bytes(), type=Report)
    except FileNotFoundError:
        return None
    except (OSError, msgspec.MsgspecError) as error:
        raise FileError(
            str(path),
            "",
            f"it is not a report of this version of the program ({error})",
            "run etd selftest",
        ) from error


_COMMAND = "etd selftest"
#: The lines have one holder.
_AGAIN = f"run {_COMMAND}, with the daemon stopped"


def arming_refusal(path: Path, now: Subject) -> str | None:
    """The sentence for which arming is refused; None where the last self-test allows it.

    A fake needs no self-test, because its skin is nobody's; but one that did not pass counts.
    """
    is_fake = now.backend == "fake"
    try:
        report = load(path)
    except FileError as error:
        return str(error)
    if report is None:
        return None if is_fake else f"this board has not been tested (no {path}): {_AGAIN}"
    another = difference(report.subject, now)
    if another is not None:
        return None if is_fake else _of_another(report, another)
    bad = report.first_bad
    if report.is_pass:
        return None
    what = "it was cut short" if bad is None else f"{bad.title} ({bad.result}) {bad.measured}"
    remedy = f"put that right, {_AGAIN}"
    if is_fake:
        remedy = (
            f"on this fake {_COMMAND} --board fake:{now.board} --array {now.array}"
            " --dummy-load 47000 --second-load 10000 --load-electrodes 0,1 puts it right, and so"
            f" does removing {path}"
        )
    return f"the self-test of {report.date:%Y-%m-%d %H:%M} did not pass: {what.strip()}: {remedy}"


def _of_another(report: Report, another: str) -> str:
    date = f"{report.date:%Y-%m-%d %H:%M}"
    return f"the last self-test, of {date}, was of {another}: {_AGAIN}"
