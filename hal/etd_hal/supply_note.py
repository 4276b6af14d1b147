"""A note on the disk that the supply may be on: what is left of an engine that did not end well.

Owns: the file, that it is on the disk before it counts, and what one that was left says. Must not
know: who keeps it, and when.

The file is written before the supply goes on, and removed when the board has been made safe. One
that is there when an engine starts was left by a process that was killed, or ended by a defect of
its own, or by a machine that lost its power.
"""

from __future__ import annotations

import errno
import json
import os
import stat
from pathlib import Path

_BOOT = Path("/proc/sys/kernel/random/boot_id")
_MOST_BYTES = 4_096
#: What an engine that could still write said of its end.
_BY_DEFECT = "defect"


class SupplyNote:
    """See the module."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def keep(self) -> None:
        """It is there, or as it was before, whenever the power goes. Raises: OSError."""
        self._put({"boot": _boot()})

    def keep_as_defect(self) -> None:
        """As `keep`, by an engine that ends by a defect and can still say so. Raises: OSError."""
        self._put({"boot": _boot(), "ended": _BY_DEFECT})

    def _put(self, said: dict[str, str]) -> None:
        os.replace(self._written(said), self.path)
        self._sync_folder()

    def try_to_keep(self) -> None:
        """All of it but the last step: nothing is left, and one that is there stays as it is.

        Raises: OSError.
        """
        os.unlink(self._written({}))

    def _written(self, said: dict[str, str]) -> Path:
        """Beside the note, and on the disk. Raises: OSError."""
        new = self.path.with_name(f".{self.path.name}.new")
        left = json.dumps(said).encode() + b"\n"
        # Without O_NONBLOCK a pipe in its place would be waited for without an end.
        fd = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_NOFOLLOW | os.O_NONBLOCK, 0o600)
        try:
            found = os.fstat(fd)
            if not stat.S_ISREG(found.st_mode) or found.st_nlink != 1:
                raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(new))
            os.ftruncate(fd, 0)
            while left:
                left = left[os.write(fd, left) :]
            os.fsync(fd)
        finally:
            os.close(fd)
        return new

    def drop(self) -> None:
        """Idempotent. Raises: OSError."""
        try:
            os.unlink(self.path)
        except FileNotFoundError:
            return
        self._sync_folder()

    def left(self) -> str | None:
        """What a note says that was left, as a clause; None if there is none. A note that cannot be
        read was left too; of a folder that cannot be read nothing is known, and arming says so.
        """
        try:
            content = _read(self.path)
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            if not os.path.lexists(self.path):
                return None
            return f"a note was left that cannot be read ({error.strerror})"
        boot, ended = _said(content)
        if ended == _BY_DEFECT:
            return "the last engine was ended by a defect of its own with the supply on"
        if boot and boot == _boot():
            return "the last engine was killed with the supply on, or could not make the board safe"
        return "the machine lost its power, or was reset, with the supply on"

    def _sync_folder(self) -> None:
        folder = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _read(path: Path) -> bytes:
    """What may be a note; of a pipe nothing, without waiting for it. Raises: OSError."""
    fd = os.open(path, os.O_RDONLY | os.O_NONBLOCK)
    try:
        return os.read(fd, _MOST_BYTES)
    finally:
        os.close(fd)


def _said(content: bytes) -> tuple[object, object]:
    """The boot, and how the engine ended; "" for what it does not say."""
    try:
        found = json.loads(content)
        return found["boot"], found.get("ended", "")
    except (ValueError, TypeError, KeyError, RecursionError):
        return "", ""


def _boot() -> str:
    """Which of this machine's starts this is; "" where the kernel does not say."""
    try:
        return _BOOT.read_text(encoding="ascii").strip()
    except OSError:
        return ""
