"""`etd run` and what an operator does with a running daemon, as processes."""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from command_rig import WITHIN_S, Command, CommandRig, command_rig, wait_for_end
from etd.client import Display
from etd.files.calibration import load_calibration
from etd.files.exclusive import BOTH_PARTS, NameLock
from etd.files.paths import address_of
from etd.files.resources import find
from etd.protocol.calibration_set import digest_of
from etd.protocol.messages import StateReport

pytestmark = pytest.mark.slow


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


@pytest.fixture(scope="module")
def shared() -> Iterator[CommandRig]:
    """With a daemon, for what leaves it in SAFE without a lease."""
    with command_rig() as made, made.daemon("--array", "pad-8"):
        yield made


def display(rig: CommandRig) -> Display:
    return Display(address=address_of(rig.folder / "run" / "etd" / "main"), client="test")


def wait_for_state(rig: CommandRig, wanted: str) -> None:
    with display(rig) as watching, watching.telemetry("state", timeout_s=WITHIN_S) as reports:
        for _, report in reports:
            if getattr(report, "state", None) == wanted:
                return


def test_the_first_line_says_that_it_is_a_fake(rig: CommandRig) -> None:
    command = rig.start("run", "--board", "fake", "--array", "pad-8", "--seconds", "0.1")
    line = command.line()
    assert "backend: fake" in line
    assert "8 electrodes" in line
    assert str(rig.folder / "run" / "etd" / "main" / "control.sock") in line
    assert command.ended().status == 0


def test_nothing_is_refused_before_the_first_client_comes(rig: CommandRig) -> None:
    with rig.daemon():
        counters = rig.run("status", "--json").answer["status"]["counters"]
    assert not [name for name in counters if name.startswith("refused")]
    assert counters.get("control_disconnects", 0) <= 1, "that of `status` itself"


def test_a_second_daemon_of_the_name_is_refused_and_leaves_the_first_alone(
    rig: CommandRig,
) -> None:
    trace = rig.folder / "trace.jsonl"
    with rig.daemon("--trace", str(trace)):
        recorded = trace.read_bytes()
        second = rig.run("run", "--board", "fake", "--trace", str(trace))
        assert second.status == 1
        assert "already running" in second.err
        assert trace.read_bytes().startswith(recorded)
        assert recorded.startswith(b'{"etd_trace"')
        assert rig.run("status", "--json").answer["status"]["state"] == "SAFE"


@pytest.mark.parametrize("folder", ["a", "b"], ids=["both folders shared", "the state shared"])
def test_a_second_engine_is_refused_before_it_has_a_line_or_keeps_its_boards_file(
    rig: CommandRig, folder: str
) -> None:
    """The copy is for `etd safe`: it is of the board whose lines were moved."""
    state = ("--state", str(rig.folder / "kept"))
    with rig.daemon("--folder", str(rig.folder / "a"), *state):
        (copy,) = (rig.folder / "kept").glob("board-as-started-*.toml")
        kept, trace = copy.read_bytes(), rig.folder / "trace.jsonl"
        second = rig.run(
            *("run", "--part", "engine", "--board", "fake:feetthrough-relay", *state),
            *("--folder", str(rig.folder / folder), "--trace", str(trace)),
        )
        assert "already running" in second.err
        assert "other folders where --folder or --state names one" in second.err
        assert second.status == 1
        assert copy.read_bytes() == kept
        assert not trace.exists()


def test_where_the_boards_file_cannot_be_kept_nothing_is_armed(rig: CommandRig) -> None:
    state = rig.folder / "kept"
    (state / "board-as-started-fake.toml").mkdir(parents=True)
    state.chmod(0o700)
    with rig.daemon("--array", "pad-8", "--state", str(state)):
        why = rig.run("status", "--json").answer["status"]["arming_refused"]
        assert "board-as-started-fake.toml" in why
        assert "name another folder with --state" in why


def test_stop_halts_until_it_is_cleared(shared: CommandRig) -> None:
    stopped = shared.run("stop", "--json")
    assert stopped.status == 0
    assert [entry["name"] for entry in stopped.answer["daemons"]] == ["main"]
    status = shared.run("status")
    assert f"HALTED by stop ('etd stop' (user {os.getuid()})" in status.out
    refused = shared.run("measure", "--json")
    assert (refused.status, refused.answer["error"]) == (1, "halted")
    assert shared.run("clear").status == 0
    assert shared.run("clear", "--json").answer["error"] == "wrong_state"


