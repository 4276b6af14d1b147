"""The upper branches of the one tree of errors (the root and the HAL's are in `etd_hal.errors`).

    EtdError
    ├── Refused            a frame or a request was not accepted: code, reason, electrode
    ├── DaemonGone         no daemon answers at that address: address
    ├── AlreadyRunning     a daemon of that name holds the lock: name, holder
    ├── Undecodable        a datagram between gateway and engine cannot be decoded: reason
    ├── PartEnded          a process of the daemon ended by itself: part, how, status
    └── PatternError       a pattern file cannot be played: file, frame, reason

Owns: what can be wrong with a frame, a request or a daemon. `ErrorCode` is the closed list of the
protocol; adding to it is a change of the protocol.
"""

from __future__ import annotations

import shlex
import sys
from typing import Literal, TypedDict

from etd.protocol.text import escaped, shown
from etd_hal.errors import (
    BoardFault,
    BusError,
    CannotSelect,
    EtdError,
    FileError,
    GuardRefusal,
    HardwareMissing,
    NotConfined,
    PythonTooOld,
)

__all__ = [
    "AlreadyRunning",
    "BoardFault",
    "BusError",
    "CannotSelect",
    "DaemonGone",
    "ErrorCode",
    "EtdError",
    "FileError",
    "GuardRefusal",
    "HardwareMissing",
    "LibraryMissing",
    "NotConfined",
    "PartEnded",
    "PatternError",
    "PythonTooOld",
    "Refused",
    "TimePart",
    "Undecodable",
]

ErrorCode = Literal[
    "arm_failed",  # a check before arming failed; the reason says which
    "bad_calibration",  # it does not fit this board, array or body site
    "bad_frame",  # lengths, electrodes or combinations that cannot be
    "bad_message",  # not a JSON object, unknown key, wrong type, out of bounds
    "board_cannot",  # the board has no such electrode state or line
    "busy",  # too many requests under way; send again
    "engine_gone",  # the process that drives the board is not there
    "expired",  # the frame was too old when it came
    "halted",  # latched: look at the cause, then clear
    "level_needs_calibration",  # send current_ua, or a calibration that felt this electrode
    "limits_missing",  # open with a calibration or with limits
    "no_lease",  # there is no lease, or it has lapsed
    "no_record",  # none is being written
    "not_armed",  # arm first
    "not_found",  # no such calibration or record
    "not_permitted",  # operate rights are needed
    "old_seq",  # seq must rise within a lease
    "other_lease",  # another client holds the lease
    "over_limit",  # a strict frame asked for more than a person's limit
    "over_maximum",  # more than the maxima of code, board and body site
    "record_failed",  # a record cannot be written, read or deleted; the reason says why
    "too_fast",  # the pulses do not fit into the period; the reason names the achievable rate
    "too_large",  # over the size limit of a message
    "unknown_op",
    "wrong_state",  # not in this state; the reason names it
]


#: What takes the time of a scan: messages and calls; the board's rests; computing.
TimePart = Literal["wire", "rest", "processor"]


class RefusalFields(TypedDict):
    """A refusal as every message has it that tells of one."""

    error: ErrorCode
    reason: str
    electrode: int | None
    achievable_hz: float | None
    bound_by: TimePart | None


class Refused(EtdError):
    """A frame or request was not accepted, and nothing else changed.

    Fields: code, reason, electrode (or None); with `too_fast` achievable_hz and bound_by.
    """

    def __init__(
        self,
        code: ErrorCode,
        reason: str,
        electrode: int | None = None,
        achievable_hz: float | None = None,
        bound_by: TimePart | None = None,
    ) -> None:
        self.code: ErrorCode = code
        self.reason = reason
        self.electrode = electrode
        self.achievable_hz = achievable_hz
        self.bound_by = bound_by
        # The last line of a traceback: one line, whatever the reason quotes.
        super().__init__(escaped(f"{reason} ({code})"))

    @property
    def fields(self) -> RefusalFields:
        """For a message to whoever asked."""
        return {
            "error": self.code,
            "reason": self.reason,
            "electrode": self.electrode,
            "achievable_hz": self.achievable_hz,
            "bound_by": self.bound_by,
        }


def halted(cause: str, source: str, detail: str) -> Refused:
    """What every request gets that needs another state."""
    return Refused(
        "halted",
        f"halted by {cause} ({source}: {detail}): see that the cause is gone (`etd status` shows"
        " it), then run `etd clear`",
    )


#: Of a daemon whose sockets accept connections, though no answer comes.
HELD_UP = "it is there, but hangs, or is held up by other programs: `etd status` asks it again"

#: For a command whose own daemon is not ready, or does not answer.
NO_TIME = "its processes run, but were held up: start it again on a machine that has time for them"


class DaemonGone(EtdError):
    """No daemon answers. Fields: address, what, advice."""

    def __init__(
        self,
        address: str,
        what: str,
        advice: str = "is the daemon running? (a fake one: etd run --board fake)",
    ) -> None:
        self.address = address
        self.what = what
        self.advice = advice
        # A host or a folder may have any name.
        super().__init__(shown(f"{what} at {address}: {advice}"))


class PackageMissing(EtdError):
    """A Python package that this verb needs is not installed. Fields: package, line (which installs
    it for the Python that runs this).
    """

    def __init__(self, package: str, extra: str, otherwise: str = "") -> None:
        self.package = package
        self.line = f"{shlex.quote(sys.executable)} -m pip install 'etd[{extra}]'"
        super().__init__(
            f"the Python package {package} is not installed{otherwise}; this line installs it:"
            f" {self.line}"
        )


class LibraryMissing(EtdError):
    """A library that a Python package needs is not there. Fields: library."""

    def __init__(self, library: str, what_to_do: str) -> None:
        self.library = library
        super().__init__(f"the library {library} is not there: {what_to_do}")


class WrongThread(EtdError):
    """A display is used where it cannot work. Fields: reason."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(f"this display cannot be used here: {reason}")


class AlreadyRunning(EtdError):
    """A second daemon of the same name. Fields: name."""

    def __init__(self, name: str, what: str) -> None:
        self.name = name
        super().__init__(
            f"a daemon named {name!r} is already running ({what}): stop it, or give another --name,"
            " and other folders where --folder or --state names one"
        )


class Undecodable(EtdError):
    """A datagram between gateway and engine that is no message of the other end. Fields: reason."""

    def __init__(self, reason: str) -> None:
        # The reason may quote the message, and stays in every state report.
        reason = escaped(reason)
        self.reason = reason if len(reason) <= 200 else f"{reason[:200]} (cut short)"
        super().__init__(f"a message that could not be decoded: {self.reason}")


class PartEnded(EtdError):
    """Engine or gateway ended unexpectedly. Fields: part, how, status (to exit with: the part's
    own, or 1 if a signal ended it).
    """

    def __init__(self, part: str, how: str, status: int) -> None:
        self.part = part
        self.how = how
        self.status = status
        super().__init__(f"the {part} ended ({how}), so the daemon is ended as a whole")


class PatternError(EtdError):
    """A pattern file cannot be played. Fields: file, frame (index or None), reason."""

    def __init__(self, file: str, frame: int | None, reason: str) -> None:
        self.file = file
        self.frame = frame
        self.reason = reason
        where = file if frame is None else f"{file}, frame {frame}"
        super().__init__(shown(f"{where}: {reason}"))
