"""A record's file while it is written: a thread writes what has gathered, each 100 ms.

Owns: the file, its bound, what it leaves free of the disk, what is lost to a slow one, and what
went wrong. Must not know: what a line says.

The gateway never waits for a disk. What was written is in the kernel's hands at once, and on the
disk within a second; killing the gateway loses a tenth of a second at most, and no line is half
there but the last one.
"""

from __future__ import annotations

import contextlib
import os
import threading
from pathlib import Path

#: No record is longer: ten minutes of 64 electrodes at 60 Hz take half of it.
MOST_BYTES = 512 * 1024 * 1024
#: What waits for the disk at most.
_WAITING_BYTES = 8 * 1024 * 1024
_WRITE_S = 0.1
_WRITES_A_SYNC = 10
#: What a record leaves of a disk: the engine's note of its supply, without which nothing is armed,
#: and all that else is kept there, must find room.
RESERVE_BYTES = 256 * 1024 * 1024
DISK_SHORT = f"less than {RESERVE_BYTES // 1024**2} MiB are free on the disk"


class Disk:
    """What a record asks of the disk that it is on."""

    def write(self, fd: int, data: bytes) -> int:
        return os.write(fd, data)

    def free_bytes(self, folder: Path) -> int:
        """For a user who is not root. Raises: OSError."""
        found = os.statvfs(folder)
        return found.f_bavail * found.f_frsize


class RecordFile:
    """Raises, when made: OSError (FileExistsError: a record of that name is there)."""

    def __init__(self, path: Path, disk: Disk, most_bytes: int = MOST_BYTES) -> None:
        self.path = path
        self._most_bytes = most_bytes
        self._disk = disk
        self._fd = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | os.O_CLOEXEC, 0o640)
        self._waiting: list[bytes] = []
        self._waiting_bytes = 0
        self._lock = threading.Lock()
        self._is_closing = threading.Event()
        #: What was taken so far, written or not.
        self.taken_bytes = 0
        #: Lines that did not fit into memory since this was last asked.
        self._lost_lines = 0
        #: Why nothing is written any more, as the system says it.
        self.problem: str | None = None
        #: No more than the reserve is left: time to end.
        self.is_disk_short = False
        self._thread = threading.Thread(target=self._write_on, name="record", daemon=True)
        self._thread.start()

    def put(self, line: bytes, is_last: bool = False) -> bool:
        """Never blocks. False: it would pass the bound, and is not taken; the last one may."""
        if self.taken_bytes + len(line) > self._most_bytes and not is_last:
            return False
        with self._lock:
            if self._waiting_bytes + len(line) > _WAITING_BYTES:
                self._lost_lines += 1
                return True
            self._waiting.append(line)
            self._waiting_bytes += len(line)
        self.taken_bytes += len(line)
        return True

    def take_lost(self) -> int:
        """Lines lost since the last call, once there is room again to tell of them."""
        with self._lock:
            if self._waiting_bytes > _WAITING_BYTES // 2:
                return 0
            lost, self._lost_lines = self._lost_lines, 0
        return lost

    def close(self) -> None:
        """Nothing more comes; `is_closed` once the disk has it all. Never blocks. Idempotent."""
        self._is_closing.set()

    @property
    def is_closed(self) -> bool:
        return not self._thread.is_alive()

    def wait_closed(self, timeout_s: float) -> None:
        """Blocks: only for a gateway at its end."""
        self._thread.join(timeout_s)

    def _write_on(self) -> None:
        writes = 0
        try:
            while not self._is_closing.wait(_WRITE_S):
                writes += self._write()
                self.is_disk_short = self._disk.free_bytes(self.path.parent) < RESERVE_BYTES
                if writes >= _WRITES_A_SYNC:
                    writes = 0
                    os.fdatasync(self._fd)
            self._write()
            os.fdatasync(self._fd)
        except OSError as error:
            self.problem = error.strerror or str(error)
        finally:
            with contextlib.suppress(OSError):
                os.close(self._fd)

    def _write(self) -> bool:
        """Raises: OSError."""
        with self._lock:
            data, self._waiting = b"".join(self._waiting), []
            self._waiting_bytes = 0
        at = 0
        while at < len(data):
            at += self._disk.write(self._fd, data[at : at + 1_048_576])
        return bool(data)