def test_a_stop_of_an_engine_that_hangs_says_so_and_what_to_do(rig: CommandRig) -> None:
    with rig.daemon() as running:
        engine = running.children()["engine"]
        os.kill(engine, signal.SIGSTOP)
        try:
            stopped = rig.run("stop")
            status = rig.run("status")
        finally:
            os.kill(engine, signal.SIGCONT)
    assert stopped.status == 3
    assert "the engine did not answer the stop, so its link was closed" in stopped.out
    assert "press the stop button or run `etd safe`" in stopped.out
    assert "nothing is driven" not in status.out


def test_the_verbs_reach_a_daemon_by_its_folder(rig: CommandRig) -> None:
    """From another working folder, too: what it names is a whole path."""
    folder = rig.folder / "its own"
    with rig.daemon("--array", "pad-8", "--folder", "its own") as running:
        assert running.line() == f"to stop it: etd stop --folder '{folder}'"
        nowhere = rig.run("stop")
        assert nowhere.status == 3
        assert "`etd stop --folder DIR`" in nowhere.err
        rig.subfolder = "elsewhere"
        for verb in ("measure", "calibration list", "record list", "monitor --seconds 0.2"):
            told = rig.run(*verb.split(), "--folder", str(folder))
            assert told.status == 0, (verb, told.err)
        for verb, error in (
            ("arm", "no_lease"),
            ("clear", "wrong_state"),
            ("note x", "no_record"),
            ("disarm --lease x", "no_lease"),
        ):
            told = rig.run(*verb.split(), "--json", "--folder", str(folder))
            assert (told.status, told.answer["error"]) == (1, error), verb
        there = ("--folder", str(folder))
        exported = rig.folder / "c.toml"
        exported.write_text(rig.run("calibration", "export", "fake-fingertip-pad-8", *there).out)
        told = rig.run("calibration", "import", str(exported), "--as", "p01", *there)
        assert told.status == 0, told.err
        assert (folder / "state" / "calibrations" / "p01.toml").is_file()
        stopped = rig.run("stop", "--folder", str(folder))
        assert (stopped.status, stopped.err) == (0, "")
        assert stopped.out.startswith(f"{folder}: silent, HALTED")
        status = rig.run("status", "--json", "--folder", str(folder)).answer["status"]
        assert status["state"] == "HALTED"
        assert rig.run("clear", "--folder", str(folder)).status == 0


def test_a_folder_without_a_daemon_is_told_with_what_ends_it(rig: CommandRig) -> None:
    stopped = rig.run("stop", "--folder", str(rig.folder))
    assert stopped.status == 3
    assert "NOT STOPPED: there is no socket" in stopped.out
    assert "then end\n  the `etd run` that runs it" in stopped.out
    assert "Other daemons go\n  on: `etd stop` alone stops all but those" in stopped.out
    assert "systemctl" not in stopped.out
    for verb in ("play x.json", "calibrate P01 --max-current-ua 1000"):
        told = rig.run(*verb.split(), "--board", "fake", "--folder", str(rig.folder))
        assert told.status == 2, told.err
        assert "--folder is a running one" in told.err


def test_status_tells_why_arming_is_refused_until_it_is_not(rig: CommandRig) -> None:
    report = rig.folder / "report.json"
    report.write_text("no report")
    with rig.daemon("--selftest", str(report)):
        assert re.search(
            r"^arm is refused .*run etd selftest$", rig.run("status").out, re.MULTILINE
        )
        report.unlink()
        assert rig.run("measure").status == 0
        assert rig.run("status", "--json").answer["status"]["arming_refused"] is None
        assert "refused" not in rig.run("status").out


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_nothing_is_noted_in_another_users_folder_and_nothing_is_armed(rig: CommandRig) -> None:
    """Its owner could take the note of a crash away."""
    folder = Path(rig.environment["XDG_STATE_HOME"]) / "etd" / "main"
    folder.mkdir(parents=True)
    os.chown(folder, 65_534, 65_534)
    before_ns = folder.stat().st_mtime_ns
    with rig.daemon("--array", "pad-8"):
        why = rig.run("status", "--json").answer["status"]["arming_refused"]
        assert "cannot be noted" in why
        assert "belongs to somebody else (user 65534)" in why
        refused = rig.run("measure", "--json")
        assert (refused.status, refused.answer["error"]) == (1, "arm_failed")
    assert folder.stat().st_mtime_ns == before_ns, "nor for a moment"


