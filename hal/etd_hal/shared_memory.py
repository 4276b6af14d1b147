"""Memory that several processes see: 64-bit words and bytes, without a lock.

Owns: how it is made, passed on by its file descriptor, and released. Must not know: what is in it.

A word is read and written whole: it is aligned, and CPython's memoryview copies it as one 64-bit
load or store. Words are ordered among themselves by nothing here: each user says why that is
enough.
"""

from __future__ import annotations

import mmap
import os

WORD_BYTES = 8


class SharedMemory:
    """Of so many bytes, all zero; or, with `fd`, the memory that another process has made."""

    __slots__ = ("_fd", "_mapped", "bytes", "words")

    def __init__(self, size: int, fd: int | None = None) -> None:
        """Takes `fd` over. Raises: OSError."""
        self._fd = os.memfd_create("etd") if fd is None else fd
        size = -(-size // WORD_BYTES) * WORD_BYTES
        if fd is None:
            os.ftruncate(self._fd, size)
        self._mapped = mmap.mmap(self._fd, size)
        self.bytes = memoryview(self._mapped)
        self.words = self.bytes.cast("q")

    @property
    def fd(self) -> int:
        """To be inherited by a process that shares this memory."""
        return self._fd

    def __del__(self) -> None:
        # The mapping goes with its last view.
        fd = getattr(self, "_fd", -1)
        if fd >= 0:
            os.close(fd)
