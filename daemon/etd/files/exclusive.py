"""One gateway for one name, one engine for one folder of its own, one command that starts both.

Owns: the lock that refuses a second one before it does anything: a gateway would silently take over
the Unix sockets of the first, an engine what is kept of the board that the first drives, and of two
commands each would get one part. Must not know: sockets, boards.
"""

from __future__ import annotations

import fcntl
import os
from pathlib import Path

from etd.files.trust import open_own
from etd.protocol.errors import AlreadyRunning

#: A file of the folder of sockets.
GATEWAY, BOTH_PARTS = "gateway.lock", "run.lock"
#: A file beside the engine's note of the supply, by backend.
ENGINE = {"linux": "engine-linux.lock", "fake": "engine-fake.lock"}


class NameLock:
    """Of such a file. Held until `close`, or until the process ends however it ends.
    Raises: AlreadyRunning, FileError (something else is in the place of the lock).
    """

    def __init__(self, folder: Path, name: str, file: str = GATEWAY) -> None:
        path = folder / file
        # The owner's alone: another user who may open it can lock it, and keep this from starting.
        self._fd: int | None = open_own(path, os.O_RDWR | os.O_CREAT, 0o600)
        try:
            if os.geteuid() == 0:  # Else the service that has the folder could not open it again.
                owner = folder.stat()
                os.fchown(self._fd, owner.st_uid, owner.st_gid)
            os.fchmod(self._fd, 0o600)
            fcntl.flock(self._fd, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            holder = os.read(self._fd, 32).decode("ascii", "replace").strip() or "unknown"
            self.close()
            raise AlreadyRunning(name, f"process {holder} holds {path}") from None
        os.ftruncate(self._fd, 0)
        os.write(self._fd, f"{os.getpid()}\n".encode())

    def close(self) -> None:
        """Idempotent. The file stays: otherwise two could lock different files."""
        if self._fd is not None:
            os.close(self._fd)
            self._fd = None
