"""Memory that two processes see."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from etd_hal.shared_memory import SharedMemory

#: Written and read so often by two processes at once.
TIMES = 200_000
_WRITER = """
import sys
sys.path[:] = {path!r}
from etd_hal.shared_memory import SharedMemory
words = SharedMemory({size}, {fd}).words
for count in range({times}):
    words[1] = -1 if count % 2 else 0
words[2] = 1
"""


def test_it_begins_as_zeros_and_in_whole_words() -> None:
    memory = SharedMemory(13)
    assert memory.bytes.tobytes() == bytes(16)
    assert memory.words.tolist() == [0, 0]


def test_what_is_written_by_its_descriptor_is_the_same_memory() -> None:
    memory = SharedMemory(32)
    same = SharedMemory(32, os.dup(memory.fd))
    same.words[3] = -(1 << 63)
    same.bytes[0:4] = b"text"
    assert memory.words[3] == -(1 << 63)
    assert memory.bytes[0:4].tobytes() == b"text"


def test_its_descriptor_is_not_inherited_unless_it_is_named_and_goes_with_it() -> None:
    memory = SharedMemory(8)
    fd = memory.fd
    assert not os.get_inheritable(fd)
    del memory
    with pytest.raises(OSError, match="Bad file descriptor"):
        os.fstat(fd)


def test_a_word_that_another_process_writes_is_never_seen_half_written() -> None:
    memory = SharedMemory(32)
    program = _WRITER.format(path=sys.path, size=32, fd=memory.fd, times=TIMES)
    with subprocess.Popen([sys.executable, "-c", program], pass_fds=(memory.fd,)) as writer:
        words, seen = memory.words, set()
        while not words[2] and writer.poll() is None:
            seen |= {words[1] for _ in range(1_000)}
    assert writer.returncode == 0
    assert seen <= {0, -1}
