"""The services for real: systemd as the first process, our units and users and device rules.

The board's buses answer zero by themselves (`alone`): what is judged is systemd, the journal, and
the kernel's trace.
"""

from __future__ import annotations

import json
import os
import re
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import intruder
import kernel_trace
import service_scene as scene
import trace_decoder
import trace_rules
from etd.client import Display
from etd.files.calibration import load_calibration
from etd.protocol.calibration_set import digest_of
from etd.protocol.errors import Refused
from etd_hal.fake.trace import header
from etd_hal.linux import gpio
from guest_board import TREE, report, unplugged
from kernel_trace import Event
from service_scene import CLOCK, ENGINE, GATEWAY, OPERATOR, PERSON, STRANGER, TOLD

FACTS = trace_decoder.parse(header(scene.BOARD, range(scene.BOARD.switch.outputs)))[0]
#: Stamps are cut to whole microseconds.
REST_US = scene.BOARD.rest_us - 1
GPIO = Path("/dev/gpiochip0")
ENDED = ("ActiveState", "ExecMainStatus", "NRestarts")
STAYS_DOWN = {"ActiveState": "failed", "NRestarts": "0"}
#: More than a probe, in uA: somebody is to feel it.
FELT_UA = 310


def pulses(events: list[Event]) -> list[trace_decoder.Phase]:
    """What is strong enough to be felt, by a decoding that knows nothing of our encoders."""
    phases = trace_decoder.decode(kernel_trace.records(events, FACTS))
    return [phase for phase in phases if phase.current_ua > FELT_UA]


def assert_made_safe_by(pid: int, events: list[Event]) -> int:
    """By `etd safe` of this process id: POL up, BL down, a zero word. When it began, in ns."""
    mine = [event for event in events if event.pid == pid]
    lines = {event.rest for event in mine if event.name == "rig_line"}
    named = scene.BOARD.used_lines()
    assert {f"{named['POL']} 1", f"{named['BL']} 0"} <= lines
    assert bytes(2) in [event.tx for event in mine if event.name == "spi_transfer_start"]
    return mine[0].t_us * 1_000


def test_both_are_ready_and_each_is_a_user_of_its_own_without_rights(services: None) -> None:
    engine, gateway = scene.main_pid(ENGINE), scene.main_pid(GATEWAY)
    assert scene.user_of(engine) == "etd-engine"
    assert scene.groups_of(engine) == {"etd", "etd-spi", "etd-users", "gpio", "spi", "i2c"}
    assert scene.user_of(gateway) == "etd-gateway"
    assert scene.groups_of(gateway) == {"etd", "etd-users"}
    for pid in (engine, gateway):
        facts = scene.process_facts(pid)
        assert [facts[key] for key in ("CapEff", "CapPrm", "CapBnd")] == ["0" * 16] * 3
        assert (facts["NoNewPrivs"], facts["Seccomp"]) == ("1", "2")
    assert os.sched_getscheduler(engine) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
    assert os.sched_getparam(engine).sched_priority == 80
    assert os.sched_getscheduler(gateway) == os.SCHED_OTHER
    assert len(list(Path(f"/proc/{engine}/task").iterdir())) == 1, "it has one thread"
    stopper, sensors = sorted(scene.children_of(engine))
    assert os.sched_getscheduler(stopper) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
    assert os.sched_getparam(stopper).sched_priority == 81
    assert os.sched_getscheduler(sensors) == os.SCHED_OTHER
    assert not [path for path in scene.opened_by(stopper) if "spidev" in path or "i2c" in path]
    assert not [path for path in scene.opened_by(sensors) if "spidev" in path or "gpio" in path]
    assert scene.shown(ENGINE, "StatusText")["StatusText"].startswith("SAFE, kajimoto-hv507")


def test_nobody_of_the_engines_user_looks_into_its_processes_or_writes_their_memory(
    services: None,
) -> None:
    engine = scene.main_pid(ENGINE)
    program = Path(intruder.__file__).read_text()
    for pid in (engine, *scene.children_of(engine)):
        tried = scene.run(scene.INSTALLED, "-I", "-c", program, str(pid), user="etd-engine")
        answers = json.loads(tried.stdout)
        assert len(answers) == 7
        assert set(answers.values()) <= {"EPERM", "EACCES"}


