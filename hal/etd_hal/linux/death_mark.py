"""A word in shared memory that the kernel itself marks when the thread that holds it dies.

Owns: a robust mutex of the C library, taken once and never given back, and how its mark is read.
Must not know: who holds it, what follows.

When a process is killed, the kernel first takes its memory apart, for milliseconds where much of it
is locked, then closes its files, and only then tells those who wait for its end (a socket, a
pidfd). It looks through the dying thread's robust mutexes before all of that, and sets
FUTEX_OWNER_DIED in each that it holds. A process that reads the word every half a millisecond knows
of the death that much earlier.

A mark that never comes, where the C library is another one, delays what the pidfd tells and no
more.
"""

from __future__ import annotations

import ctypes
import struct

from etd_hal.shared_memory import SharedMemory

#: More than a pthread_mutex_t and its attributes are anywhere; the mutex begins with its word.
_MUTEX_BYTES = 256
_ATTRIBUTE_BYTES = 64
_PTHREAD_PROCESS_SHARED = 1
_PTHREAD_MUTEX_ROBUST = 1
_OWNER_DIED = 0x4000_0000
_WORD = struct.Struct("=I")

#: What was taken is never unmapped: the thread's list of robust mutexes leads through it.
_taken: list[object] = []


def take() -> int:
    """Take a new mark for the calling thread, until it ends. Returns the file descriptor of its
    memory, to be inherited.
    """
    memory = SharedMemory(_MUTEX_BYTES)
    mutex = (ctypes.c_char * _MUTEX_BYTES).from_buffer(memory.bytes)
    attributes = ctypes.create_string_buffer(_ATTRIBUTE_BYTES)
    library = ctypes.CDLL(None)
    library.pthread_mutexattr_init(attributes)
    library.pthread_mutexattr_setpshared(attributes, _PTHREAD_PROCESS_SHARED)
    library.pthread_mutexattr_setrobust(attributes, _PTHREAD_MUTEX_ROBUST)
    library.pthread_mutex_init(mutex, attributes)
    # Each of these returns an error number. Where one fails the mark never comes: see the module.
    library.pthread_mutex_lock(mutex)
    _taken.append((memory, mutex))
    return memory.fd


class DeathMark:
    """The side that looks."""

    def __init__(self, fd: int) -> None:
        """Takes `fd` over. Raises: OSError."""
        self._bytes = SharedMemory(_MUTEX_BYTES, fd).bytes

    @property
    def is_set(self) -> bool:
        (word,) = _WORD.unpack_from(self._bytes)
        return bool(word & _OWNER_DIED)
