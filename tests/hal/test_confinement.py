"""What a process gives up: the filter as the kernel would run it, and memory closed to others."""

from __future__ import annotations

import re
import struct
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from etd_hal.confinement import filter_for
from etd_hal.errors import NotConfined
from intruder import DONE, NOWHERE, rightless, tried

KILLED, ALLOWED = 0x8000_0000, 0x7FFF_0000
#: `AUDIT_ARCH_...` of `linux/audit.h`.
KINDS = {"x86_64": 0xC000_003E, "aarch64": 0xC000_00B7}
OTHER_KINDS = {"i386": 0x4000_0003, "arm": 0x4000_0028, "aarch64, big-endian": 0x8000_00B7}
HEADERS = {
    "x86_64": Path("/usr/include/x86_64-linux-gnu/asm/unistd_64.h"),
    "aarch64": Path("/usr/include/asm-generic/unistd.h"),
}
#: Whatever their arguments.
ALWAYS = {"brk", "munmap", "mremap", "exit_group", "madvise", "clock_gettime", "getrandom"}
ANSWER = 7
PROT_READ_WRITE, PROT_EXEC = 3, 4
#: Bit of the numbers of x86-64's other kind of calls.
X32 = 0x4000_0000


def answer(program: bytes, number: int, kind: int, *arguments: int) -> int:
    """What the kernel's machine for these filters would say; of its operations, those here."""
    given = [*arguments, 0, 0, 0, 0, 0, 0][:6]
    call = struct.pack("<IIQ6Q", number, kind, 0x7F00_0000_0000, *given)
    steps = list(struct.iter_unpack("=HBBI", program))
    assert len(steps) < 64
    held = at = 0
    while True:
        operation, if_so, if_not, value = steps[at]
        at += 1
        if operation == 0x20:
            (held,) = struct.unpack_from("<I", call, value)
        elif operation == 0x06:
            return int(value)
        else:
            holds = held == value if operation == 0x15 else bool(held & value)
            assert operation in (0x15, 0x45)
            at += if_so if holds else if_not


def numbers(machine: str) -> dict[str, int]:
    """As the kernel's own header has them; that for all newer machines calls some by two names."""
    if not HEADERS[machine].exists():
        pytest.skip("the kernel's headers are not installed here (linux-libc-dev)")
    text = HEADERS[machine].read_text()
    return {
        name: int(number)
        for name, number in re.findall(r"^#define __NR(?:3264)?_(\w+) (\d+)$", text, re.M)
    }


@pytest.mark.parametrize("machine", KINDS)
def test_of_all_calls_by_their_number_these_few_are_left(machine: str) -> None:
    program, of = filter_for(machine, ANSWER), numbers(machine)
    assert len(of) > 250
    left = {
        name for name, number in of.items() if answer(program, number, KINDS[machine]) == ALLOWED
    }
    # With arguments of zero: a file descriptor of zero, and memory that cannot be run.
    assert left == ALWAYS | {"mmap"}
    all_left = [
        number for number in range(2_048) if answer(program, number, KINDS[machine]) == ALLOWED
    ]
    assert all_left == sorted({of[name] for name in left})


@pytest.mark.parametrize("machine", KINDS)
def test_only_the_answer_is_written_to_and_no_memory_can_be_run(machine: str) -> None:
    program, of, kind = filter_for(machine, ANSWER), numbers(machine), KINDS[machine]
    for descriptor in (0, 1, 2, ANSWER - 1, ANSWER + 1, 0xFFFF_FFFF):
        assert answer(program, of["write"], kind, descriptor) == KILLED
    assert answer(program, of["write"], kind, ANSWER) == ALLOWED
    assert answer(program, of["mmap"], kind, 0, 4_096, PROT_READ_WRITE) == ALLOWED
    for wanted in (PROT_EXEC, PROT_READ_WRITE | PROT_EXEC):
        assert answer(program, of["mmap"], kind, 0, 4_096, wanted) == KILLED


@pytest.mark.parametrize("machine", KINDS)
def test_the_numbers_of_another_kind_of_machine_are_not_taken_for_its_own(machine: str) -> None:
    program = filter_for(machine, ANSWER)
    for kind in {*OTHER_KINDS.values(), *KINDS.values()} - {KINDS[machine]}:
        assert {answer(program, number, kind, ANSWER) for number in range(512)} == {KILLED}
    others = range(X32, X32 + 1_024)
    assert {answer(program, number, KINDS[machine], ANSWER) for number in others} == {KILLED}


@pytest.mark.parametrize("machine", ["armv7l", "i686", "aarch64_be", "riscv64"])
def test_a_machine_whose_calls_are_not_known_is_told_what_to_do(machine: str) -> None:
    with pytest.raises(NotConfined, match=f"none is known for {machine}.*64-bit system") as told:
        filter_for(machine, ANSWER)
    assert told.value.what == "a filter of system calls"


# --- memory ---------------------------------------------------------------------------------------

WAITS = "import sys; print(flush=True); sys.stdin.read()"
CLOSES = f"sys.path[:] = {sys.path!r}; from etd_hal.confinement import close_memory; close_memory()"


@contextmanager
def waiting(first: str = "") -> Iterator[int]:
    command = rightless(sys.executable, "-c", f"import sys; {first}\n{WAITS}")
    with subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"\n"
        yield process.pid


def test_a_process_of_the_same_user_looks_into_one_that_is_open() -> None:
    """Else the test after this one shows nothing."""
    with waiting() as pid:
        found = tried(pid)
    scope = Path("/proc/sys/kernel/yama/ptrace_scope")
    if scope.exists() and scope.read_text().strip() != "0":
        found = {name: said for name, said in found.items() if name.startswith("wh")}
    assert set(found.values()) <= {DONE, NOWHERE}
    assert found["what it has open"] == DONE


def test_and_into_one_that_has_closed_its_memory_it_does_not() -> None:
    with waiting(CLOSES) as pid:
        found = tried(pid)
    assert len(found) == 7
    assert set(found.values()) <= {"EPERM", "EACCES"}
