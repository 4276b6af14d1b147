"""A word in shared memory that the kernel itself marks when the thread that holds it dies.

Owns: a robust mutex of the C library, taken once and never given back, and how its mark is read.
Must not know: who holds it, what follows.

When a process is killed, the kernel first takes its memory apart, for milliseconds where much of it
is locked, then closes its files, and only then tells those who wait for its end (a socket, a
pidfd). It looks through the dying thread's robust mutexes before all of that, and sets
FUTEX_OWNER_DIED in each that it holds. A process that reads the word every half a millisecond knows
of the death that much earlier.

A mark that was not taken, where the C library is another one, is told by who looks at it: the death
is then known by the pidfd alone, that much later.
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
_NOT_HELD = (
    "the mark of the engine's death is not held, so its death is known milliseconds later: the C"
    " library has no robust mutexes"
)
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
    # Each of these returns an error number; where one fails, the mark is not held.
    failed = (
        library.pthread_mutexattr_init(attributes)
        or library.pthread_mutexattr_setpshared(attributes, _PTHREAD_PROCESS_SHARED)
        or library.pthread_mutexattr_setrobust(attributes, _PTHREAD_MUTEX_ROBUST)
        or library.pthread_mutex_init(mutex, attributes)
    )
    if not failed:
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
        return bool(self._word() & _OWNER_DIED)

    @property
    def why_not_held(self) -> str | None:
        """A sentence, where it was not taken: it will never be set."""
        return None if self._word() else _NOT_HELD

    def _word(self) -> int:
        (word,) = _WORD.unpack_from(self._bytes)
        return int(word)