def test_devices_belong_to_groups_and_the_engine_alone_has_them(services: None) -> None:
    groups = {"/dev/gpiochip0": "gpio", "/dev/spidev0.0": "etd-spi", "/dev/i2c-1": "i2c"}
    for device, group in groups.items():
        assert scene.owner_of(Path(device)) == f"root {group} 660"
        for user, may in (("etd-engine", True), ("etd-gateway", False), (PERSON, False)):
            opened = scene.run("sh", "-c", f": <>{device}", user=user)
            assert (opened.returncode == 0) is may, (user, device)


def test_even_root_opens_no_other_device_in_the_engines_place(services: None) -> None:
    group = "/sys/fs/cgroup" + scene.shown(ENGINE, "ControlGroup")["ControlGroup"]
    opens = 'echo $$ >"$0/cgroup.procs" && : <>"$1"'
    for device in ("/dev/gpiochip0", "/dev/spidev0.0", "/dev/i2c-1"):
        assert scene.run("sh", "-c", opens, group, device).returncode == 0
    for device in ("/dev/spidev0.1", "/dev/rig", "/dev/mem"):
        refused = scene.run("sh", "-c", opens, group, device)
        assert "Operation not permitted" in refused.stderr


def test_people_reach_the_gateway_and_nobody_the_engine(services: None) -> None:
    assert scene.owner_of(scene.SOCKETS) == "etd-engine etd 771"
    for name in ("control", "frames", "telemetry"):
        path = scene.SOCKETS / f"{name}.sock"
        assert scene.owner_of(path) == "etd-gateway etd-users 660"
    for name in ("commands", "frames"):
        path = scene.SOCKETS / f"engine-{name}.sock"
        assert scene.owner_of(path) == "etd-engine etd 660"
    assert scene.owner_of(Path("/var/lib/etd/main")) == "etd-gateway etd-users 700"
    assert scene.owner_of(Path("/var/lib/etd/main.engine")) == "etd-engine etd 700"
    assert scene.owner_of(scene.CALIBRATIONS) == "root etd-users 750"
    assert scene.owner_of(scene.CALIBRATIONS / "main") == "root etd-operators 2775"
    refused = scene.run("etd", "status", user=STRANGER)
    assert refused.returncode == 3
    assert "may not use the socket" in refused.stderr


def test_an_operator_stores_what_the_engine_takes_and_the_gateway_cannot_write(
    services: None, tmp_path: Path
) -> None:
    file, stored = tmp_path / "P01.toml", scene.CALIBRATIONS / "main" / "P01.toml"
    modelled = (TREE / "config/calibrations/fake-fingertip.toml").read_text()
    # As if a person had answered for it: what a model answered for is refused on real lines, below.
    file.write_text(modelled.replace("modelled = true\n", ""))
    scene.said_by("chmod", "a+rX", *map(str, (file, tmp_path, *tmp_path.parents[:2])))
    imported = ("etd", "calibration", "import", str(file))
    for user in (PERSON, "etd-gateway"):
        refused = scene.run(*imported, user=user)
        assert "etd-operators" in refused.stdout + refused.stderr
        assert not stored.exists()
    taken = scene.run(*imported, user=OPERATOR)
    assert taken.returncode == 0, taken.stdout + taken.stderr
    assert scene.owner_of(stored) == f"{OPERATOR} etd-operators 644"
    for what in (f"echo >>{stored}", f"rm -f {stored}", f"echo >{stored.parent}/P02.toml"):
        assert scene.run("sh", "-c", what, user="etd-gateway").returncode != 0
    assert scene.run("cat", str(stored), user=STRANGER).returncode != 0
    try:
        with Display(address=scene.ADDRESS, calibration="P01") as display:
            (told,) = display.arm()
        assert told.digest == digest_of(load_calibration(file))
        stored.write_text(modelled)
        with (
            Display(address=scene.ADDRESS, calibration="P01") as display,
            pytest.raises(Refused, match="no person felt it"),
        ):
            display.arm()
        scene.said_by("chown", "etd-gateway", str(stored))
        with (
            Display(address=scene.ADDRESS, calibration="P01") as display,
            pytest.raises(Refused, match="the gateway could have written this: it belongs to user"),
        ):
            display.arm()
    finally:
        stored.unlink()


def test_what_a_person_plays_is_fired_where_and_as_strong_as_it_says(
    services: None, tmp_path: Path
) -> None:
    scene.said_by("chmod", "a+rX", *map(str, (tmp_path, *tmp_path.parents[:2])))
    played = scene.play(tmp_path / "pattern.json", {3: 0.4, 40: 0.7})
    assert played.returncode == 0, played.stdout + played.stderr
    fired = pulses(kernel_trace.events())
    for electrode, current_ua in ((3, 400), (40, 700)):
        strongest = max(phase.current_ua for phase in fired if phase.electrode == electrode)
        assert current_ua * 0.98 <= strongest <= current_ua
    assert {phase.electrode for phase in fired} == {3, 40}


