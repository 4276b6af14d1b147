"""Stage 1, no risk: the machine and its software; and the machine's health after the last pulse.

Owns: what is expected of a machine. Must not know: the board.
"""

from __future__ import annotations

from etd.planning.duty import busy_fraction, told_of
from etd.selftest import realtime
from etd.selftest.fixture import Fixture
from etd.selftest.log import CheckLog

#: The firmware slows a Raspberry Pi down at 80 C (a Pi 3 B+ slightly from 60 C on).
_HOTTEST_C = 80.0
#: The engine takes some 60 MiB, the gateway as much.
_LEAST_FREE_MIB = 128
#: Widths are whole microseconds.
_COARSEST_NS = 1_000


def check(fixture: Fixture, log: CheckLog) -> None:
    """Raises: nothing."""
    _check_software(fixture, log)
    realtime.check(fixture, log)
    found = fixture.host.scan_core()
    log.judge("scan_core", True, told_of(busy_fraction(found.is_left_alone), str(found)))
    _check_memory(fixture, log)
    _check_clocks(fixture, log)
    log.judge(
        "pins_after_exit",
        not fixture.host.keeps_pins(),
        "they stay driven" if fixture.host.keeps_pins() else "they become inputs",
        "they become inputs, so that the pulls set their levels",
        "put dtparam=strict_gpiod into /boot/firmware/config.txt, and reboot",
    )
    _check_health(fixture, log)
    _check_cpu_clock(fixture, log)


def check_after(fixture: Fixture, log: CheckLog) -> None:
    """After the last pulse: temperature, supply, flags set since the start. Raises: nothing."""
    before, now = fixture.health_before, fixture.host.health()
    temperature_c = now.temperature_c
    wrong = [
        text
        for text, is_so in (
            ("hot", temperature_c is not None and temperature_c >= _HOTTEST_C),
            ("slowed down", now.is_throttled),
            ("under-voltage", now.is_under_voltage),
            (
                "slowed down during the test",
                now.was_throttled and before is not None and before.was_throttled is False,
            ),
            (
                "under-voltage during the test",
                now.was_under_voltage and before is not None and before.was_under_voltage is False,
            ),
        )
        if is_so
    ]
    at_c = "" if temperature_c is None else f"{temperature_c:.0f} C, "
    log.judge(
        "machine_after",
        not wrong,
        at_c + (", ".join(wrong) or "in order"),
        f"below {_HOTTEST_C:.0f} C, and neither slowed down nor under-voltage during the test",
        "use the Raspberry Pi's own supply, a short cable and cooling: it also supplies the board",
    )


def _check_software(fixture: Fixture, log: CheckLog) -> None:
    packages = fixture.host.packages()
    missing = [name for name, version in packages.items() if version is None]
    found = ", ".join(f"{name} {version}" for name, version in packages.items() if version)
    log.judge(
        "libraries",
        not missing,
        f"{', '.join(missing)} missing" if missing else found or "none are needed",
        "all that the backend needs",
        "pip install 'etd[pi]'",
    )
    problem = fixture.host.problem()
    log.judge("model", problem is None, problem or fixture.loaded.machine.name, "", problem or "")


def _check_memory(fixture: Fixture, log: CheckLog) -> None:
    free_kb = fixture.host.free_memory_kb()
    if free_kb is None:
        log.skip("free_memory", "this kernel does not report it", "check it by hand: free -m")
        return
    free_mib = free_kb // 1_024
    log.judge(
        "free_memory",
        free_mib >= _LEAST_FREE_MIB,
        f"{free_mib} MiB available",
        f"at least {_LEAST_FREE_MIB} MiB: the engine locks its memory",
        "end other programs: a kernel without memory kills processes, maybe the engine",
    )


def _check_clocks(fixture: Fixture, log: CheckLog) -> None:
    found = fixture.host.timekeeping()
    log.judge(
        "clock",
        found.least_step_ns >= 0 and found.resolution_ns <= _COARSEST_NS,
        f"{found.source}, resolution {found.resolution_ns} ns, "
        + ("sometimes goes back" if found.least_step_ns < 0 else "never goes back"),
        f"CLOCK_MONOTONIC to {_COARSEST_NS} ns or better, never back",
        "use a kernel with high-resolution timers, and the processor's own counter as clock source:"
        " pulses and rests are timed by it",
    )
    synchronized = {True: "synchronized", False: "not synchronized", None: "not known whether"}
    log.judge(
        "date",
        found.now >= found.not_before,
        f"{found.now:%Y-%m-%d %H:%M} UTC, {synchronized[found.is_synchronized]} (NTP)",
        f"not before {found.not_before:%Y-%m-%d}, when this program was installed",
        "set the date (timedatectl), or connect to a time server: reports and calibrations are"
        " dated",
    )


def _check_health(fixture: Fixture, log: CheckLog) -> None:
    fixture.health_before = health = fixture.host.health()
    if health.temperature_c is None:
        log.skip("temperature", "this kernel does not report it", "measure it by hand")
    else:
        log.judge(
            "temperature",
            health.temperature_c < _HOTTEST_C,
            f"{health.temperature_c:.0f} C",
            f"below {_HOTTEST_C:.0f} C",
            "let it cool; add a heat sink or a fan",
        )
    _check_flag(
        log,
        "throttling",
        health.is_throttled,
        "slowed down",
        "cool it, and check its supply: messages take longer than calibrated",
    )
    _check_flag(
        log,
        "supply_voltage",
        health.is_under_voltage,
        "under-voltage",
        "use the Raspberry Pi's own supply and a short cable",
    )


def _check_cpu_clock(fixture: Fixture, log: CheckLog) -> None:
    found = fixture.host.cpu_clock()
    if found is None:
        log.absent("cpu_clock", "this kernel reports no clock that it changes")
        return
    log.judge(
        "cpu_clock",
        found.is_fixed,
        str(found),
        "fixed: the governor performance, or one frequency alone",
        "set force_turbo=1 and core_freq in /boot/firmware/config.txt, or the governor performance"
        " (docs/install.md): messages, and with them pulses, change with the clocks",
    )


def _check_flag(log: CheckLog, name: str, is_wrong: bool | None, wrong: str, advice: str) -> None:
    if is_wrong is None:
        log.skip(name, "this kernel does not report it", "only a Raspberry Pi's firmware does")
        return
    log.judge(name, not is_wrong, wrong if is_wrong else "in order", "in order", advice)
