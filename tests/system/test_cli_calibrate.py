"""`etd calibrate` as a process: keys on a terminal, a stop, and going on with what was found."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator

import msgspec
import pytest

from calibrate_scenes import ROW
from command_rig import WITHIN_S, CommandRig, Said, command_rig, is_ready
from etd.calibrate.progress import Progress, save_progress
from etd.cli import USED_WRONGLY
from etd.files import resources
from etd.files.calibration import load_calibration, to_toml
from etd.protocol.calibration import ElectrodeLimits
from terminal_rig import SEED, AtTerminal

pytestmark = pytest.mark.slow


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


OF_LIMITS = ("--method", "limits", "--seed", str(SEED))
ON_FAKE = ("--board", "fake", "--array", "pad-8")
#: As progress on it says so.
MADE_ON = "kajimoto-hv507 (fake)"
#: Clients wait for two seconds.
HELD_UP_S = "3.5"
ARGUMENTS = ("calibrate", "P01", "--max-current-ua", "2000", "--board", "fake", "--array", "pad-8",
             *OF_LIMITS)  # fmt: skip


def test_keys_answer_space_stops_and_the_same_command_goes_on(rig: CommandRig) -> None:
    at = AtTerminal(rig, *ARGUMENTS)
    try:
        # A coarse ascent, seven fine ones (they lie apart), comfortable, more accepted, too strong;
        # a stop on the next electrode.
        at.answer("nf" * 8 + "ccfft" + "ff" + " ")
        said = at.command.ended()
    finally:
        at.close()
    assert said.status == 1, said.err
    assert "halted; the results are saved; it was stopped at a presentation: " in said.err
    kept = list(rig.folder.glob("state/etd/fake/calibrating/P01.json"))
    assert len(kept) == 1
    (trials,) = rig.folder.glob("P01_pad-8_*_trials.tsv")
    assert f"trials: {trials.name}" in said.err
    _, *rows = trials.read_text().splitlines()
    assert len(rows) == 29, "four were silent, and one was asked about twice"
    assert "\tstop\t" in rows[-1]

    at = AtTerminal(rig, *ARGUMENTS)
    try:
        at.command.line_with("It was stopped at or after this one, the last time", "stdout")
        at.press(b"f")
        at.command.line_with("Not too strong. Was it so?", "stdout")
        at.press(b"f")
        at.command.line_with("How strong was it", "stdout")
        at.press(b"q")
        paused = at.command.ended()
    finally:
        at.close()
    assert "paused; the results are saved: the same command continues" in paused.err

    out = rig.folder / "P01.toml"
    others = "1,2,3,4,5,6,7"
    done = rig.run(*ARGUMENTS, "--leave-out", others, "--out", str(out), "--json")
    assert done.status == 0, done.err
    assert "continuing: electrodes done so far: 1" in done.err
    assert done.answer["presentations"] >= 17
    assert done.answer["too_strong"] == [0]
    assert done.answer["trials"] is None, "nothing was presented this time"
    made = load_calibration(out)
    assert [limits.felt for limits in made.electrode] == [True] + [False] * 7
    assert 140 <= made.electrode[0].threshold_ua <= 200
    assert made.electrode[0].cap_ua > made.electrode[0].comfortable_ua
    assert not kept[0].exists()


def test_a_daemon_that_is_not_armed_is_waited_for(rig: CommandRig) -> None:
    with rig.daemon("--array", "pad-8"):
        at = AtTerminal(rig, "calibrate", "P01", "--max-current-ua", "2000", *OF_LIMITS)
        try:
            assert "etd arm" in at.command.line_with("waiting for the operator")
            assert rig.run("arm").status == 0
            at.answer("q")
            said = at.command.ended()
        finally:
            at.close()
        assert "paused; no electrode has a result yet: the same command starts again" in said.err
        assert rig.run("status", "--json").answer["status"]["state"] == "SAFE"
        missing = rig.run("calibrate", "P02", "--method", "equalize", "--baseline", "P01")
        assert missing.status == 1
        assert "not_found" in missing.err or "no calibration" in missing.err


@pytest.mark.parametrize("is_running", [False, True])
def test_a_private_fake_finds_the_calibrations_of_the_daemon(
    rig: CommandRig, is_running: bool
) -> None:
    shipped = resources.find("calibrations", "fake-fingertip-pad-8")
    made = msgspec.structs.replace(load_calibration(shipped), participant="P01")
    stored = rig.folder / "state" / "etd" / "main" / "calibrations" / "P01.toml"
    stored.parent.mkdir(parents=True)
    stored.write_text(to_toml(made))
    equalize = ("calibrate", "P01", "--method", "equalize", "--board", "fake")
    with rig.daemon("--array", "pad-8") if is_running else contextlib.nullcontext():
        at = AtTerminal(rig, *equalize, "--baseline", "P01")
        try:
            at.answer("q")
            said = at.command.ended()
        finally:
            at.close()
        # The reference has one at once, if its turn is the first.
        assert "paused; " in said.err
    if is_running:
        return
    missing = rig.run(*equalize, "--baseline", "P07")
    assert missing.status == 1
    assert "there is no calibration 'P07': neither has the daemon 'main' one" in missing.err
    played = rig.run("play", pattern_of_8(rig), "--board", "fake", "--calibration", "P01")
    assert played.status == 0, played.err


def pattern_of_8(rig: CommandRig) -> str:
    path = rig.folder / "one.json"
    frames = [{"duration_ms": 50, "active": [0]}]
    path.write_text(json.dumps({"etd_pattern": 1, "electrodes": 8, "frames": frames}))
    return str(path)


def test_what_was_too_strong_is_kept_though_the_command_is_killed(rig: CommandRig) -> None:
    at = AtTerminal(rig, *ARGUMENTS)
    try:
        at.answer("nt")
        at.command.line_with("How strong was it", "stdout")
    finally:
        at.close()
    at = AtTerminal(rig, *ARGUMENTS)
    try:
        at.answer("q")
        said = at.command.ended()
    finally:
        at.close()
    assert "currents that were too strong are not repeated: electrodes 0" in said.err
    assert "what was too strong is saved; it was stopped at a presentation: the same" in said.err

    (kept,) = rig.folder.glob("state/etd/fake/calibrating/*.json")
    before = json.loads(kept.read_text())
    # A lower limit may be the answer to it.
    lower = ("--max-current-ua", "1500")
    for how in (lower, ("--restart",), ("--restart", *lower)):
        at = AtTerminal(rig, *ARGUMENTS, *how)
        try:
            at.command.line_with("It was stopped at or after this one, the last time", "stdout")
            at.press(b"q")
            paused = at.command.ended()
        finally:
            at.close()
        assert ("kept of the saved progress: what was too" in paused.err) == ("--restart" in how)
        after = json.loads(kept.read_text())
        assert (after["lowered_ua"], after["in_doubt"]) == (
            before["lowered_ua"],
            before["in_doubt"],
        )

    at = AtTerminal(rig, *ARGUMENTS, "--restart", "--forget-too-strong")
    try:
        at.answer("q")
        anew = at.command.ended()
    finally:
        at.close()
    assert "paused; no electrode has a result yet: the same command starts again" in anew.err
    assert not json.loads(kept.read_text()).get("lowered_ua"), "it is forgotten"
    alone = rig.run(*ARGUMENTS, "--forget-too-strong")
    assert "--forget-too-strong goes with --restart" in alone.err


def test_what_goes_on_with_it_is_the_command_without_restart(rig: CommandRig) -> None:
    at = AtTerminal(rig, *ARGUMENTS, "--restart")
    try:
        at.answer("nf" * 8 + "cc" + "f" * 7 + "q")
        said = at.command.ended()
    finally:
        at.close()
    assert "the results are saved: the same command without --restart continues" in said.err


def test_a_fit_that_began_anew_goes_on_with_the_command_without_restart(rig: CommandRig) -> None:
    """With it, what was asked so far would be discarded."""
    at = AtTerminal(
        rig,
        *("calibrate", "fake", "--as", "fake-fingertip-pad-8", "--fit", "--restart"),
        *("--max-current-ua", "2000", "--board", "fake", "--array", "pad-8", "--seed", str(SEED)),
    )
    try:
        assert at.command.line() == "", "each state stands apart"
        at.command.line_with("Then any key", "stdout")
        at.press(b"q")
        said = at.command.ended()
    finally:
        at.close()
    assert said.status == 1
    assert "states that are over: 0: the same command without --restart continues" in said.err


@pytest.mark.parametrize(
    ("key", "said", "state"), [(b"q", "paused", "SAFE"), (b" ", "stopped: ", "HALTED")]
)
def test_the_keys_that_end_it_are_heard_while_the_operator_is_waited_for(
    rig: CommandRig, key: bytes, said: str, state: str
) -> None:
    with rig.daemon("--array", "pad-8"):
        at = AtTerminal(rig, "calibrate", "P01", "--max-current-ua", "2000", *OF_LIMITS)
        try:
            assert "SPACE STOP   q pause" in at.command.line_with("waiting for the operator")
            at.press(key)
            ended = at.command.ended()
        finally:
            at.close()
        assert ended.status == 1
        assert f"etd: {said}" in ended.err
        assert rig.run("status", "--json").answer["status"]["state"] == state


def test_a_whole_array_too_strong_is_told_with_what_is_left_of_the_levels(rig: CommandRig) -> None:
    """Half of level 1 was accepted, the step above it was not."""
    conditions = msgspec.structs.replace(ROW, array="pad-8", electrodes=8, cap_ua=2_000)
    limits = ElectrodeLimits(threshold_ua=500, comfortable_ua=1_600, cap_ua=1_900)
    found = dict.fromkeys(range(8), limits)
    progress = Progress(conditions=conditions, seed=SEED, found=found, made_on=MADE_ON)
    save_progress(rig.folder / "state" / "etd" / "fake" / "calibrating" / "P01.json", progress)
    out = rig.folder / "P01.toml"
    at = AtTerminal(rig, *ARGUMENTS, "--out", str(out))
    try:
        for key in (b"f", b"t", b"t"):
            at.command.line_with("SPACE STOP", "stdout")
            at.press(key)
        said = at.command.ended()
    finally:
        at.close()
    assert said.status == 0, said.err
    assert "all electrodes at once were too strong" in said.err
    assert "their levels and caps are 50% of what each was alone" in said.err
    made = load_calibration(out)
    assert {(one.comfortable_ua, one.cap_ua) for one in made.electrode} == {(800, 950)}
    assert made.is_whole_accepted


def test_an_electrode_that_is_left_out_is_so_though_it_has_a_result(rig: CommandRig) -> None:
    """It may be left out because it hurts; as a return it gets no more than was accepted there."""
    conditions = msgspec.structs.replace(ROW, array="pad-8", electrodes=8, cap_ua=2_000)
    limits = ElectrodeLimits(threshold_ua=500, comfortable_ua=1_600, cap_ua=1_900)
    tender = ElectrodeLimits(threshold_ua=200, comfortable_ua=300, cap_ua=400)
    found = {**dict.fromkeys(range(8), limits), 3: tender}
    progress = Progress(
        conditions=conditions, seed=SEED, found=found, is_whole_accepted=True, made_on=MADE_ON
    )
    save_progress(rig.folder / "state" / "etd" / "fake" / "calibrating" / "P01.json", progress)
    out = rig.folder / "P01.toml"
    said = rig.run(*ARGUMENTS, "--leave-out", "3", "--out", str(out), "--json")
    assert said.status == 0, said.err
    stored = load_calibration(out)
    assert stored.modelled is True
    assert said.answer["calibration"] == json.loads(msgspec.json.encode(stored))
    made = stored.electrode
    assert made[3] == ElectrodeLimits(threshold_ua=400, comfortable_ua=400, cap_ua=400, felt=False)
    assert {one.cap_ua for one in made if one.felt} == {1_900}


def test_what_was_found_on_another_board_is_not_gone_on_with(rig: CommandRig) -> None:
    """On a fake one of the same name, or on one that is not known."""
    conditions = msgspec.structs.replace(ROW, array="pad-8", electrodes=8, cap_ua=2_000)
    path = rig.folder / "state" / "etd" / "fake" / "calibrating" / "P01.json"
    for made_on in ("kajimoto-hv507 (linux)", None):
        save_progress(path, Progress(conditions=conditions, seed=SEED, made_on=made_on))
        said = rig.run(*ARGUMENTS)
        assert said.status == USED_WRONGLY, said.err
        assert f"is of {made_on or 'a board that it does not name'}, this board is" in said.err


def test_of_two_daemons_of_one_name_neither_goes_on_with_what_is_of_the_other(
    rig: CommandRig,
) -> None:
    """Nor does a second command beside the first: each would undo what was too strong for it."""
    folders = [str(rig.folder / name) for name in ("d", "e")]
    asked = ("calibrate", "P03", "--max-current-ua", "2000", "--arm", *OF_LIMITS)
    with (
        rig.daemon("--array", "pad-8", "--folder", folders[0]),
        rig.daemon("--array", "pad-8", "--folder", folders[1]),
    ):
        at = AtTerminal(rig, *asked, "--folder", folders[0])
        try:
            at.answer("t")
            beside = rig.run(*asked, "--folder", folders[1])
            at.answer("q")
            at.command.ended()
        finally:
            at.close()
        there = rig.run(*asked, "--folder", folders[1])
    assert f"process {at.process.pid} calibrates P03" in beside.err
    assert f"daemon ipc://{folders[0]}/control.sock, this board is" in there.err
    assert (beside.status, there.status) == (USED_WRONGLY, USED_WRONGLY)
    (kept,) = rig.folder.glob("state/etd/main/calibrating/P03.json")
    assert json.loads(kept.read_text())["lowered_ua"] == {"0": 181}


def ended_at_a_question(rig: CommandRig, by: Callable[[AtTerminal], object]) -> Said:
    """At the second one, on a daemon of the operator's: it is halted, and asked about next time."""
    with rig.daemon("--array", "pad-8"):
        at = AtTerminal(rig, "calibrate", "P01", "--max-current-ua", "2000", *OF_LIMITS)
        try:
            at.command.line_with("waiting for the operator")
            assert rig.run("arm").status == 0
            at.answer("n")
            at.command.line_with("How strong was it", "stdout")
            by(at)
            said = at.command.ended()
        finally:
            at.close()
        assert "halted, until `etd clear`; no electrode has a result yet; it was" in said.err
        assert "the same command asks first whether that was too strong" in said.err
        assert rig.run("status", "--json").answer["status"]["state"] == "HALTED"
    return said


