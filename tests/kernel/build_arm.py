"""What runs ARM's Python on this machine, without a kernel of its own, and counts its instructions;
and the code that runs for each pulse, compiled for 64-bit ARM.

    .venv/bin/python tests/kernel/build_arm.py FOLDER     (`make compiled-arm`)

Owns: fetching QEMU's user emulation and the headers of ARM's Python, compiling the counter and
checking it, how `hatch_build.py` is told to compile for another processor.
Must not know: what runs.

Interpreter and wheels are those of the emulated Pi.
"""

from __future__ import annotations

import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import build_pi
from build_pi import PYTHON
from debian_packages import make_index
from pieces import (
    HERE,
    TREE,
    RigFailure,
    fingerprint,
    is_made,
    making,
    need,
    only_builder,
    piece,
    run,
)

#: Where `make compiled-arm` puts it.
COMPILED = TREE / "build" / "compiled-arm"
_CROSS = "aarch64-linux-gnu-gcc"
_TOOLS = {_CROSS: "gcc-aarch64-linux-gnu", "gcc": "gcc", "apt-get": "apt", "dpkg-deb": "dpkg"}
#: Not from Debian's backports: a later one is linked statically, and loads no counter.
_EMULATOR = ("qemu-user",)
_HEADERS = (f"libpython{PYTHON}-dev:arm64",)
#: As a Pi 4's. A Pi 3's and a Zero 2 W's has the same instructions.
_PROCESSOR = "cortex-a72"
_SOURCES = tuple(HERE / name for name in ("counter.c", "counted_loop.c"))
_RUNS_COMPILED = "from etd_hal import compiled; assert compiled.runs() == 'compiled'"
_WARNINGS = ("-O2", "-Wall", "-Werror")
_COUNTED = re.compile(r"^instructions: (\d+)$", re.MULTILINE)
#: Of the loop: what one argument more takes.
_A_MILLION_ROUNDS = 2_000_000
#: So many more may be counted, for passing one argument.
_FOR_AN_ARGUMENT = 2_000


@dataclass(frozen=True)
class Arm:
    """What a run needs, built."""

    tools: Path
    runtime: Path
    site: Path

    def python(self, arguments: Sequence[str], log: Path | None = None) -> list[str]:
        """The command line of ARM's Python. With a log its instructions are counted into it."""
        interpreter = str(self.runtime / f"usr/bin/python{PYTHON}")
        return [*_emulated(self.tools, log), "-L", str(self.runtime), interpreter, *arguments]

    def environment(self, path: Sequence[Path]) -> dict[str, str]:
        """What is other in it: these folders of modules, and ARM's packages."""
        return {"PYTHONPATH": ":".join(map(str, [*path, self.site]))}


def build() -> Arm:
    """All of it. Raises: RigFailure."""
    need(_TOOLS)
    with only_builder():
        fetched = build_pi.packages()
        return Arm(tools(), fetched / "runtime", fetched / "site")


def tools() -> Path:
    """The emulator, the headers and the counter, which counts right."""
    made_from = [Path(__file__), HERE / "debian_packages.py", *_SOURCES]
    folder = piece("arm-tools", fingerprint(made_from))
    if is_made(folder):
        return folder
    with making(folder):
        index = make_index(folder / "index", ("amd64", "arm64"))
        for name, packages, built_for in (
            ("emulator", _EMULATOR, "amd64"),
            ("headers", _HEADERS, "arm64"),
        ):
            needed = index.closure(packages, built_for, backports=False)
            index.unpack(needed, folder / name)
        shutil.rmtree(folder / "index")
        counter, loop = _SOURCES
        run(
            *("gcc", *_WARNINGS, "-shared", "-fPIC", "-fvisibility=hidden"),
            *("-o", folder / "counter.so", counter),
        )
        run(
            *(_CROSS, f"--sysroot={folder / 'headers'}", *_WARNINGS, "-static"),
            *("-o", folder / "counted_loop", loop),
        )
        _check_counter(folder)
    return folder


def _check_counter(folder: Path) -> None:
    """Ten million rounds more are twenty million instructions more. Raises: RigFailure."""
    with tempfile.TemporaryDirectory() as kept:
        log = Path(kept, "log")
        found: list[int] = []
        for arguments in ((), ("more",) * 10):
            run(*_emulated(folder, log), folder / "counted_loop", *arguments)
            found.append(counted(log))
    more = found[1] - found[0] - 10 * _A_MILLION_ROUNDS
    if not 0 <= more <= 10 * _FOR_AN_ARGUMENT:
        raise RigFailure(f"the counter of instructions counts wrongly: {found} for a known loop")


def counted(log: Path) -> int:
    """The instructions of the run that wrote this log. Raises: RigFailure."""
    found = _COUNTED.search(log.read_text())
    if found is None:
        raise RigFailure(f"the emulator did not tell how many instructions ran: {log}")
    return int(found.group(1))


def _emulated(folder: Path, log: Path | None) -> list[str]:
    """The emulator, run by the loader that it came with: it finds no other library than its own."""
    emulator = folder / "emulator"
    libraries = [emulator / place / "x86_64-linux-gnu" for place in ("lib", "usr/lib")]
    counting = ("-plugin", str(folder / "counter.so"), "-d", "plugin", "-D", str(log))
    return [
        *(str(libraries[0] / "ld-linux-x86-64.so.2"), "--library-path"),
        *(":".join(map(str, libraries)), str(emulator / "usr/bin/qemu-aarch64")),
        *("-cpu", _PROCESSOR, *(counting if log else ())),
    ]


def compile_into(folder: Path) -> None:
    """What `make compiled` makes, for ARM's Python. Raises: RigFailure."""
    if sys.version_info[:2] != tuple(map(int, PYTHON.split("."))):
        raise RigFailure(
            f"mypyc writes for the Python that it runs on, and ARM's is {PYTHON}: "
            f"make clean, and then make PYTHON=python{PYTHON}"
        )
    arm = build()
    headers = arm.tools / "headers"
    compiler = f"{_CROSS} --sysroot={headers}"
    environment = {
        "CC": compiler,
        "LDSHARED": f"{compiler} -shared",
        # Before the folder of this machine's own.
        "CFLAGS": f"-I{headers}/usr/include/python{PYTHON}",
        "SETUPTOOLS_EXT_SUFFIX": f".cpython-{PYTHON.replace('.', '')}-aarch64-linux-gnu.so",
    }
    run(sys.executable, TREE / "hatch_build.py", folder, env=environment)
    # Modules that ARM's Python did not find would leave it to the sources beside them.
    run(*arm.python(["-c", _RUNS_COMPILED]), env=arm.environment([folder]))


if __name__ == "__main__":
    try:
        compile_into(Path(sys.argv[1]))
    except (RigFailure, subprocess.SubprocessError) as failure:
        sys.exit(f"not compiled for ARM: {failure}")