def test_stopping_ends_both_in_peace_and_leaves_a_safe_board(services: None) -> None:
    before = {unit: scene.cursor(unit) for unit in (ENGINE, GATEWAY)}
    scene.stop()
    for unit, since in before.items():
        said = [entry.text for entry in scene.journal(since, unit)]
        assert f"{unit}: Deactivated successfully." in said
    (pid,) = scene.safe_pids(scene.journal(before[ENGINE]))
    assert_made_safe_by(pid, kernel_trace.events())
    chip = gpio.find_chip(scene.BOARD.gpio_chip_labels)
    assert gpio.holders(chip, tuple(scene.BOARD.used_lines().values())) == {}


def test_an_engine_that_ends_is_made_safe_and_started_again_and_in_the_end_stays_down(
    services: None,
) -> None:
    """Five starts in five minutes: the one before, after a kill, after a hang, after more kills."""
    assert_killed_as_it_shows_a_frame()
    assert_found_hanging()
    before = scene.cursor()
    killed = 0
    engine: int | None = scene.main_pid(ENGINE)
    while engine:
        assert not TOLD.exists()
        end_engine(signal.SIGKILL, engine)
        killed += 1
        engine = scene.started_again(engine)
    scene.wait(TOLD.exists, "the unit of OnFailure=")
    assert TOLD.read_text().split() == [ENGINE, "signal"]
    # The first start does not count where `reset-failed` came after it.
    assert killed in (3, 4)
    assert len(scene.safe_pids(scene.journal(before))) == killed
    told = scene.status()
    assert told is not None
    assert told.engine == "gone"


def assert_killed_as_it_shows_a_frame() -> None:
    """What began ends in zero, ExecStopPost makes safe, what comes up is HALTED and silent."""
    before = scene.cursor()
    pid = scene.main_pid(ENGINE)
    with scene.showing([1_000] * 64):
        shown_ns = CLOCK.now_ns()
        CLOCK.sleep_until_ns(shown_ns + 400_000_000)
        killed_ns = end_engine(signal.SIGKILL, pid)
    scene.wait(lambda: scene.restarts() == 1, "a restart")
    scene.clear_crash()
    events = kernel_trace.events()
    fired = pulses(events)
    # Where in a scan does not matter here: check_service_kills.py has all its moments.
    assert shown_ns < fired[-1].to_ns < killed_ns + 1_000_000, "it fired not then, or afterwards"
    for message in kernel_trace.messages(events):
        assert [event.tx for event in message if event.tx][-1] == bytes(2)
    assert trace_rules.violations(kernel_trace.records(events, FACTS), REST_US) == []
    said = assert_made_safe(before, killed_ns, events)
    assert "code=killed, status=9/KILL" in said
    assert "Failed with result 'signal'" in said


def assert_found_hanging() -> None:
    """No WATCHDOG=1 for half a second: aborted, made safe, started again."""
    kernel_trace.begin()
    before = scene.cursor()
    hung_ns = end_engine(signal.SIGSTOP)
    scene.wait(lambda: scene.restarts() == 2, "a restart")
    said = assert_made_safe(before, hung_ns, kernel_trace.events())
    assert "Watchdog timeout (limit 500ms)!" in said
    assert "code=killed, status=6/ABRT" in said
    assert "Failed with result 'watchdog'" in said
    scene.wait_for_state("SAFE")


def end_engine(number: signal.Signals, pid: int | None = None) -> int:
    """Send it, to this process id if it is known already; when it was sent."""
    pid = scene.main_pid(ENGINE) if pid is None else pid
    assert pid > 0, "there is no engine"
    sent_ns = CLOCK.now_ns()
    os.kill(pid, number)
    return sent_ns


def assert_made_safe(before: str, ended_ns: int, events: list[Event]) -> str:
    """By ExecStopPost, once. Returns what the journal says."""
    journal = scene.journal(before)
    (pid,) = scene.safe_pids(journal)
    late_ms = (assert_made_safe_by(pid, events) - ended_ns) / 1e6
    report(f"from the signal to the first line of `etd safe`: {late_ms:.0f} ms")
    return "\n".join(entry.text for entry in journal)


