"""Boots a guest, runs one command in it, and brings back what it said and its status.

    .venv/bin/python tests/kernel/run.py [--timeout SECONDS] x86|uml|service|service-x86 COMMAND ...

Owns: the guests' command lines, the shared folder, the time limit, the guest's end.
Must not know: what the command does.

x86 is a stock Debian kernel on an emulated processor whose clock counts instructions: a message
takes what its instructions take, however busy this machine is. uml is User-Mode Linux with a
clock that only sleeping moves. service is x86 with systemd as its first process. A guest that does
not start, or ends without a status, is a failure with its console.
"""

from __future__ import annotations

import argparse
import os
import shlex
import shutil
import signal
import subprocess
import sys
from pathlib import Path
from threading import Timer
from typing import Literal, get_args

import build_uml
import build_x86
import service_layers
from build_x86 import spidev_package
from pieces import BUILD, CACHE, HERE, TREE, RigFailure

Guest = Literal["x86", "uml", "service", "service-x86"]
_TIMEOUT_S = 300
#: The file beside its output that says what a guest took of this machine's processors.
PROCESSOR_S = "processor-s"
#: 2 ns an instruction: about as fast as a Pi.
_CLOCK = "shift=1"
#: So much of the console is shown when something went wrong.
_CONSOLE_TAIL = 4_000


def x86(kernel: Path, initrd: Path, out: Path) -> list[str]:
    """The emulator's command line. The first serial port is the console, the second the output.

    One processor: the clock goes on while any of them computes.
    """
    share = "security_model=none"
    return [
        "qemu-system-x86_64",
        *("-M", "q35", "-accel", "tcg,thread=single,tb-size=512", "-icount", _CLOCK),
        *("-cpu", "max", "-smp", "1", "-m", "2048"),
        *("-nodefaults", "-no-user-config", "-display", "none", "-no-reboot", "-monitor", "none"),
        *("-serial", f"file:{out / 'console'}", "-serial", f"file:{out / 'output'}"),
        *("-kernel", str(kernel), "-initrd", str(initrd)),
        *("-append", "console=ttyS0 quiet panic=-1 mitigations=off tsc=reliable no_timer_check"),
        *("-fsdev", f"local,id=f0,path=/,{share},readonly=on,multidevs=remap"),
        *("-device", "virtio-9p-pci,fsdev=f0,mount_tag=hostroot"),
        *("-fsdev", f"local,id=f1,path={out},{share}"),
        *("-device", "virtio-9p-pci,fsdev=f1,mount_tag=out"),
    ]


def uml(linux: Path, module: Path, out: Path) -> list[str]:
    """The kernel's own command line."""
    return [
        *(str(linux), "mem=1024M", "rootfstype=hostfs", "rootflags=/", "ro", "quiet"),
        *(f"init={HERE / 'uml_init.sh'}", f"rig.out={out}", f"rig.module={module}"),
        *("con0=null,fd:1", "con=null", "panic=-1", "time-travel=inf-cpu"),
    ]


def uml_with_systemd(line: list[str], layers: list[Path]) -> list[str]:
    """The kernel's command line with systemd as the guest's first process, in these layers."""
    return [*line, f"rig.pieces={CACHE}", *service_layers.boot_words(layers)]


def x86_with_systemd(line: list[str], layers: list[Path]) -> list[str]:
    """The emulator's command line, for the same."""
    words = line.index("-append") + 1
    told = " ".join([line[words], *service_layers.boot_words(layers)])
    return [
        *(*line[:words], told, *line[words + 1 :]),
        *("-fsdev", f"local,id=f2,path={CACHE},security_model=none,readonly=on,multidevs=remap"),
        *("-device", "virtio-9p-pci,fsdev=f2,mount_tag=layers"),
    ]


def _command_line(guest: Guest, out: Path) -> list[str]:
    match guest:
        case "x86":
            return x86(*build_x86.build(sys.executable), out)
        case "uml":
            return uml(*build_uml.build(sys.executable), out)
        case "service":
            line = uml(*build_uml.build(sys.executable), out)
            return uml_with_systemd(line, service_layers.build())
        case "service-x86":
            line = x86(*build_x86.build(sys.executable), out)
            return x86_with_systemd(line, service_layers.build())


def command_file(out: Path, command: list[str]) -> None:
    """What the guest runs: the command, in the tree, with the tree's packages."""
    ours = (TREE / "daemon", TREE / "hal", TREE / "tests", HERE)
    folders = (*ours, spidev_package(sys.executable))
    paths = ":".join(shlex.quote(str(path)) for path in folders)
    (out / "command").write_text(
        f"cd {shlex.quote(str(TREE))}\n"
        f"export PYTHONPATH={paths}\n"
        f"export PATH={shlex.quote(str(Path(sys.executable).parent))}:$PATH\n"
        "export HOME=/run PYTHONDONTWRITEBYTECODE=1 LC_ALL=C.UTF-8\n"
        f"exec {shlex.join(command)}\n"
    )


def boot(guest: Guest, command: list[str], timeout_s: float) -> int:
    """Run `command` in the guest and print what it said. Returns its exit status.

    Raises: RigFailure (does not start, takes too long, ends without a status).
    """
    out = BUILD / guest / "out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    command_file(out, command)
    ended = _run_machine(_command_line(guest, out), out, timeout_s)
    output = out / "output"
    if output.exists():
        sys.stdout.write(output.read_text(errors="replace").replace("\r\n", "\n"))
        sys.stdout.flush()
    status = out / "status"
    if not ended:
        raise RigFailure(f"the guest was not done in {timeout_s} s\n{_console(out)}")
    if not status.exists():
        raise RigFailure(f"the guest ended without a status\n{_console(out)}")
    return int(status.read_text())


def _run_machine(line: list[str], out: Path, timeout_s: float) -> bool:
    """Run it to its end; False if it had to be ended, which takes its whole process group."""
    # A pipe, because User-Mode Linux does not take a file for its console.
    machine = subprocess.Popen(
        line,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        env=os.environ | {"TMPDIR": "/dev/shm"},
        start_new_session=True,
    )
    assert machine.stdout is not None
    late = Timer(timeout_s, os.killpg, (machine.pid, signal.SIGKILL))
    late.start()
    with machine.stdout as said:
        (out / "said").write_bytes(said.read())
    _, status, used = os.wait4(machine.pid, 0)
    late.cancel()
    machine.returncode = os.waitstatus_to_exitcode(status)
    (out / PROCESSOR_S).write_text(str(used.ru_utime + used.ru_stime))
    return machine.returncode != -signal.SIGKILL


def _console(out: Path) -> str:
    texts = [out / name for name in ("said", "console")]
    told = "".join(text.read_text(errors="replace") for text in texts if text.exists())
    return f"its console:\n{told[-_CONSOLE_TAIL:]}" if told else "and said nothing"


def main() -> int:
    parser = argparse.ArgumentParser(description="run a command in a guest")
    parser.add_argument("guest", choices=get_args(Guest))
    parser.add_argument("--timeout", type=float, default=_TIMEOUT_S, help="seconds")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    chosen = parser.parse_args()
    try:
        return boot(chosen.guest, chosen.command, chosen.timeout)
    except RigFailure as failure:
        print(f"the kernel rig failed: {failure}", file=sys.stderr)
        return 3


if __name__ == "__main__":
    sys.exit(main())
