"""Stage 1, no risk: the machine and its software, before anything on the board is moved.

Owns: what is expected of a machine. Must not know: the board.
"""

from __future__ import annotations

from etd.selftest.bed import Bed
from etd.selftest.log import Log

#: The firmware slows a Raspberry Pi down at 80 C (a Pi 3 B+ at 60 C, softly).
_HOTTEST_C = 80.0


def check(bed: Bed, log: Log) -> None:
    """Raises: nothing."""
    _check_software(bed, log)
    _check_realtime(bed, log)
    log.judge(
        "pins_after_exit",
        not bed.host.keeps_pins(),
        "they stay driven" if bed.host.keeps_pins() else "they become inputs",
        "they become inputs, so that the pulls decide",
        "put dtparam=strict_gpiod into /boot/firmware/config.txt, and boot again",
    )
    _check_health(bed, log)


def _check_software(bed: Bed, log: Log) -> None:
    packages = bed.host.packages()
    missing = [name for name, version in packages.items() if version is None]
    found = ", ".join(f"{name} {version}" for name, version in packages.items() if version)
    log.judge(
        "libraries",
        not missing,
        f"{', '.join(missing)} missing" if missing else found or "none are needed",
        "all that the backend needs",
        "pip install 'etd[pi]'",
    )
    problem = bed.host.problem()
    log.judge("model", problem is None, problem or bed.loaded.machine.name, "", problem or "")


def _check_realtime(bed: Bed, log: Log) -> None:
    wanted = bed.loaded.config.engine
    if wanted.priority == "none" and bed.backend_name == "linux":
        log.skip(
            "realtime",
            "engine.priority is none in the configuration",
            "give it a priority: pulses are late under load otherwise",
        )
        return
    priority = 1 if wanted.priority == "none" else wanted.priority
    refused = bed.host.set_up_realtime(priority, None if wanted.core == "any" else wanted.core)
    log.judge(
        "realtime",
        not refused,
        "; ".join(refused) or "all granted",
        "scheduler, core, timer slack and locked memory",
        "run it as root or by systemd, or allow rtprio and memlock in limits.conf",
    )


def _check_health(bed: Bed, log: Log) -> None:
    health = bed.host.health()
    if health.temperature_c is None:
        log.skip("temperature", "this kernel does not tell it", "measure it by hand")
    else:
        log.judge(
            "temperature",
            health.temperature_c < _HOTTEST_C,
            f"{health.temperature_c:.0f} C",
            f"below {_HOTTEST_C:.0f} C",
            "let it cool; give it a heat sink and air",
        )
    _check_flag(
        log,
        "throttling",
        health.is_throttled,
        "slowed down",
        "cool it, and look at its supply: messages take longer than calibrated",
    )
    _check_flag(
        log,
        "supply_voltage",
        health.is_under_voltage,
        "under-voltage",
        "use the Raspberry Pi's own supply and a short cable",
    )


def _check_flag(log: Log, name: str, is_wrong: bool | None, wrong: str, advice: str) -> None:
    if is_wrong is None:
        log.skip(name, "this kernel does not tell it", "only a Raspberry Pi's firmware knows")
        return
    log.judge(name, not is_wrong, wrong if is_wrong else "in order", "in order", advice)
