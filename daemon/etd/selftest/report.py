"""The result of a self-test: its checks, its report, the file, and whether it allows arming.

Owns: the format of a report, writing it atomically, and the reason why arming is refused.
Must not know: how anything is checked.
"""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Literal

import msgspec

from etd.files.atomic_file import write_atomically
from etd.files.paths import make_own
from etd.protocol.errors import FileError
from etd.selftest.subject import Subject, difference
from etd_hal.boardfile import BoardFile
from etd_hal.bounded_file import read_bounded

#: Many times what a report of any board has.
MOST_BYTES = 1_048_576

Result = Literal["pass", "fail", "skip", "absent"]

#: What no check covers, on any board: a person must check it once (docs/bring-up.md).
UNPROVED = (
    "pulses of another width than a probe's: none is fired; longer ones rely on the machine's"
    " planned times and the board file's figures",
    "the current through the load itself: all figures rely on the load's value and the divider",
    "a source that fails as a short circuit, and the charge in the supply's capacitor then",
    "a pull resistor on the board: at the pin, the Raspberry Pi's own pull reads the same",
    "a clock that is sometimes lost without moving an output with the load: connect the load to the"
    " outputs farthest along the chain",
    "an LE that misses one edge in several hundred: a single miss in the walk looks like a bouncing"
    " contact",
    "SPI mode 0 or 2 instead of 1: both chips read the same as long as the cable leaves the DAC its"
    " hold time",
    "a switch that fails with strong pulses only: all outputs but the load's two are tested with"
    " probes",
    "the source's current in the first 10 us of a pulse, between its two samples, and for some us"
    " after its end: an oscilloscope at the load shows it",
    "a source more than 24 times too strong, or one that jumps between two probes, before it has"
    " fired one pulse: that pulse exceeds the bound, and is the last",
    "hands on the array while stage 10 fires its strong pulses",
)


_UNWATCHED = "without a rail_monitor only the end of the supply's fall can be measured"


def unproved_of(board: BoardFile) -> tuple[str, ...]:
    """What no check of this board covers."""
    guards = board.guards
    found = list(UNPROVED)
    if board.sync_line != "absent":
        found.append("a wire of SYNC that is cut beyond the pin: check it at the receiving end")
    if board.trigger != "absent":
        found.append(
            "a wire of TRIGGER that is cut: join it to SYNC, and show a frame with on_trigger"
        )
    if board.too_strong != "absent":
        found.append(
            "a wire of TOO_STRONG that is cut: press it while armed, and see `said` in etd monitor"
        )
    if guards.rail_monitor != "absent":
        return tuple(found)
    if guards.heartbeat != "absent":
        found.append(
            f"whether the heartbeat's window is {guards.heartbeat.window_ms} ms: {_UNWATCHED}"
        )
    if guards.stop_cuts_supply and {guards.emergency_stop, guards.wearer_stop} != {"absent"}:
        found.append(f"the delay from a stop to the cut of the supply: {_UNWATCHED}")
    return tuple(found)


class Check(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A check. `advice` is empty unless something is to be done."""

    stage: str
    name: str
    result: Result
    measured: str = ""
    expected: str = ""
    advice: str = ""

    @property
    def is_good(self) -> bool:
        """A skip is not a pass; a guard that the board file declares absent is not a failure."""
        return self.result in ("pass", "absent")

    @property
    def title(self) -> str:
        return f"{self.stage}: {self.name}"


class ProbeBound(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """No pulse exceeds this before a dummy load is confirmed; a third of it is commanded.

    It holds for a source that is constantly too strong, by at most 24 times; see `prober`.
    """

    current_ua: int
    width_us: int
    charge_nc: float


class Report(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A whole self-test, for a study's records. Lists are in the order of checking."""

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
        """`passed` and all checks agree, and there are checks."""
        return self.passed and bool(self.checks) and self.first_bad is None

    @property
    def first_bad(self) -> Check | None:
        """A failed check before a skipped one."""
        bad = [check for check in self.checks if not check.is_good]
        return next((check for check in bad if check.result == "fail"), bad[0] if bad else None)


def to_json(report: Report) -> bytes:
    return msgspec.json.format(msgspec.json.encode(report), indent=2) + b"\n"


def save(report: Report, path: Path) -> None:
    """Atomic: a power cut leaves the old file or the new one. Raises: FileError."""
    try:
        make_own(path.parent, 0o755)
        write_atomically(path, to_json(report), mode=0o644)
    except OSError as error:
        raise FileError(
            str(path),
            "",
            f"the report cannot be written ({error.strerror})",
            "run it as the user who owns that folder (sudo on an installed system)",
        ) from error


def load(path: Path) -> Report | None:
    """None if there is none. Never waits. Raises: FileError if it cannot be read."""
    try:
        return msgspec.json.decode(read_bounded(path, MOST_BYTES), type=Report)
    except FileNotFoundError:
        return None
    except FileError as error:
        advice = "remove it, and run etd selftest"
        raise FileError(error.file, error.key, error.value, advice) from error
    except (OSError, msgspec.MsgspecError) as error:
        raise FileError(
            str(path),
            "",
            f"it is not a self-test report of this version ({error})",
            "run etd selftest",
        ) from error


_COMMAND = "etd selftest"
_AGAIN = f"stop the daemon and run {_COMMAND}"


def arming_refusal(path: Path, now: Subject) -> str | None:
    """Why arming is refused; None if the last self-test allows it.

    A fake needs no self-test, but one that did not pass counts.
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
        date = f"{report.date:%Y-%m-%d %H:%M}"
        return None if is_fake else f"the last self-test, of {date}, was of {another}: {_AGAIN}"
    bad = report.first_bad
    if report.is_pass:
        return None
    what = "it was cut short" if bad is None else f"{bad.title} ({bad.result}) {bad.measured}"
    remedy = f"correct that, then {_AGAIN}"
    if is_fake:
        one_shot = "" if "one_shot" in report.absent_guards else " --one-shot-us 250"
        remedy = (
            f"for a fake run {_COMMAND} --board fake:{now.board} --array {now.array}"
            f" --dummy-load 47000 --second-load 10000 --load-electrodes 0,1{one_shot}, or remove"
            f" {path}"
        )
    return f"the self-test of {report.date:%Y-%m-%d %H:%M} did not pass: {what.strip()}: {remedy}"
