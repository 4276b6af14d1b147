"""Boots the emulated Pi, runs one command on it, and brings back what it said and its status.

    .venv/bin/python tests/kernel/pi_machine.py [--timeout SECONDS] [--keep-outputs] COMMAND ...

Owns: the emulator's command line, the time limit, the machine's end.
Must not know: what the command does.

A machine that does not start, or ends without a status, is a failure with its console.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import build_pi
from build_pi import Pi
from pieces import BUILD, RigFailure

#: A run takes half a minute on a machine that has nothing else to do.
TIMEOUT_S = 600.0
#: So much of the console is shown when something went wrong.
_CONSOLE_TAIL = 4_000
_STATUS = re.compile(r"^rig: status (\d+)\s*\Z", re.MULTILINE)
_ROOT = "/etd"
#: Where the kernels of Raspberry Pi OS leave lines that a program lets go of; Debian's does not.
_KEEP_OUTPUTS = "pinctrl_bcm2835.persist_gpio_outputs=y"


def command_line(pi: Pi, initrd: Path, out: Path, arguments: str) -> list[str]:
    """The emulator, run by the loader that it came with. It finds no other library than its own.

    The first serial port is the output, the second the console.
    """
    libraries = [pi.emulator / place / "x86_64-linux-gnu" for place in ("lib", "usr/lib")]
    return [
        *(str(libraries[0] / "ld-linux-x86-64.so.2"), "--library-path"),
        *(":".join(map(str, libraries)), str(pi.emulator / "usr/bin/qemu-system-aarch64")),
        *("-L", str(pi.emulator / "usr/share/qemu")),
        *("-M", "raspi3b", "-display", "none", "-no-reboot", "-monitor", "none"),
        *("-serial", f"file:{out / 'output'}", "-serial", f"file:{out / 'console'}"),
        *("-kernel", str(pi.kernel), "-dtb", str(pi.device_tree), "-initrd", str(initrd)),
        *("-append", f"console=ttyS1 quiet panic=-1 {arguments}"),
        *("-device", "tmp105,bus=i2c-bus.1,address=0x48"),
    ]


def command_file(command: list[str]) -> str:
    """What the Pi runs: the command, in the tree, with the tree's packages."""
    folders = [f"{_ROOT}/{part}" for part in ("daemon", "hal", "tests", "tests/kernel")]
    return (
        f"cd {_ROOT}\n"
        f"export PYTHONPATH={':'.join([*folders, '/site'])}\n"
        "export HOME=/run PATH=/usr/bin:/bin LC_ALL=C.UTF-8\n"
        f"exec {shlex.join(command)}\n"
    )


@dataclass(frozen=True)
class Ended:
    """A command's exit status, and all that it said."""

    status: int
    said: str


def boot(command: list[str], timeout_s: float, *, keeps_outputs: bool = False) -> Ended:
    """Run `command` on the Pi and print what it said.

    Raises: RigFailure (does not start, takes too long, ends without a status).
    """
    pi = build_pi.build()
    out = BUILD / "pi" / "out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    initrd = out / "initrd.img"
    _join(initrd, pi.initrd, build_pi.tree_files(out, command_file(command)))
    ended = _run_machine(
        command_line(pi, initrd, out, _KEEP_OUTPUTS if keeps_outputs else ""), out, timeout_s
    )
    output = _text(out / "output")
    found = _STATUS.search(output)
    said = output[: found.start()] if found else output
    sys.stdout.write(said)
    sys.stdout.flush()
    if not ended:
        raise RigFailure(f"the Pi was not done in {timeout_s} s\n{_console(out)}")
    if found is None:
        raise RigFailure(f"the Pi ended without a status\n{_console(out)}")
    return Ended(int(found.group(1)), said)


def _join(into: Path, *parts: Path) -> None:
    with into.open("wb") as joined:
        for part in parts:
            with part.open("rb") as source:
                shutil.copyfileobj(source, joined)


def _run_machine(line: list[str], out: Path, timeout_s: float) -> bool:
    """Run it to its end; False if it had to be ended."""
    with (out / "said").open("wb") as said:
        machine = subprocess.Popen(
            line, stdin=subprocess.DEVNULL, stdout=said, stderr=said, start_new_session=True
        )
        try:
            machine.wait(timeout_s)
        except subprocess.TimeoutExpired:
            os.killpg(machine.pid, 9)
            machine.wait()
            return False
    return True


def _text(path: Path) -> str:
    return path.read_text(errors="replace").replace("\r\n", "\n") if path.exists() else ""


def _console(out: Path) -> str:
    told = _text(out / "said") + _text(out / "console")
    return f"its console:\n{told[-_CONSOLE_TAIL:]}" if told else "and said nothing"


def main() -> int:
    parser = argparse.ArgumentParser(description="run a command on the emulated Pi")
    parser.add_argument("--timeout", type=float, default=TIMEOUT_S, help="seconds")
    parser.add_argument(
        "--keep-outputs", action="store_true", help="released lines keep their levels"
    )
    parser.add_argument("command", nargs=argparse.REMAINDER)
    chosen = parser.parse_args()
    try:
        return boot(chosen.command, chosen.timeout, keeps_outputs=chosen.keep_outputs).status
    except RigFailure as failure:
        print(f"the kernel rig failed: {failure}", file=sys.stderr)
        return 3


if __name__ == "__main__":
    sys.exit(main())
