"""What a process gives up for good: to be looked into by others of its user, and all calls of the
kernel but those that computing in memory needs.

Owns: the few calls that are left, and the filter by which the kernel ends a process at any other.
Must not know: who is confined, and why.

Kernels keep users apart, and not the processes of one user: one may stop another, write its memory
and open what it may open, whatever limits it has. So `confine` names what a process may still do,
and the kernel refuses the rest. The filter is a program of classic BPF: it sees the number of a
call and its arguments as numbers, never what they point to. It cannot be taken away again.

The kernel ends the process at any other call, and lets none fail: code that was taken over gets no
second attempt, and code that was not asks for none. The one who started it sees SIGSYS.
"""

from __future__ import annotations

import ctypes
import os
import struct
from collections.abc import Mapping
from typing import Final, NamedTuple

from etd_hal.errors import NotConfined

_PR_SET_DUMPABLE = 4
_PR_SET_SECCOMP = 22
_PR_SET_NO_NEW_PRIVS = 38
_SECCOMP_MODE_FILTER = 2

#: A `sock_filter`: the operation, how far to jump if it holds and if not, and a number.
_STEP = struct.Struct("=HBBI")
_LOAD, _IS, _HAS_BIT, _ANSWER = 0x20, 0x15, 0x45, 0x06
_END_THE_PROCESS, _ALLOW = 0x8000_0000, 0x7FFF_0000
#: In what the filter sees of a call: its number, the kind of machine whose number that is, and the
#: lower half of each argument.
_NUMBER_AT, _MACHINE_AT, _ARGUMENTS_AT, _ARGUMENT_BYTES = 0, 4, 16, 8
_PROT_EXEC = 4


class _Machine(NamedTuple):
    """A kind of machine, as the kernel numbers it (`linux/audit.h`), and the numbers of its calls.

    On x86-64 there are two kinds of calls besides, of 32 bits: one has another kind of machine, and
    the other has numbers that none here is equal to.
    """

    kind: int
    write: int
    mmap: int
    #: Each by its name, whatever its arguments. Parsing and its answer need the first four; the
    #: others are of allocators and collectors that are newer, and reach no other process.
    always: Mapping[str, int]


_MACHINES: Final = {
    "x86_64": _Machine(
        kind=0xC000_003E,
        write=1,
        mmap=9,
        always={
            "brk": 12,
            "munmap": 11,
            "mremap": 25,
            "exit_group": 231,
            "madvise": 28,
            "clock_gettime": 228,
            "getrandom": 318,
        },
    ),
    "aarch64": _Machine(
        kind=0xC000_00B7,
        write=64,
        mmap=222,
        always={
            "brk": 214,
            "munmap": 215,
            "mremap": 216,
            "exit_group": 94,
            "madvise": 233,
            "clock_gettime": 113,
            "getrandom": 278,
        },
    ),
}


def close_memory() -> None:
    """No other process of this user can read or write this one's memory from here on, trace it, or
    take over what it has opened; and it leaves no core dump. What it starts has to ask for itself.
    Raises: NotConfined.
    """
    _prctl("closing its memory to others of its user", _PR_SET_DUMPABLE, 0)


def confine(answer: int) -> None:
    """The calling thread, which must be the only one, can compute, write to the file descriptor
    `answer`, and end. At any other call the kernel ends its process, with SIGSYS. For good.

    Raises: NotConfined.
    """
    program = filter_for(os.uname().machine, answer)
    steps = ctypes.create_string_buffer(program, len(program))
    # A `sock_fprog`, padded as the compiler does.
    whole = struct.pack("@HP", len(program) // _STEP.size, ctypes.addressof(steps))
    what = "a filter of system calls"
    _prctl(what, _PR_SET_NO_NEW_PRIVS, 1)
    _prctl(what, _PR_SET_SECCOMP, _SECCOMP_MODE_FILTER, whole)


def filter_for(machine: str, answer: int) -> bytes:
    """The filter, as the kernel takes it. `machine`: as `uname -m` has it. Raises: NotConfined."""
    of = _MACHINES.get(machine)
    if of is None or struct.calcsize("P") != 8:
        bits = struct.calcsize("P") * 8
        raise NotConfined("a filter of system calls", f"none is known for {machine}, {bits} bits")
    steps = [_step(_LOAD, _MACHINE_AT), *_unless(of.kind, _END_THE_PROCESS), _step(_LOAD, 0)]
    for number in of.always.values():
        steps += [_step(_IS, number, 0, 1), _step(_ANSWER, _ALLOW)]
    steps += _where(of.write, [_step(_LOAD, _argument(0)), *_unless(answer, _END_THE_PROCESS)])
    # Memory that can be run: what was taken over would bring its own program.
    executable = _step(_HAS_BIT, _PROT_EXEC, 0, 1), _step(_ANSWER, _END_THE_PROCESS)
    steps += _where(of.mmap, [_step(_LOAD, _argument(2)), *executable])
    return b"".join((*steps, _step(_ANSWER, _END_THE_PROCESS)))


def _where(number: int, steps: list[bytes]) -> list[bytes]:
    """If it is this call: these steps, and allowed if they come to their end."""
    return [_step(_IS, number, 0, len(steps) + 1), *steps, _step(_ANSWER, _ALLOW)]


def _unless(value: int, answer: int) -> tuple[bytes, bytes]:
    return _step(_IS, value, 1, 0), _step(_ANSWER, answer)


def _step(operation: int, value: int, if_so: int = 0, if_not: int = 0) -> bytes:
    return _STEP.pack(operation, if_so, if_not, value)


def _argument(index: int) -> int:
    return _ARGUMENTS_AT + index * _ARGUMENT_BYTES


def _prctl(what: str, option: int, value: int, pointed_at: bytes | None = None) -> None:
    library = ctypes.CDLL(None, use_errno=True)
    asked = (option, ctypes.c_ulong(value), pointed_at, ctypes.c_ulong(0), ctypes.c_ulong(0))
    if library.prctl(*asked) != 0:
        raise NotConfined(what, os.strerror(ctypes.get_errno()))
