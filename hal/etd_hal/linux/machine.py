"""Which machine this is, whether its SPI can time a pulse, and how its kernel is set.

Owns: reading the model and the few kernel settings that matter to a pulse or to the pins.
Must not know: boards. `root` is prepended to every path, for tests.
"""

from __future__ import annotations

import hashlib
from pathlib import Path

from etd_hal.bench import CpuClock
from etd_hal.boardfile import MachineFile

ROOT = Path("/")

_DEVICE_TREE = "sys/firmware/devicetree/base"
_MACHINE_ID = "etc/machine-id"
_CPU_CLOCK = "sys/devices/system/cpu/cpu0/cpufreq"
_DMI = "sys/class/dmi/id"
#: The processor of the Pi 5, the Compute Module 5 and the 500.
_INTERRUPT_DRIVEN = "brcm,bcm2712"


def model(root: Path = ROOT) -> str:
    """The model in the device tree, else what the firmware calls a PC; "" if neither is there."""
    from_tree = read_text(root / _DEVICE_TREE / "model")
    if from_tree:
        return from_tree
    return (
        f"{read_text(root / _DMI / 'sys_vendor')} {read_text(root / _DMI / 'product_name')}".strip()
    )


def identity(root: Path = ROOT) -> str:
    """A digest of the serial number in the device tree, or of the system's own identifier if there
    is no tree; "" if neither exists.
    """
    number = read_text(root / _DEVICE_TREE / "serial-number") or read_text(root / _MACHINE_ID)
    return hashlib.sha256(number.encode()).hexdigest()[:16] if number else ""


def problem(machine: MachineFile, root: Path = ROOT) -> str | None:
    """Why this machine file cannot stand for this machine, with what to do; None if it can.

    A machine file without models takes any machine but one whose SPI is interrupt-driven.
    """
    here = model(root)
    if _INTERRUPT_DRIVEN in read_text(root / _DEVICE_TREE / "compatible"):
        return (
            f"this is a {here}, whose SPI is driven by interrupts: every word would be late by"
            " tens of microseconds, and so the pulse as wide: use a Raspberry Pi 4, 3 or Zero 2 W"
        )
    if not machine.models or any(named in here for named in machine.models):
        return None
    return (
        f"this machine is {here or 'of unknown model'!r}, and {machine.name} is for"
        f" {', '.join(machine.models)}: name the right machine file in the configuration;"
        " where none is for this machine, a copy of one with `models = []`"
    )


def facts(root: Path = ROOT) -> tuple[str, ...]:
    """A sentence for each setting that helps to find a cause."""
    return (
        f"model: {model(root) or 'unknown'}",
        f"kernel: {read_text(root / 'proc/sys/kernel/osrelease') or 'unknown'}",
        _pins(root),
        _throttling(root),
        _isolation(root),
        f"cores: {cpu_clock(root) or 'this kernel does not say how fast they run'}",
    )


def cpu_clock(root: Path = ROOT) -> CpuClock | None:
    """Of the first core: on a Raspberry Pi all have one. None where nothing is reported."""
    folder = root / _CPU_CLOCK
    governor = read_text(folder / "scaling_governor")
    khz = [read_text(folder / name) for name in ("scaling_min_freq", "scaling_max_freq")]
    now = read_text(folder / "scaling_cur_freq")
    if not governor or not all(each.isdigit() for each in (*khz, now)):
        return None
    return CpuClock(governor, int(khz[0]), int(khz[1]), int(now))


def _pins(root: Path) -> str:
    modules = ("pinctrl_bcm2835", "pinctrl_rp1")
    for module in modules:
        value = read_text(root / "sys/module" / module / "parameters/persist_gpio_outputs")
        if value in ("Y", "1"):
            return "pins: keep their last level when the daemon is gone (persist_gpio_outputs=Y)"
        if value:
            return "pins: become inputs when the daemon is gone, and the pulls decide"
    return "pins: this kernel does not say what they do when the daemon is gone"


def _throttling(root: Path) -> str:
    runtime_us = read_text(root / "proc/sys/kernel/sched_rt_runtime_us")
    period_us = read_text(root / "proc/sys/kernel/sched_rt_period_us")
    if runtime_us == "-1":
        return "real-time throttling: off"
    if runtime_us and period_us:
        return f"real-time throttling: {runtime_us} us of every {period_us} us"
    return "real-time throttling: unknown"


def _isolation(root: Path) -> str:
    return f"isolated cores: {read_text(root / 'sys/devices/system/cpu/isolated') or 'none'}"


def read_text(path: Path) -> str:
    """The text of a kernel file without its NULs and line ends; "" if it cannot be read."""
    try:
        text = path.read_bytes().decode("utf-8", errors="replace")
    except OSError:
        return ""
    return text.replace("\0", " ").strip()