@pytest.mark.parametrize("ending", [signal.SIGHUP, signal.SIGTERM])
def test_a_terminal_that_goes_away_is_a_stop(rig: CommandRig, ending: signal.Signals) -> None:
    said = ended_at_a_question(rig, lambda at: at.process.send_signal(ending))
    assert said.status == 128 + ending, said.err


def test_too_strong_by_another_program_stops_it_and_is_asked_about(rig: CommandRig) -> None:
    def another_program(_: AtTerminal) -> None:
        says = "import etd; etd.Display(max_current_ua=100, width_us=50).felt('too_strong')"
        program = [sys.executable, "-c", says]
        subprocess.run(program, env=rig.environment, check=True, timeout=WITHIN_S)

    said = ended_at_a_question(rig, another_program)
    assert said.status == 1, said.err
    assert "stopped (too strong, by a button, a monitor or another program)" in said.err


def test_a_stop_is_told_as_json_where_the_answer_is_to_be(rig: CommandRig) -> None:
    at = AtTerminal(rig, *ARGUMENTS, "--json")
    try:
        at.command.line_with("8 electrodes to do")
        at.press(b" ")
        said = at.command.ended()
    finally:
        at.close()
    assert said.status == 1, said.err
    assert (said.answer["ok"], said.answer["error"]) == (False, "stopped")
    assert "no electrode has a result yet: the same command starts again" in said.answer["reason"]


