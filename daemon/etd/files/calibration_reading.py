"""Calibrations read for the engine or the gateway, in a process that ends when it has answered.

Owns: whose folder and file are trusted, how much of a file is read, and what the process gives up
before it parses. Must not know: the engine, boards, what a calibration allows.

A file is opened past no link, and only where the gateway's user could have written neither it nor
a folder above it; where that is the engine's own, and for what the gateway shows, where no other
user could. Then the process keeps the pipe of its answer and closes all else, and gives up
every call of the kernel but those of computing (`etd_hal/confinement.py`). Only then is a byte of a
file decoded, within bounds of memory and time. Where the kernel does not confine it, no file is.
"""

from __future__ import annotations

import os
import resource
import signal
from collections.abc import Callable
from functools import partial
from pathlib import Path

import msgspec

from etd.files import paths, trust
from etd.files.calibration import calibration_of_bytes
from etd.files.calibration_folder import MOST_FILE_BYTES
from etd.protocol.calibration import Calibration
from etd.protocol.errors import ErrorCode, FileError, NotConfined
from etd.protocol.frame import Name
from etd.protocol.peer import Peer
from etd_hal.confinement import confine
from etd_hal.tomlfile import load_bytes

#: Of those of a lease together, in msgpack: they fit into a message between engine and gateway.
MOST_TOGETHER_BYTES = 160 * 1024
#: What Python and its libraries map is some 100 MB; the largest file takes 20 MB more.
MEMORY_BYTES = 256 * 1024 * 1024
_PROCESSOR_S = 6
#: It ends by itself then, if the engine has died and can end it no more.
_LIFE_S = 20


class Asked(msgspec.Struct, frozen=True, kw_only=True):
    """`shipped`: the folder of the program's own, where they may be named; it is trusted as the
    program is. `gateway`: who must not have been able to write; None: it is the gateway that asks,
    for what it shows to clients.
    """

    names: tuple[Name, ...]
    folder: str
    shipped: str | None
    gateway: Peer | None


class Found(msgspec.Struct, frozen=True, kw_only=True):
    """`error` None: all of them, in the order of their names."""

    calibrations: tuple[Calibration, ...] = ()
    error: ErrorCode | None = None
    reason: str = ""


def main(asked: str, answer: int, scan_core: int | None) -> None:
    """In the process itself. `asked`: JSON; `answer`: a file descriptor; `scan_core`: to be left.
    Never returns.
    """
    signal.alarm(_LIFE_S)
    _leave(scan_core)
    give_up = partial(_give_up, answer)
    status = 1
    try:
        os.write(answer, answer_to(msgspec.json.decode(asked, type=Asked), give_up))
        status = 0
    finally:
        # Printing an unexpected error takes system calls that are not left.
        os._exit(status)


def answer_to(asked: Asked, give_up: Callable[[], None]) -> bytes:
    """A `Found`, in msgpack. `give_up` is called once all files are read, and none is decoded."""
    try:
        data = [_read(name, asked) for name in asked.names]
        give_up()
        found = Found(calibrations=tuple(calibration_of_bytes(*each) for each in data))
    except (FileError, NotConfined) as error:
        found = Found(error="bad_calibration", reason=str(error))
    except OSError as error:
        code: ErrorCode = "not_found" if isinstance(error, FileNotFoundError) else "bad_calibration"
        why = f"{error.filename} cannot be read: {error.strerror}"
        found = Found(error=code, reason=why)
    except MemoryError:
        found = Found(error="bad_calibration", reason="a calibration takes too much memory")
    encoded = msgspec.msgpack.encode(found)
    if len(encoded) <= MOST_TOGETHER_BYTES:
        return encoded
    why = (
        f"the calibrations together have {len(encoded)} bytes, and a lease has at most"
        f" {MOST_TOGETHER_BYTES}: open with fewer, or calibrate with returns as a ring"
    )
    return msgspec.msgpack.encode(Found(error="too_large", reason=why))


def _read(name: str, asked: Asked) -> tuple[Path, bytes]:
    """Its path and its bytes. Raises: FileError, OSError."""
    own = Path(asked.folder)
    path, shipped = own / f"{name}.toml", Path(asked.shipped or own) / f"{name}.toml"
    if asked.shipped is not None and not os.path.lexists(path):
        return shipped, bytes_of(shipped, trust.open_own(shipped, os.O_RDONLY))
    if asked.gateway is None or asked.gateway.uid == os.geteuid():
        # Both are one user's, or it is the gateway: only others are to be kept apart.
        paths.check_own(own)
        return path, bytes_of(path, paths.open_unshared(path))
    trust.check_beyond(own, asked.gateway)
    return path, bytes_of(path, trust.open_beyond(path, asked.gateway))


def bytes_of(path: Path, number: int) -> bytes:
    """Of an open file, if it is no larger than one may be. Raises: FileError, OSError."""
    with os.fdopen(number, "rb") as file:
        data = b""
        if os.fstat(number).st_size <= MOST_FILE_BYTES:
            data = file.read(MOST_FILE_BYTES + 1)
    if not 0 < len(data) <= MOST_FILE_BYTES:
        raise FileError(
            str(path), "", "it is empty, or too large", f"a file has 1 to {MOST_FILE_BYTES} bytes"
        )
    return data


def _leave(scan_core: int | None) -> None:
    """Where this machine has other cores."""
    others = set(range(os.cpu_count() or 1)) - {scan_core}
    try:
        os.sched_setaffinity(0, others)
    except OSError:
        pass  # they are not this program's to use: the scan goes first all the same


def _give_up(answer: int) -> None:
    """From here on it computes, writes `answer` and ends; at anything else the kernel ends it.
    What is imported late is loaded before. Raises: NotConfined.
    """
    load_bytes(Path("nothing"), dict, b"")
    os.closerange(0, answer)
    os.closerange(answer + 1, resource.getrlimit(resource.RLIMIT_NOFILE)[0])
    for bound, most in (
        (resource.RLIMIT_AS, MEMORY_BYTES),
        (resource.RLIMIT_CPU, _PROCESSOR_S),
        (resource.RLIMIT_CORE, 0),
    ):
        resource.setrlimit(bound, (most, most))
    confine(answer)
