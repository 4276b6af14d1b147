"""The process that parses calibrations, taken over: each thing that it tries ends it.

Owns: what it tries, in the place of the parser, behind everything that the process itself has done
before; that nothing of it has happened; and that parsing needs none of it. Must not know: which
calls are let through (`tests/hal/test_confinement.py`).
"""

from __future__ import annotations

import ctypes
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from etd.client import clock
from etd.files.calibration import load_calibration
from etd.files.calibration_process import CalibrationProcess
from etd.files.resources import find
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.peer import Peer

pytestmark = pytest.mark.slow

SHIPPED = find("calibrations", "fake-fingertip").parent
#: It could have written none of what is shipped, where root runs this; else all is one user's.
GATEWAY = Peer(65_531, (65_531, 65_532)) if os.geteuid() == 0 else Peer(os.geteuid(), ())
WITHIN_S = 60.0

#: What a parser that was taken over does, as a statement. It is of the engine's user: `engine` is
#: the number of another process of that user, and `address` is one in that process's memory.
TRIES = {
    "write into the engine's memory": "moved('process_vm_writev')",
    "read the engine's memory": "moved('process_vm_readv')",
    "trace the engine": "called('ptrace', 16, engine, None, None)",
    "stop the engine": "os.kill(engine, signal.SIGSTOP)",
    "look whether the engine is there": "os.kill(engine, 0)",
    "take a hold of the engine": "os.pidfd_open(engine)",
    "bound the engine": "resource.prlimit(engine, resource.RLIMIT_CPU, (0, 0))",
    "move the engine to another core": "os.sched_setaffinity(engine, {0})",
    "open a device": "os.open('/dev/null', os.O_RDWR)",
    "open its own file again": "open(path)",
    "write its own file": "open(path, 'r+b')",
    "list a folder": "os.listdir('/')",
    "make a socket": "socket.socket(socket.AF_UNIX)",
    "make a pipe": "os.pipe()",
    "write elsewhere": "os.write(answer + 1, b'junk')",
    "read from its pipe": "os.read(answer, 1)",
    "copy its pipe": "os.dup(answer)",
    "control its pipe": "fcntl.ioctl(answer, 0)",
    "begin a process": "os.fork()",
    "begin a thread": "_thread.start_new_thread(print, ())",
    "become another program": "os.execv('/bin/true', ['true'])",
    "have memory that can be run": "mmap.mmap(-1, 4096, prot=mmap.PROT_READ | mmap.PROT_EXEC)",
    "make its memory one that can be run": "called('mprotect', 0x10000, 4096, 5)",
    "be rid of the filter": "called('prctl', 22, 0, 0, 0, 0)",
    "outlive its time": "signal.alarm(0)",
    "catch a signal": "signal.signal(signal.SIGALRM, print)",
}
TAKEN_OVER = """
import _thread, ctypes, fcntl, mmap, os, resource, signal, socket
from etd.files import calibration_reading as reading
library = ctypes.CDLL(None, use_errno=True)
engine, address = {engine}, {address}
junk = ctypes.create_string_buffer(b"junk")
here = (ctypes.c_size_t * 2)(ctypes.addressof(junk), 4)
there = (ctypes.c_size_t * 2)(address, 4)
one, none = ctypes.c_ulong(1), ctypes.c_ulong(0)
def called(name, *arguments):
    return library[name](*arguments)
def moved(name):
    return called(name, engine, here, one, there, one, none)
def main(asked, answer, core):
    def parse(path, data):
        try:
            {statement}
        except OSError as error:
            raise reading.FileError("", "", "refused: " + error.strerror, "")
        raise reading.FileError("", "", "it goes on", "")
    reading.calibration_of_bytes = parse
    reading.main(asked, answer, core)
"""


class Place:
    """Where a module is put that stands in the place of the one that reads."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def read(self, text: str | None, *names: str) -> tuple[Calibration, ...]:
        """As the engine does, by this text; None: by the product's own. Raises: Refused."""
        module = "etd.files.calibration_reading"
        if text is not None:
            module = "in_its_place"
            (self._folder / f"{module}.py").write_text(text)
        reader = CalibrationProcess(self._folder / "nowhere", SHIPPED, None, module)
        try:
            reader.begin(names or ("fake-fingertip",), GATEWAY)
            until_ns = clock.now_ns() + int(WITHIN_S * 1e9)
            while (found := reader.result()) is None:
                assert clock.now_ns() < until_ns
                clock.sleep_s(0.001)
            return found
        finally:
            reader.end()

    def refused(self, text: str) -> str:
        with pytest.raises(Refused) as told:
            self.read(text)
        assert told.value.code == "bad_calibration"
        return told.value.reason


@pytest.fixture
def place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Place:
    monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
    return Place(tmp_path)


@pytest.fixture
def victim() -> Iterator[int]:
    """In the engine's place, where it would be stopped: another process of its user."""
    with subprocess.Popen(["sleep", "600"]) as process:
        yield process.pid
        process.kill()


def is_stopped(pid: int) -> bool:
    return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in "Tt"


