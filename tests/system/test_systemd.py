"""The units, as systemd itself reads them: laid out as `make install` does, in an empty root."""

from __future__ import annotations

import re
import shutil
import subprocess
from collections.abc import Iterable
from functools import cache
from pathlib import Path

import pytest

from etd.files.paths import SYSTEM_CALIBRATIONS

SYSTEMD = Path(__file__).parents[2] / "systemd"
UNITS = sorted(path.name for path in SYSTEMD.iterdir() if path.suffix in (".service", ".target"))

needs_systemd = pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="systemd-analyze is not installed here"
)


@pytest.fixture
def root(tmp_path: Path) -> Path:
    for name in UNITS:
        shutil.copy(SYSTEMD / name, tmp_path)
    return tmp_path


def verified(root: Path) -> subprocess.CompletedProcess[str]:
    units = [str(root / name) for name in UNITS]
    command = ["systemd-analyze", "verify", "--recursive-errors=no", *units]
    return subprocess.run(command, capture_output=True, text=True, check=False, timeout=600)


@needs_systemd
def test_systemd_has_nothing_to_say_about_the_units(root: Path) -> None:
    ran = verified(root)
    assert (ran.returncode, ran.stdout, ran.stderr) == (0, "", "")


@needs_systemd
@pytest.mark.parametrize("name", [name for name in UNITS if name.endswith(".service")])
def test_a_misspelt_guard_would_be_noticed(root: Path, name: str) -> None:
    unit = root / name
    unit.write_text(unit.read_text().replace("ProtectSystem=", "ProtectSytem="))
    ran = verified(root)
    assert ran.returncode != 0
    assert "ProtectSytem" in ran.stderr


@needs_systemd
@pytest.mark.parametrize("name", [name for name in UNITS if name.endswith(".service")])
def test_exposure_stays_below_one_of_ten(name: str) -> None:
    command = ["systemd-analyze", "security", "--offline=true", "--threshold=10"]
    ran = subprocess.run(
        [*command, str(SYSTEMD / name)], capture_output=True, text=True, check=False, timeout=600
    )
    assert ran.returncode == 0, ran.stdout
    assert re.search(r"exposure level .*: 0\.\d", ran.stdout)


def settings(name: str) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for line in (SYSTEMD / name).read_text().splitlines():
        key, equals, value = line.partition("=")
        if equals and not line.startswith("#"):
            found.setdefault(key, []).append(value)
    return found


def test_the_gateway_has_no_device_and_the_engine_no_network() -> None:
    gateway, engine = settings("etd-gateway@.service"), settings("etd-engine@.service")
    assert gateway["PrivateDevices"] == ["yes"]
    assert "DeviceAllow" not in gateway
    assert engine["PrivateNetwork"] == ["yes"]
    assert engine["RestrictAddressFamilies"] == ["AF_UNIX"]
    assert engine["DevicePolicy"] == ["closed"]


def test_operators_write_calibrations_and_the_gateway_cannot() -> None:
    """The engine must know users apart, so it has no user namespace."""
    engine, gateway = settings("etd-engine@.service"), settings("etd-gateway@.service")
    assert engine["ExecStartPre"] == [
        f"+/usr/bin/install -d -o root -g etd-users -m 0750 {SYSTEM_CALIBRATIONS}",
        f"+/usr/bin/install -d -o root -g etd-operators -m 2775 {SYSTEM_CALIBRATIONS}/%i",
    ]
    assert "PrivateUsers" not in engine
    users = (SYSTEMD / "etd.sysusers.conf").read_text().splitlines()
    members = {tuple(line.split()[1:]) for line in users if line.startswith("m ")}
    assert {("etd-engine", "etd-users"), ("etd-gateway", "etd-users")} <= members
    assert not [group for _, group in members if group == "etd-operators"]
    assert gateway["ProtectSystem"] == ["strict"]
    written = {*gateway["ReadWritePaths"], *gateway["StateDirectory"]}
    assert written == {"/run/etd/%i", "etd/%i"}
    folders = (SYSTEMD / "etd.tmpfiles.conf").read_text().splitlines()
    assert f"d {SYSTEM_CALIBRATIONS} 0750 root etd-users -" in folders


def test_the_engine_ends_in_the_safe_state_and_refusals_are_not_repeated() -> None:
    engine = settings("etd-engine@.service")
    assert engine["ExecStopPost"] == ["/usr/bin/env /opt/etd/venv/bin/etd safe --name %i"]
    assert engine["RestartPreventExitStatus"] == ["1 2 3"]
    assert engine["Type"] == ["notify"]
    assert "WatchdogSec" in engine


