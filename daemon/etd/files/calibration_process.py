"""The process that reads calibrations for another one: started, heard and ended without waiting.

Owns: what it inherits, how much it may answer, and what its end means. Must not know: what it
reads, how files are trusted (`files/calibration_reading.py`), leases.

A program of its own and no fork: it inherits one pipe, and no device, socket or memory of the
engine or of the gateway. Its answer is decoded as any message of another process is.
"""

from __future__ import annotations

import contextlib
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Protocol

import msgspec

from etd.files.calibration_reading import MOST_TOGETHER_BYTES, Asked, Found
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.peer import Peer
from etd.protocol.text import shown

_READ_BYTES = 65_536
_ENDS_WITHIN_S = 2.0
#: Behind the engine and the gateway, ahead of programs at nice 19.
_NICE = 10
_decoder = msgspec.msgpack.Decoder(Found)


class CalibrationReader(Protocol):
    """One reading at a time. None of these waits."""

    def begin(self, names: Sequence[str], gateway: Peer | None) -> None:
        """`gateway`: who must not have been able to write them; None: it reads for itself. Raises:
        Refused.
        """

    def result(self) -> tuple[Calibration, ...] | None:
        """In the order of the names; None while they are read. Raises: Refused."""

    def cancel(self) -> None:
        """What was begun is ended. Idempotent."""


class CalibrationProcess:
    """See `CalibrationReader`. `shipped`: for a fake's body only. `module`: whose `main`
    the process calls.
    """

    def __init__(
        self,
        folder: Path,
        shipped: Path | None,
        scan_core: int | None,
        module: str = "etd.files.calibration_reading",
    ) -> None:
        self._folder = folder
        self._shipped = shipped
        self._scan_core = scan_core
        self._module = module
        self._process: subprocess.Popen[bytes] | None = None
        self._answer = -1
        self._said = bytearray()
        self._wanted = self._status = 0

    def begin(self, names: Sequence[str], gateway: Peer | None) -> None:
        """Raises: Refused (`busy`, `bad_calibration`)."""
        if self._process is not None and not self._is_over():
            raise Refused("busy", "the last reading of a calibration is still ending: ask again")
        asked = Asked(
            names=tuple(names),
            folder=str(self._folder),
            shipped=None if self._shipped is None else str(self._shipped),
            gateway=gateway,
        )
        self._said.clear()
        self._wanted = len(names)
        try:
            self._start(msgspec.json.encode(asked).decode())
        except OSError as error:
            raise Refused(
                "bad_calibration",
                f"no process could be started to read a calibration: {error.strerror}",
            ) from error

    def result(self) -> tuple[Calibration, ...] | None:
        """Raises: Refused (`bad_calibration`, `not_found`, `too_large`)."""
        if self._answer >= 0 and self._has_ended():
            self.cancel()
        if self._answer >= 0 or not self._is_over():
            return None
        try:
            found = _decoder.decode(self._said)
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError):
            raise self._no_answer() from None
        if found.error is not None:
            raise Refused(found.error, shown(found.reason))
        if len(found.calibrations) != self._wanted:
            raise self._no_answer()
        return found.calibrations

    def _no_answer(self) -> Refused:
        if self._status == -signal.SIGSYS:
            return Refused(
                "bad_calibration",
                "the kernel ended the process that reads calibrations: it asked for a call that"
                " parsing does not need. Do not use this file: it may be an attack; have it"
                " examined (SECURITY.md). If every file ends so, this Python needs another call"
                " than those that are known: run the daemon with another one",
            )
        return Refused(
            "bad_calibration",
            f"the process that reads calibrations ended without an answer (status {self._status}):"
            " the file takes too much time or memory, or something ended the process (etd check"
            " FILE)",
        )

    def cancel(self) -> None:
        """Idempotent. The process may take a moment until it is over."""
        if self._answer >= 0:
            os.close(self._answer)
            self._answer = -1
        if self._process is not None and not self._is_over():
            self._process.kill()

    def end(self) -> None:
        """The same, and waits until it is over, for so long. Idempotent."""
        self.cancel()
        if self._process is not None:
            with contextlib.suppress(subprocess.TimeoutExpired):
                self._process.wait(_ENDS_WITHIN_S)

    def _start(self, asked: str) -> None:
        reading, writing = os.pipe2(os.O_CLOEXEC)
        program = (
            f"import sys; sys.path[:] = {sys.path!r}; from {self._module} import main;"
            f" main({asked!r}, {writing}, {self._scan_core!r})"
        )
        try:
            self._process = subprocess.Popen(
                # It finds modules where this process does, and no file of site packages is run.
                [sys.executable, "-I", "-S", "-c", program],
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                pass_fds=(writing,),
                env={},
                cwd="/",
                process_group=0,
            )
        except BaseException:
            os.close(reading)
            raise
        finally:
            os.close(writing)
        # Where that is not permitted it shares the processor.
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, self._process.pid, _NICE)
        os.set_blocking(reading, False)
        self._answer = reading

    def _has_ended(self) -> bool:
        """Reads what has come; True at the end of it, or where it is more than an answer."""
        while len(self._said) <= MOST_TOGETHER_BYTES:
            try:
                piece = os.read(self._answer, _READ_BYTES)
            except BlockingIOError:
                return False
            if not piece:
                return True
            self._said += piece
        return True

    def _is_over(self) -> bool:
        if self._process is not None and (status := self._process.poll()) is not None:
            self._process, self._status = None, status
        return self._process is None