@pytest.mark.parametrize("what", TRIES)
def test_whatever_it_tries_the_kernel_ends_it(place: Place, victim: int, what: str) -> None:
    text = TAKEN_OVER.format(engine=victim, address=0, statement=TRIES[what])
    assert "it asked for a call that parsing does not need" in place.refused(text)
    assert not is_stopped(victim)


def test_what_it_would_write_into_the_engines_memory_is_not_there(place: Place) -> None:
    """Into this very process, which begins it as the engine does."""
    maxima = ctypes.create_string_buffer(b"most")
    address = ctypes.addressof(maxima)
    statement = TRIES["write into the engine's memory"]
    text = TAKEN_OVER.format(engine=os.getpid(), address=address, statement=statement)
    place.refused(text)
    assert maxima.value == b"most"


def test_nothing_but_its_pipe_is_open_when_it_parses_and_it_has_one_thread(place: Place) -> None:
    """As it is confined: a thread besides would not be."""
    text = """
import os
from etd.files import calibration_reading as reading
os.open("/dev/zero", os.O_RDONLY)
def told(answer):
    open_ones = {f"/proc/self/fd/{number}" for number in os.listdir("/proc/self/fd")}
    kinds = [os.readlink(one).split(":")[0] for one in open_ones if os.path.lexists(one)]
    raise reading.NotConfined(f"{kinds}", f"{len(os.listdir('/proc/self/task'))} thread")
reading.confine = told
main = reading.main
"""
    assert "['pipe'] was not granted (1 thread)" in place.refused(text)


def test_where_the_kernel_does_not_confine_it_nothing_is_parsed(place: Place) -> None:
    """As in a container that forbids it: each prctl is refused, by a filter before ours."""
    text = """
import ctypes, os, struct
from etd.files import calibration_reading as reading
def main(asked, answer, core):
    number = {"x86_64": 157, "aarch64": 167}[os.uname().machine]
    steps = struct.pack(
        "=HBBI HBBI HBBI HBBI".replace(" ", ""),
        0x20, 0, 0, 0,  0x15, 0, 1, number,  0x06, 0, 0, 0x00050016,  0x06, 0, 0, 0x7FFF0000,
    )
    kept = ctypes.create_string_buffer(steps, len(steps))
    whole = struct.pack("@HP", 4, ctypes.addressof(kept))
    library = ctypes.CDLL(None)
    assert library.prctl(38, 1, 0, 0, 0) == 0
    assert library.prctl(22, 2, whole, 0, 0) == 0
    def parse(path, data):
        raise reading.FileError("", "", "it is parsed all the same", "")
    reading.calibration_of_bytes = parse
    reading.main(asked, answer, core)
"""
    reason = place.refused(text)
    assert "could not be confined: a filter of system calls was not granted (Invalid" in reason
    assert "CONFIG_SECCOMP_FILTER" in reason


# --- and what parsing needs -----------------------------------------------------------------------


@pytest.mark.parametrize("name", sorted(path.stem for path in SHIPPED.glob("*.toml")))
def test_each_calibration_that_is_shipped_is_read(place: Place, name: str) -> None:
    assert place.read(None, name) == (load_calibration(SHIPPED / f"{name}.toml"),)


#: Every value of a file in another's place, and a file cut off: each way to a refusal, one after
#: another in one process that is confined, and large things that come and go between them.
ALL_WAYS = """
import msgspec, os, random
from pathlib import Path
from etd.files import calibration_reading as reading
from etd_hal.tomlfile import convert
WORDS = ("true", "-1", "1e400", "nan", "'x'", '"\\\\u00e9"', "[]", "{}", "2026-13-01", "07:00:00",
    "2026-01-01T00:00:00+01:00", "9" * 5000, "0x" + "9" * 5000, "[" * 300, "'''", "\\x00", "")
def main(asked, answer, core):
    parse, seen = reading.calibration_of_bytes, set()
    def all_ways(path, data):
        lines = data.decode().splitlines()
        texts = [data, data[: len(data) // 2], b"\\xff", b"x = " + b"[" * 5_000]
        texts += [b"[a]\\n" * 3_000, b"x = [" + b"[],\\n" * 100_000 + b"]", b"a" * 500_000]
        for at, line in enumerate(lines):
            key, equals, _ = line.partition(" = ")
            if not equals or at >= 25:
                continue
            changed = [f"{key} = {word}" for word in WORDS]
            for each in (*changed, f"{key}x = 1", f"{line}\\n{line}"):
                texts.append("\\n".join([*lines[:at], each, *lines[at + 1 :]]).encode())
        for text in texts:
            try:
                parse(path, text)
            except reading.FileError as error:
                seen.add(str(error))
        raise reading.FileError("", "", f"{len(texts)} texts, {len(seen)} sentences", "")
    reading.calibration_of_bytes = all_ways
    reading.main(asked, answer, core)
"""


def test_no_text_makes_the_parser_need_more(place: Place) -> None:
    texts, sentences = map(
        int, [word for word in place.refused(ALL_WAYS).split() if word.isdigit()]
    )
    assert texts > 100
    assert sentences > 50
