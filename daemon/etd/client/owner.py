"""Whose a blocking display is: of one thread of one process.

Owns: noticing another. Must not know: what is asked.

ZeroMQ's sockets belong to a thread, and a child made by `fork` has copies of them that work for
neither: replies go astray, and requests block for ever.
"""

from __future__ import annotations

import os
import threading

from etd.protocol.errors import WrongThread


class Owner:
    """The thread that makes it."""

    def __init__(self) -> None:
        self._process = os.getpid()
        self._thread = threading.get_ident()

    @property
    def has_forked(self) -> bool:
        """Whether this is a child of the process that made it."""
        return os.getpid() != self._process

    def check(self) -> None:
        """Raises: WrongThread."""
        if self.has_forked:
            raise WrongThread("the process that made it has forked: make one in each process")
        if threading.get_ident() != self._thread:
            raise WrongThread(
                "another thread made it: make one in each thread (`begin` and `kept` go on beside"
                " the program, and `stop` may be called from anywhere)"
            )