def test_measure_finds_all_electrodes_on_the_fakes_skin(shared: CommandRig) -> None:
    told = shared.run("measure")
    assert told.status == 0
    assert "# 8 touched, . 0 open, ? 0 unknown" in told.out
    answer = shared.run("measure", "--json").answer
    assert answer["contact"] == [True] * 8
    assert all(10_000 < ohm < 500_000 for ohm in answer["resistance_ohm"])
    assert shared.run("status", "--json").answer["status"]["state"] == "SAFE"


def test_monitor_prints_telemetry_as_json_lines(shared: CommandRig) -> None:
    told = shared.run("monitor", "--json", "--seconds", "0.3")
    lines = [json.loads(line) for line in told.out.splitlines()]
    assert told.status == 0
    assert {line["topic"] for line in lines} == {"state"}
    assert lines[0]["report"]["state"] == "SAFE"


def test_monitor_prints_lines_where_there_is_no_terminal(shared: CommandRig) -> None:
    told = shared.run("monitor", "--seconds", "1.3")
    assert told.status == 0
    assert re.match(r"SAFE, ceiling \d+ uA, silent", told.out.splitlines()[1])


def test_a_key_in_the_monitor_says_too_strong(rig: CommandRig) -> None:
    """Pressed on a terminal, by somebody who does not hold the lease."""
    terminal, keys = os.openpty()
    with (
        rig.daemon("--array", "pad-8", "--timeout-factor", "50"),
        Display(
            address=address_of(rig.folder / "run" / "etd" / "main"),
            client="test",
            max_current_ua=2_000,
            width_us=100,
        ) as program,
        program.telemetry("state", timeout_s=WITHIN_S) as reports,
    ):
        program.arm()
        watching = rig.start("monitor", stdin=keys)
        watching.line_with("ARMED", "stdout")
        os.write(terminal, b"x-")
        watching.line_with("said x0.95, press - again for more", "stdout")
        told = next(
            report.felt
            for _, report in reports
            if isinstance(report, StateReport) and report.felt is not None
        )
        watching.signal(signal.SIGINT)
        assert watching.ended().status == 0
    assert (told.answer, told.answers, told.electrodes) == ("too_strong", 1, None)
    assert told.lowers_only
    os.close(terminal)
    os.close(keys)


def test_arm_without_a_lease_says_that_an_application_comes_first(shared: CommandRig) -> None:
    armed = shared.run("arm")
    assert armed.status == 1
    assert "no lease stands" in armed.err


def test_disarm_needs_the_lease_of_somebody(shared: CommandRig) -> None:
    assert "etd stop" in shared.run("disarm").err
    foreign = shared.run("disarm", "--lease", "not-a-lease", "--json")
    assert (foreign.status, foreign.answer["error"]) == (1, "no_lease")


def kill(command: Command, part: str) -> None:
    os.kill(command.children()[part], signal.SIGKILL)


@pytest.mark.parametrize("part", ["engine", "gateway"])
def test_when_one_part_dies_the_other_ends_and_it_says_which(rig: CommandRig, part: str) -> None:
    command = rig.start("run", "--board", "fake")
    command.line()
    parts = list(command.children().values())
    kill(command, part)
    said = command.ended()
    assert said.status == 1
    assert f"the {part} ended (killed by SIGKILL)" in said.err
    wait_for_end(parts)
    assert rig.run("status").status == 3


def test_both_parts_end_when_the_command_is_killed(rig: CommandRig) -> None:
    command = rig.start("run", "--board", "fake")
    command.line()
    parts = list(command.children().values())
    assert len(parts) == 2
    command.signal(signal.SIGKILL)
    wait_for_end(parts)


def test_a_failing_part_ends_the_command_with_its_own_status(rig: CommandRig) -> None:
    absent = rig.run("run", "--board", "fake", "--board-socket", str(rig.folder / "none.sock"))
    assert absent.status == 3
    assert "no board process answers" in absent.err


def test_without_a_configuration_it_teaches_the_fake(rig: CommandRig) -> None:
    refused = rig.run("run", "--config", str(rig.folder / "none.toml"))
    assert refused.status == 1
    assert "etd run --board fake" in refused.err


@pytest.mark.parametrize("verb", ["status", "arm", "clear", "measure", "monitor", "stop"])
def test_without_a_daemon_the_status_is_3(rig: CommandRig, verb: str) -> None:
    asked = rig.run(verb, "--name", "nobody", "--json")
    assert asked.status == 3
    assert asked.answer["ok"] is False