@cache
def calls_of(group: str) -> frozenset[str]:
    """The calls of a group of systemd's, of the groups in it too."""
    command = ["systemd-analyze", "syscall-filter", group]
    ran = subprocess.run(command, capture_output=True, text=True, check=True, timeout=600)
    lines = [line.strip() for line in ran.stdout.splitlines()[1:]]
    return every(line for line in lines if line and not line.startswith("#"))


def every(named: Iterable[str]) -> frozenset[str]:
    """Each call as it is, each group as its calls."""
    return frozenset().union(*(calls_of(one) if one[0] == "@" else {one} for one in named))


@needs_systemd
def test_the_engines_service_writes_no_other_processes_memory_and_can_confine_one() -> None:
    left: frozenset[str] = frozenset()
    for words in settings("etd-engine@.service")["SystemCallFilter"]:
        taken = every(words.removeprefix("~").split())
        left = left - taken if words[0] == "~" else left | taken
    assert not left & {"ptrace", "process_vm_readv", "process_vm_writev", "pidfd_getfd", "kcmp"}
    # What the engine and the process that parses calibrations need for their own confinement.
    assert left >= {"prctl", "prlimit64", "close_range", "execve", "vfork", "sched_setaffinity"}


def test_the_two_processes_are_two_users_without_capabilities() -> None:
    units = [settings(f"etd-{part}@.service") for part in ("engine", "gateway")]
    assert [unit["User"] for unit in units] == [["etd-engine"], ["etd-gateway"]]
    assert all(unit["CapabilityBoundingSet"] == [""] for unit in units)


def test_whoever_stays_down_is_told_of_after_so_many_starts_and_not_after_each() -> None:
    """An operator's own `OnFailure=` hangs on it: what is always restarted never fails."""
    for name in ("etd-engine@.service", "etd-gateway@.service"):
        unit = settings(name)
        assert (unit["StartLimitBurst"], unit["StartLimitIntervalSec"]) == (["5"], ["300"])
        assert unit["Restart"] == ["on-failure"]


def test_the_engine_comes_after_the_device_that_its_unit_allows_and_udev_tells_systemd_of() -> None:
    engine = settings("etd-engine@.service")
    assert engine["Wants"] == engine["After"] == ["dev-spidev0.0.device"]
    assert "/dev/spidev0.0 rw" in engine["DeviceAllow"]
    rules = (SYSTEMD / "90-etd.rules").read_text().splitlines()
    spidev = next(rule for rule in rules if 'SUBSYSTEM=="spidev"' in rule)
    assert 'TAG+="systemd"' in spidev
    waits_s = float(engine["ExecStart"][0].partition("--wait ")[2])
    assert waits_s < float(engine["TimeoutStartSec"][0]) / 2


def test_the_rules_give_each_bus_to_its_group_and_to_nobody_else() -> None:
    rules = (SYSTEMD / "90-etd.rules").read_text().splitlines()
    given = [re.findall(r'(\w+)(?:=|==|:=)"([^"]*)"', rule) for rule in rules if rule[0] != "#"]
    found = {
        (rule.get("SUBSYSTEM"), rule.get("KERNEL")): (rule["GROUP"], rule["MODE"])
        for rule in map(dict, given)
    }
    assert found == {
        ("gpio", "gpiochip*"): ("gpio", "0660"),
        ("spidev", None): ("spi", "0660"),
        ("spidev", "spidev0.0"): ("etd-spi", "0660"),
        ("i2c-dev", None): ("i2c", "0660"),
        ("*gpiomem*", None): ("root", "0600"),
        (None, "pio[0-9]*"): ("root", "0600"),
    }


def test_the_registers_of_the_lines_are_nobodys_and_stay_so() -> None:
    """Through them a program of group gpio would move the engine's lines."""
    rules = (SYSTEMD / "90-etd.rules").read_text().splitlines()
    for device in ("gpiomem", "pio[0-9]"):
        (own,) = (rule for rule in rules if device in rule and not rule.startswith("#"))
        assert 'GROUP:="root", MODE:="0600"' in own


def test_the_boards_spi_device_is_the_engines_alone_and_stays_so() -> None:
    """Rules of Raspberry Pi OS that come later (99-com.rules) give all of them to group spi."""
    rules = (SYSTEMD / "90-etd.rules").read_text().splitlines()
    (own,) = (rule for rule in rules if 'KERNEL=="spidev0.0"' in rule)
    assert 'GROUP:="etd-spi"' in own
    assert 'MODE:="0660"' in own
    users = (SYSTEMD / "etd.sysusers.conf").read_text().splitlines()
    assert [line.split()[1] for line in users if line.endswith(" etd-spi")] == ["etd-engine"]
