"""The one tree of errors, and the branches that begin at the edge to hardware.

    EtdError
    ├── BusError           a port call failed: kind, device, operation
    ├── HardwareMissing    all that is missing at start, with what to do about each
    ├── BoardFault         the board does not behave: what, measured, expected
    ├── GuardRefusal       bytes about to go out break a rule: rule, value, allowed
    ├── CannotSelect       the board has no such state of an output: output, wanted
    ├── FileError          a file says something that cannot be: file, key, value, allowed
    ├── NotConfined        a process cannot give up a right: what, why
    └── PythonTooOld       the client runs on this Python, this does not: what, needed, found

(`etd.protocol.errors` adds what can be wrong with a frame, a request or a daemon.)

Owns: what can go wrong at the edge, with fields. Must not know: frames, clients.
"""

from __future__ import annotations

import errno as errno_names
import sys
from typing import Literal

#: `permission`: the file's owner, group and mode do not let it be opened. `forbidden`: they do, and
#: the service that asks may not.
BusErrorKind = Literal[
    "absent",
    "busy",
    "forbidden",
    "gone",
    "invalid",
    "io",
    "permission",
    "short",
    "timeout",
    "too_long",
]

_KIND_OF_ERRNO: dict[int, BusErrorKind] = {
    errno_names.EACCES: "permission",
    errno_names.EBUSY: "busy",
    errno_names.EINVAL: "invalid",
    errno_names.EMSGSIZE: "too_long",
    errno_names.ENODEV: "gone",
    errno_names.ENOENT: "absent",
    errno_names.ENXIO: "absent",
    errno_names.EPERM: "forbidden",
    errno_names.EREMOTEIO if hasattr(errno_names, "EREMOTEIO") else 121: "absent",
    # The error of spidev once its controller is gone.
    errno_names.ESHUTDOWN: "gone",
    errno_names.ETIMEDOUT: "timeout",
}


class EtdError(Exception):
    """The root: every error this project raises on purpose. Its fields cross processes with it."""

    def __reduce__(self) -> tuple[object, ...]:
        # Unpickling makes an exception from `args`, which here differ from the constructor's
        # arguments.
        return _again, (type(self), self.args), self.__dict__


def _again(kind: type[EtdError], args: tuple[object, ...]) -> EtdError:
    return kind.__new__(kind, *args)


class BusError(EtdError):
    """A port call failed.

    Fields: kind, device (path or line), operation, detail.
    """

    def __init__(self, kind: BusErrorKind, device: str, operation: str, detail: str = "") -> None:
        self.kind: BusErrorKind = kind
        self.device = device
        self.operation = operation
        self.detail = detail
        super().__init__(
            f"{operation} on {device} failed ({kind}){': ' + detail if detail else ''}"
        )

    @classmethod
    def of(cls, error: OSError, device: str, operation: str) -> BusError:
        """Translate the kernel's answer; unknown numbers are plain `io`."""
        kind = _KIND_OF_ERRNO.get(error.errno or 0, "io")
        return cls(kind, device, operation, error.strerror or str(error))


class HardwareMissing(EtdError):
    """All that was missing when the hardware was opened, each with what to do about it.

    Fields: problems; may_come: each problem may go away by itself, because the system is still
    setting its devices up.
    """

    def __init__(self, problems: tuple[str, ...], may_come: bool = False) -> None:
        self.problems = problems
        self.may_come = may_come
        lines = "".join(f"\n  - {problem}" for problem in problems)
        super().__init__(f"the hardware cannot be used:{lines}")


class BoardFault(EtdError):
    """The board, or the machine under it, does not behave as its files say.

    Fields: what, measured, expected.
    """

    def __init__(self, what: str, measured: str, expected: str) -> None:
        self.what = what
        self.measured = measured
        self.expected = expected
        super().__init__(f"{what}: measured {measured}, expected {expected}")


class GuardRefusal(EtdError):
    """The last guard refused bytes that were about to go out. Nothing was sent.

    Fields: rule (a short name), value, allowed.
    """

    def __init__(self, rule: str, value: str, allowed: str) -> None:
        self.rule = rule
        self.value = value
        self.allowed = allowed
        super().__init__(f"guard refused ({rule}): {value}, allowed is {allowed}")


class CannotSelect(EtdError):
    """The board cannot put these outputs of its switches into these states.

    Fields: output (the board's own number, not an electrode's), wanted.
    """

    def __init__(self, output: int, wanted: str, why: str) -> None:
        self.output = output
        self.wanted = wanted
        super().__init__(f"output {output} of the switches cannot be {wanted}: {why}")


class FileError(EtdError):
    """A file says something that cannot be.

    Fields: file, key (path to it), value, allowed (what to write instead).
    """

    def __init__(self, file: str, key: str, value: str, allowed: str) -> None:
        self.file = file
        self.key = key
        self.value = value
        self.allowed = allowed
        where = f"{file}: {key}" if key else file
        super().__init__(f"{where}: {value}; {allowed}")


class NotConfined(EtdError):
    """This kernel, or what this process runs in, does not take from it what it is to give up.

    Fields: what, why.
    """

    def __init__(self, what: str, why: str) -> None:
        self.what = what
        self.why = why
        super().__init__(
            f"this process could not be confined: {what} was not granted ({why}); it needs a 64-bit"
            " system on x86-64 or ARM, a kernel with CONFIG_SECCOMP_FILTER, and no container that"
            " forbids prctl"
        )


class PythonTooOld(EtdError):
    """Something that needs a newer Python than the client does.

    Fields: what, needed, found (both like "3.11").
    """

    def __init__(self, what: str, needed: str, found: str) -> None:
        self.what = what
        self.needed = needed
        self.found = found
        super().__init__(
            f"{what} needs Python {needed} or newer, and {sys.executable} is Python {found}, which"
            " runs etd's client only: install 'etd[daemon]' for a newer Python, here or on the"
            " computer with the board"
        )