def test_play_waits_for_the_operator_and_a_killed_client_leaves_silence(shared: CommandRig) -> None:
    pattern = shared.folder / "long.json"
    pattern.write_text(
        '{"etd_pattern": 1, "electrodes": 8, '
        '"frames": [{"duration_ms": 600000, "active": [3], "rate_hz": 40}]}'
    )
    playing = shared.start("play", str(pattern))
    playing.line_with("waiting for the operator")
    armed = shared.run("arm", "--json").answer
    assert armed["holder"] == "etd play long.json"
    name = "fake-fingertip-pad-8"
    told = name, digest_of(load_calibration(find("calibrations", name)))
    assert [(it["name"], it["digest"]) for it in armed["calibrations"]] == [told]
    assert shared.run("status", "--json").answer["status"]["calibrations"] == armed["calibrations"]
    wait_for_state(shared, "ARMED")
    playing.signal(signal.SIGKILL)
    # The lease lapses after a second; `state` is repeated each second.
    wait_for_state(shared, "SAFE")
    status = shared.run("status", "--json").answer["status"]
    assert status["holder"] is None
    assert status["last_disarm"] == "lapsed"


def test_of_two_that_start_at_once_one_runs_and_the_other_ends(rig: CommandRig) -> None:
    both = [rig.start("run", "--board", "fake", "--array", "pad-8") for _ in range(2)]
    first = next(one for one in both if "is ready" in one.line())
    (second,) = (one for one in both if one is not first)
    assert "already" in second.ended().err
    assert rig.run("status").status == 0
    first.signal(signal.SIGTERM)
    assert first.ended().status == 0


def test_where_another_command_has_only_begun_to_start_both_parts_none_is_started(
    rig: CommandRig,
) -> None:
    """Of two that start at once each could get one part, and both would end."""
    folder = rig.folder / "d"
    folder.mkdir(mode=0o700)
    with contextlib.closing(NameLock(folder, "main", BOTH_PARTS)):
        refused = rig.run("run", "--board", "fake", "--array", "pad-8", "--folder", str(folder))
    assert "already running" in refused.err
    assert f"process {os.getpid()} holds" in refused.err
    assert [path.name for path in folder.iterdir()] == ["run.lock"]


def test_a_stop_ends_what_is_being_played(rig: CommandRig) -> None:
    pattern = rig.folder / "long.json"
    pattern.write_text(
        '{"etd_pattern": 1, "electrodes": 8, '
        '"frames": [{"duration_ms": 600000, "active": [3], "rate_hz": 40}]}'
    )
    with rig.daemon("--array", "pad-8"):
        playing = rig.start("play", str(pattern), "--arm")
        wait_for_state(rig, "ARMED")
        assert rig.run("stop").status == 0
        said = playing.ended()
        assert said.status == 1
        assert f"halted by stop ('etd stop' (user {os.getuid()}): asked to stop)" in said.err


def test_the_log_names_who_armed_stopped_and_cleared(rig: CommandRig) -> None:
    pattern = rig.folder / "long.json"
    pattern.write_text(
        '{"etd_pattern": 1, "electrodes": 8, '
        '"frames": [{"duration_ms": 600000, "active": [3], "rate_hz": 40}]}'
    )
    me = f"user {os.getuid()}"
    with rig.daemon("--array", "pad-8") as running:
        playing = rig.start("play", str(pattern), "--arm")
        wait_for_state(rig, "ARMED")
        assert rig.run("stop").status == 0
        assert rig.run("clear").status == 0
        assert playing.ended().status == 1
        running.line_with(f"ARMED by {me}: the lease of 'etd play long.json' ({me})")
        running.line_with(f"HALTED by stop ('etd stop' ({me})): asked to stop")
        running.line_with(f"SAFE: the halt was cleared by {me}")


def test_somebody_elses_lease_is_respected(rig: CommandRig) -> None:
    pattern = rig.folder / "short.json"
    pattern.write_text(
        '{"etd_pattern": 1, "electrodes": 8, "frames": [{"duration_ms": 10, "active": [3]}]}'
    )
    with rig.daemon("--array", "pad-8"):
        holding = rig.start("play", str(pattern))
        holding.line_with("waiting for the operator")
        refused = rig.run("measure", "--json")
        assert (refused.status, refused.answer["error"]) == (1, "other_lease")
        assert "etd play short.json" in refused.answer["reason"]
