"""Boots the x86 guest, runs one command in it, and brings back what it said and its status.

    .venv/bin/python tests/kernel/run.py [--timeout SECONDS] COMMAND ...

Owns: the machine's command line, the shared folder, the time limit, the machine's end.
Must not know: what the command does.

The guest's processor is emulated (TCG), so that a run is the same where virtualization is not to
be had. A guest that does not start, or ends without a status, is a failure with its console.
"""

from __future__ import annotations

import argparse
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

from build_x86 import BUILD, TREE, RigFailure, build, spidev_package

_TIMEOUT_S = 300
#: The emulated clock is right, however late the emulator runs: the kernel need not measure it.
_STEADY = "mitigations=off tsc=reliable no_timer_check"
#: So much of the console is shown when something went wrong.
_CONSOLE_TAIL = 4_000


def machine(kernel: Path, initrd: Path, out: Path, more: str) -> list[str]:
    """The emulator's command line. The first serial port is the console, the second the output."""
    share = "security_model=none"
    return [
        "qemu-system-x86_64",
        *("-M", "q35", "-accel", "tcg,thread=single,tb-size=512", "-icount", "shift=1", "-cpu", "max"),
        *("-smp", "1", "-m", "2048"),
        *("-nodefaults", "-no-user-config", "-display", "none", "-no-reboot", "-monitor", "none"),
        *("-serial", f"file:{out / 'console'}", "-serial", "stdio"),
        *("-kernel", str(kernel), "-initrd", str(initrd)),
        *("-append", f"console=ttyS0 quiet panic=-1 {_STEADY} {more}"),
        *("-fsdev", f"local,id=f0,path=/,{share},readonly=on,multidevs=remap"),
        *("-device", "virtio-9p-pci,fsdev=f0,mount_tag=hostroot"),
        *("-fsdev", f"local,id=f1,path={out},{share}"),
        *("-device", "virtio-9p-pci,fsdev=f1,mount_tag=out"),
    ]


def command_file(out: Path, command: list[str]) -> None:
    """What the guest runs: the command, in the tree, with the tree's packages."""
    paths = ":".join(
        str(path)
        for path in (TREE / "daemon", TREE / "hal", TREE / "tests", TREE / "tests/kernel")
    )
    (out / "command").write_text(
        f"cd {shlex.quote(str(TREE))}\n"
        f"export PYTHONPATH={shlex.quote(paths)}:{shlex.quote(str(BUILD / 'python'))}\n"
        f"export PATH={shlex.quote(str(Path(sys.executable).parent))}:$PATH\n"
        "export HOME=/run PYTHONDONTWRITEBYTECODE=1 LC_ALL=C.UTF-8\n"
        f"exec {shlex.join(command)}\n"
    )


def boot(command: list[str], timeout_s: float, more: str = "") -> int:
    """Run `command` in the guest; its output goes to ours. Returns its exit status.

    Raises: RigFailure (does not start, takes too long, ends without a status).
    """
    kernel, initrd = build(sys.executable)
    spidev_package(sys.executable)
    out = BUILD / "x86" / "out"
    shutil.rmtree(out, ignore_errors=True)
    out.mkdir(parents=True)
    command_file(out, command)
    guest = subprocess.Popen(machine(kernel, initrd, out, more), stdin=subprocess.DEVNULL)
    try:
        guest.wait(timeout_s)
    except subprocess.TimeoutExpired:
        raise RigFailure(f"the guest was not done in {timeout_s} s\n{_console(out)}") from None
    finally:
        if guest.poll() is None:
            guest.kill()
            guest.wait()
    status = out / "status"
    if guest.returncode or not status.exists():
        raise RigFailure(f"the guest ended without a status\n{_console(out)}")
    return int(status.read_text())


def _console(out: Path) -> str:
    console = out / "console"
    if not console.exists():
        return "and said nothing"
    return "its console:\n" + console.read_text(errors="replace")[-_CONSOLE_TAIL:]


def main() -> int:
    parser = argparse.ArgumentParser(description="run a command in the x86 guest")
    parser.add_argument("--timeout", type=float, default=_TIMEOUT_S, help="seconds")
    parser.add_argument("--append", default="", help="more for the kernel's command line")
    parser.add_argument("command", nargs=argparse.REMAINDER)
    chosen = parser.parse_args()
    try:
        return boot(chosen.command, chosen.timeout, chosen.append)
    except RigFailure as failure:
        print(f"the kernel rig failed: {failure}", file=sys.stderr)
        return 3


if __name__ == "__main__":
    sys.exit(main())