def test_an_engine_that_starts_before_udev_is_done_with_its_devices_comes_up_with_them(
    services: None,
) -> None:
    """As at boot: the devices come, and udev comes to them later still."""
    scene.stop()
    with unplugged("rig-gpio"), unplugged("rig-spi"):
        scene.said_by("udevadm", "settle")
        scene.said_by("systemctl", "start", "--no-block", scene.TARGET)
        pause_s(2)
        scene.said_by("udevadm", "control", "--stop-exec-queue")
    try:
        pause_s(2)
        assert scene.owner_of(Path("/dev/spidev0.0")) == "root root 600"
        assert scene.main_pid(ENGINE) == 0
    finally:
        scene.said_by("udevadm", "control", "--start-exec-queue")
    given_ns = CLOCK.now_ns()
    scene.wait_for_state("SAFE")
    assert CLOCK.now_ns() - given_ns < 3_000_000_000
    assert scene.owner_of(Path("/dev/gpiochip0")) == "root gpio 660"
    assert scene.restarts() == 0


def test_an_engine_whose_lines_are_permitted_two_seconds_late_comes_up_then(
    services: None,
) -> None:
    scene.said_by("systemctl", "stop", ENGINE)
    before = scene.cursor()
    with nobodys(GPIO):
        scene.said_by("systemctl", "start", "--no-block", ENGINE)
        pause_s(2)
        assert scene.shown(ENGINE, "ActiveState") == {"ActiveState": "activating"}
    scene.wait_for_state("SAFE")
    said = [entry.text for entry in scene.journal(before)]
    assert any(f"waiting 10.0 s at most for: opening on {GPIO}" in text for text in said)
    assert any("all devices are there after 2." in text for text in said)


def test_an_engine_whose_lines_are_never_permitted_says_what_to_do_and_stays_down(
    services: None,
) -> None:
    scene.said_by("systemctl", "stop", ENGINE)
    before = scene.cursor()
    with nobodys(GPIO):
        begun_ns = CLOCK.now_ns()
        assert scene.run("systemctl", "start", ENGINE).returncode != 0
        passed_s = (CLOCK.now_ns() - begun_ns) / 1e9
    assert 10 <= passed_s < 12
    assert scene.shown(ENGINE, *ENDED) == {**STAYS_DOWN, "ExecMainStatus": "3"}
    said = "\n".join(entry.text for entry in scene.journal(before))
    assert "join the groups gpio, spi and i2c" in said


@contextmanager
def nobodys(device: Path) -> Iterator[None]:
    """As the kernel makes its node, before udev has come to it."""
    scene.said_by("chown", "root:root", str(device))
    scene.said_by("chmod", "0600", str(device))
    yield
    scene.said_by("chgrp", "gpio", str(device))
    scene.said_by("chmod", "0660", str(device))


def pause_s(seconds: int) -> None:
    CLOCK.sleep_until_ns(CLOCK.now_ns() + seconds * 1_000_000_000)


def test_an_engine_without_its_bus_is_not_tried_again_and_somebody_is_told(
    services: None,
) -> None:
    scene.said_by("systemctl", "stop", ENGINE)
    with unplugged("rig-spi"):
        scene.said_by("udevadm", "settle")
        begun_ns = CLOCK.now_ns()
        assert scene.run("systemctl", "start", ENGINE).returncode != 0
        passed_s = (CLOCK.now_ns() - begun_ns) / 1e9
        shown = scene.shown(ENGINE, *ENDED)
    # What comes back is nobody's until udev has seen it.
    scene.said_by("udevadm", "settle")
    assert shown == {**STAYS_DOWN, "ExecMainStatus": "3"}
    # Ten seconds until systemd starts it all the same, and ten of its own.
    assert 20 <= passed_s < 22
    scene.wait(TOLD.exists, "the unit of OnFailure=")
    assert TOLD.read_text().split() == [ENGINE, "exit-code"]


@pytest.mark.parametrize(("unit", "at_most"), [(ENGINE, 0.7), (GATEWAY, 0.5)])
def test_exposure_as_booted(installed: None, unit: str, at_most: float) -> None:
    told = scene.said_by("systemd-analyze", "security", "--no-pager", unit)
    found = re.search(rf"exposure level for {re.escape(unit)}: (\d+\.\d)", told)
    assert found is not None, told
    report(f"{unit}: exposure as booted {found[1]} of 10, {at_most} allowed")
    assert float(found[1]) <= at_most
