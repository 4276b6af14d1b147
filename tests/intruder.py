"""What a process of the same user tries with another: to look into it, to write it, to trace it.

Owns: the attempts, and how the kernel answered each. Must not know: what is in the other process.

    python intruder.py PID

Alone, as a program of its own: what it holds of the other ends with it.
"""

from __future__ import annotations

import ctypes
import errno
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

_PTRACE_SEIZE = 0x4206
_PIDFD_GETFD = 438  # on every machine
DONE = "done"
#: The kernel takes the address only where it may be written: nobody has one there.
NOWHERE = errno.errorcode[errno.EFAULT]
#: Without the rights of root, and root's number all the same: as a service's user has none.
_RIGHTLESS = ("setpriv", "--bounding-set=-all", "--inh-caps=-all")


def rightless(*command: str) -> list[str]:
    """The command, without rights over other processes of its user."""
    return [*(() if os.geteuid() else _RIGHTLESS), *command]


def tried(pid: int) -> dict[str, str]:
    """By attempt: `DONE`, or the kernel's error."""
    program = rightless(sys.executable, "-I", "-S", __file__, str(pid))
    ran = subprocess.run(program, capture_output=True, text=True, check=True, timeout=120)
    answers: dict[str, str] = json.loads(ran.stdout)
    return answers


def _attempts(pid: int) -> dict[str, Callable[[], object]]:
    library = ctypes.CDLL(None, use_errno=True)
    buffer = ctypes.create_string_buffer(1)
    here = (ctypes.c_size_t * 2)(ctypes.addressof(buffer), 1)
    there = (ctypes.c_size_t * 2)(0, 1)

    def called(name: str, *arguments: object) -> None:
        if library[name](*arguments) < 0:
            raise OSError(ctypes.get_errno(), name)

    def moved(name: str) -> None:
        called(name, pid, here, ctypes.c_ulong(1), there, ctypes.c_ulong(1), ctypes.c_ulong(0))

    folder = Path(f"/proc/{pid}")
    return {
        "what it has open": lambda: os.readlink(folder / "fd" / "0"),
        "where its memory is": lambda: (folder / "maps").read_text(),
        "its memory as a file": lambda: (folder / "mem").open("r+b").close(),
        "reading its memory": lambda: moved("process_vm_readv"),
        "writing its memory": lambda: moved("process_vm_writev"),
        "taking over what it has open": lambda: called(
            "syscall", _PIDFD_GETFD, os.pidfd_open(pid), 0, 0
        ),
        "tracing it": lambda: called("ptrace", ctypes.c_long(_PTRACE_SEIZE), pid, None, None),
    }


def _answer(attempt: Callable[[], object]) -> str:
    try:
        attempt()
    except OSError as error:
        return errno.errorcode[error.errno or 0]
    return DONE


if __name__ == "__main__":
    attempts = _attempts(int(sys.argv[1]))
    print(json.dumps({name: _answer(attempt) for name, attempt in attempts.items()}))