def test_a_simulated_person_is_waited_for_with_a_bar_on_the_terminal(rig: CommandRig) -> None:
    terminal, theirs = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "etd", *ARGUMENTS, "--answers", "simulated"],
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=theirs,
        env=rig.environment,
        cwd=rig.folder,
    )
    os.close(theirs)
    try:
        drawn = drawn_until(terminal, "0 of 8 electrodes, 2 presentations")
        process.send_signal(signal.SIGINT)
        out, _ = process.communicate(timeout=WITHIN_S)
    finally:
        process.kill()
        process.wait(WITHIN_S)
    assert "method limits: 8 electrodes to do, at least half a minute each" in drawn
    assert "0 of 8 electrodes, 1 presentations" in drawn
    assert "no electrode has a result yet" in drawn_until(terminal, "the same command")
    assert (process.returncode, out) == (130, b"")
    os.close(terminal)


def drawn_until(terminal: int, text: str) -> str:
    """What comes there up to this, colors and all."""
    drawn = ""
    while text not in drawn:
        assert is_ready(terminal), f"{text!r} was not drawn, but {drawn!r}"
        drawn += os.read(terminal, 65_536).decode(errors="replace")
    return drawn


@pytest.mark.parametrize(("asked", "side"), [("0", "low"), ("49", "low"), ("3001", "high")])
def test_a_limit_that_is_not_allowed_is_refused_with_the_bounds_of_this_site(
    rig: CommandRig, asked: str, side: str
) -> None:
    told = rig.run("calibrate", "P01", "--max-current-ua", asked, *ON_FAKE)
    assert told.status == 2
    assert f"{asked} uA is too {side}; 50 to 3000 uA are allowed" in told.err
    assert "10000" not in told.err


def test_its_own_daemon_may_be_held_up_longer_than_clients_wait_for_another(
    rig: CommandRig,
) -> None:
    """On a busy machine, where the daemon's own time-outs are longer too."""
    at = AtTerminal(rig, *ARGUMENTS)
    try:
        at.answer("nn")
        gateway = at.command.children()["gateway"]
        os.kill(gateway, signal.SIGSTOP)
        subprocess.run(["sleep", HELD_UP_S], check=True)
        os.kill(gateway, signal.SIGCONT)
        at.answer("n ")
        said = at.command.ended()
    finally:
        at.close()
    assert "no answer" not in said.err
    assert "stopped: the daemon is halted" in said.err
