"""A note on the disk that the supply may be on: what is left of an engine that did not end well.

Owns: the file, that it is on the disk before it counts, and what one that was left says. Must not
know: who keeps it, and when.

The file is written before the supply goes on, and removed when the board has been made safe. One
that is there when an engine starts was left by a process that was killed, or by a machine that lost
its power.
"""

from __future__ import annotations

import json
import os
from pathlib import Path

_BOOT = Path("/proc/sys/kernel/random/boot_id")


class SupplyNote:
    """See the module."""

    def __init__(self, path: Path) -> None:
        self.path = path

    def keep(self) -> None:
        """It is there, or as it was before, whenever the power goes. Raises: OSError."""
        new = self.path.with_name(f".{self.path.name}.new")
        content = json.dumps({"boot": _boot()}).encode() + b"\n"
        fd = os.open(new, os.O_WRONLY | os.O_CREAT | os.O_TRUNC | os.O_NOFOLLOW, 0o600)
        try:
            os.write(fd, content)
            os.fsync(fd)
        finally:
            os.close(fd)
        os.replace(new, self.path)
        self._sync_folder()

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
            content = self.path.read_bytes()
        except (FileNotFoundError, NotADirectoryError):
            return None
        except OSError as error:
            if not os.path.lexists(self.path):
                return None
            return f"a note was left that cannot be read ({error.strerror})"
        try:
            boot = json.loads(content)["boot"]
        except (ValueError, TypeError, KeyError):
            boot = ""
        if boot and boot == _boot():
            return "the last engine was killed with the supply on, or could not make the board safe"
        return "the machine lost its power, or was reset, with the supply on"

    def _sync_folder(self) -> None:
        folder = os.open(self.path.parent, os.O_RDONLY | os.O_DIRECTORY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)


def _boot() -> str:
    """Which of this machine's starts this is; "" where the kernel does not say."""
    try:
        return _BOOT.read_text(encoding="ascii").strip()
    except OSError:
        return ""
