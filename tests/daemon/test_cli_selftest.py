"""`etd selftest`: what it prints, where it keeps the report, its exit status."""

from __future__ import annotations

import contextlib
import json
import shlex
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from etd import cli
from etd.cli import selftest_ending
from etd.cli.selftest_table import Table
from etd.files.as_started import as_started
from etd.files.configuration import fake_config
from etd.files.exclusive import ENGINE, NameLock
from etd.files.paths import board_as_started_file
from etd.files.resources import find
from etd.selftest.report import load
from etd.selftest.run import STAGES
from etd.selftest.subject import subject_of
from etd_hal.backend import Bench
from etd_hal.board import Board
from etd_hal.boardfile import BoardFile, MachineFile
from etd_hal.compose import open_fake_bench
from etd_hal.errors import HardwareMissing
from etd_hal.fake.operator import FakeOperator

pytestmark = pytest.mark.slow

FULL = ["selftest", "--board", "fake", "--array", "grid-4x4"]
ONE_LOAD = ["--dummy-load", "47000", "--load-electrodes", "0,5"]
LOAD = [*ONE_LOAD, "--second-load", "10000"]


@pytest.fixture(autouse=True)
def state(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path))
    configuration = subject_of(fake_config(None, "grid-4x4"), "fake", "").configuration
    return tmp_path / "etd" / "main" / f"selftest-fake-{configuration}.json"


def test_all_passed_is_status_0_and_absent_guards_are_named(
    capsys: pytest.CaptureFixture[str], state: Path
) -> None:
    assert cli.main([*FULL, *LOAD]) == 0
    told = capsys.readouterr().out
    for number, (name, what) in enumerate(STAGES, start=1):
        assert f"{number}/{len(STAGES)} {name}: {what}" in told
    assert "absent guards: emergency_stop, wearer_stop, hv_enable" in told
    assert f"kajimoto-hv507 on pi4 (backend: fake): passed; report in {state}" in told


def test_a_real_boards_file_is_kept_for_safe_once_its_lines_are_held(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """A self-test that is killed leaves lines that it has moved; one that is refused moves none."""
    settings = tmp_path / "main.toml"
    settings.write_text(
        'backend = "linux"\nboard = "kajimoto-hv507"\nmachine = "pi4"\narray = "grid-4x4"\n'
        'body_site = "fingertip"\naccept_absent_guards = []\noperators = []\n'
        '[engine]\ncore = "any"\npriority = "none"\n'
    )
    asked = ["selftest", "--config", str(settings), "--json"]
    is_busy = True

    def opened(board: BoardFile, _: MachineFile) -> Bench:
        if is_busy:
            raise HardwareMissing(("the lines are held",))
        return open_fake_bench(board, electrodes=range(16))

    monkeypatch.setattr("etd.cli.selftest.open_linux_bench", opened)
    assert cli.main(asked) == 3
    assert as_started("main", None, None) is None

    is_busy = False
    kept = board_as_started_file("main", "linux", None).parent
    kept.mkdir(parents=True, exist_ok=True)
    with contextlib.closing(NameLock(kept, "main", ENGINE["linux"])):
        assert cli.main(asked) == 1, "an engine has other lines, and its own file's copy"
    assert as_started("main", None, None) is None

    cli.main(asked)
    assert as_started("main", find("boards", "kajimoto-hv507"), None) is not None


def test_a_skip_is_status_1_and_says_what_to_do(
    capsys: pytest.CaptureFixture[str], state: Path
) -> None:
    assert cli.main(FULL) == 1
    told = capsys.readouterr().out
    assert "SKIP table: truth_table, probe: load_agrees, probe: leak" in told
    assert "     --dummy-load OHM --second-load OHM --load-electrodes A,B\n" in told
    assert "NOT PASSED: 16 failed or were skipped" in told
    report = load(state)
    assert report is not None
    assert not report.passed


@pytest.mark.parametrize("board", ["kajimoto-hv507", "reference-hv507", "feetthrough-relay"])
def test_a_fake_that_did_not_pass_is_told_the_command_that_passes(
    board: str, capsys: pytest.CaptureFixture[str]
) -> None:
    test = ["selftest", "--board", f"fake:{board}", "--array", "pad-8", "--json"]
    assert cli.main(test) == 1
    refused = json.loads(capsys.readouterr().out)["arming_refused"]
    command = refused[refused.index("etd selftest") : refused.index(", or remove")]
    assert cli.main([*shlex.split(command)[1:], "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["arming_refused"] is None


def test_with_json_the_answer_is_one_object_and_prompts_go_elsewhere(
    capsys: pytest.CaptureFixture[str], state: Path, tmp_path: Path
) -> None:
    kept = tmp_path / "board.json"
    assert cli.main([*FULL, *LOAD, "--json", "--report", str(kept)]) == 0
    told = capsys.readouterr()
    answer = json.loads(told.out)
    assert (answer["ok"], answer["kept"]) == (True, str(state))
    assert answer["report"]["checks"][0]["stage"] == "machine"
    assert "47000 ohm between electrodes 0 and 15" in told.err
    assert "10000 ohm between electrodes 0 and 15" in told.err
    assert kept.read_bytes() == state.read_bytes()


def test_every_guard_of_the_reference_board_is_proved(capsys: pytest.CaptureFixture[str]) -> None:
    arguments = ["selftest", "--board", "fake:reference-hv507", "--array", "grid-4x4", *LOAD]
    assert cli.main([*arguments, "--one-shot-us", "250"]) == 0
    told = capsys.readouterr().out
    assert "-> press the emergency stop, and release it" in told
    assert "absent" not in told


@pytest.mark.parametrize(
    "arguments",
    [
        ["--dummy-load", "47000"],
        ["--load-electrodes", "0,1"],
        ["--dummy-load", "9999", "--load-electrodes", "0,1"],
        ["--dummy-load", "100001", "--load-electrodes", "0,1"],
        ["--dummy-load", "47k", "--load-electrodes", "0,1"],
        ["--dummy-load", "47000", "--load-electrodes", "1,1"],
        ["--dummy-load", "47000", "--load-electrodes", "0,00"],
        ["--dummy-load", "47000", "--load-electrodes", "1"],
        ["--dummy-load", "47000", "--load-electrodes", "0,16"],
        ["--second-load", "10000"],
        [*ONE_LOAD, "--second-load", "31334"],
        [*ONE_LOAD, "--second-load", "70499"],
        [*ONE_LOAD, "--second-load", "9999"],
        ["--one-shot-us", "0"],
        ["--one-shot-us", "-5"],
        ["--one-shot-us", "250"],
    ],
)
def test_what_cannot_be_is_used_wrongly(
    arguments: list[str], capsys: pytest.CaptureFixture[str], state: Path
) -> None:
    for asked in ([], ["--json"]):
        with pytest.raises(SystemExit) as ended:
            cli.main([*FULL, *arguments, *asked])
        assert ended.value.code == 2
        assert not state.exists()
    answer = json.loads(capsys.readouterr().out)
    assert (answer["ok"], answer["error"]) == (False, "used_wrongly")
    assert any(argument in answer["reason"] for argument in arguments)


def test_with_one_load_the_second_walk_is_a_skip_that_says_what_to_add(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main([*FULL, *ONE_LOAD]) == 1
    told = capsys.readouterr().out
    assert (
        "SKIP switches: second_load, switches: every_switch_again\n     --second-load OHM" in told
    )


def test_a_touch_in_the_wrong_place_is_told_live(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    clip = FakeOperator.clip

    def clip_wrongly(operator: FakeOperator, load_ohm: int, first: int, second: int) -> None:
        clip(operator, load_ohm, first, 9 if second == 7 else second)

    monkeypatch.setattr(FakeOperator, "clip", clip_wrongly)
    assert cli.main([*FULL, *LOAD]) == 1
    asked, told = capsys.readouterr().out.split("-> connect 47000 ohm between electrodes 0 and 7")
    assert "instead of" not in asked
    said = "-> the resistor was found at electrode 9 instead of 7: move it, or check the wiring\n"
    assert told.count(said) == 1
    assert told.index(said) < told.index("fail   every_switch ")


def refused(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> str:
    """Why a use is wrong, told to people and to programs alike, and that nothing was tested."""
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    assert ended.value.code == 2
    told = capsys.readouterr()
    assert told.out == ""
    with pytest.raises(SystemExit) as ended:
        cli.main([*arguments, "--json"])
    assert ended.value.code == 2
    answer = json.loads(capsys.readouterr().out)
    assert (answer["ok"], answer["error"]) == (False, "used_wrongly")
    reason: str = answer["reason"].removeprefix("etd selftest: ")
    assert reason in told.err
    return reason


def test_a_report_is_never_written_over_and_needs_a_folder(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = tmp_path / "study.json"
    assert cli.main([*FULL, *LOAD, "--report", str(kept)]) == 0
    capsys.readouterr()
    first = kept.read_bytes()
    assert "choose another name" in refused([*FULL, *LOAD, "--report", str(kept)], capsys)
    assert kept.read_bytes() == first
    (tmp_path / "nowhere.json").symlink_to(tmp_path / "nothing")
    for there in (tmp_path, tmp_path / "nowhere.json"):
        reason = refused([*FULL, *LOAD, "--report", str(there)], capsys)
        assert "it exists" in reason
    for where in ("no-folder/r.json", "study.json/r.json"):
        reason = refused([*FULL, *LOAD, "--report", str(tmp_path / where)], capsys)
        assert "there is no such folder" in reason


@pytest.mark.parametrize("letters", [250, 300])
def test_a_name_that_is_too_long_is_used_wrongly(
    letters: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    reason = refused([*FULL, *LOAD, "--report", str(tmp_path / ("r" * letters))], capsys)
    assert "name too long" in reason


def test_a_load_that_hides_the_top_is_refused_with_the_largest_one(
    capsys: pytest.CaptureFixture[str],
) -> None:
    reason = refused([*FULL, "--dummy-load", "69073", "--load-electrodes", "0,5"], capsys)
    assert "8000 uA into 69073 ohm" in reason
    assert "at most 69069 ohm" in reason


def test_a_copy_that_cannot_be_written_is_told_before_anything_is_tested(
    capsys: pytest.CaptureFixture[str],
) -> None:
    reason = refused([*FULL, *LOAD, "--report", "/proc/r.json"], capsys)
    assert "the folder is not writable" in reason


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--config", "/nowhere/etd.toml"], "there is no such configuration"),
        (["--board", "fake:no-such-board"], "no-such-board"),
        (["--board", "fake", "--name", "a/b"], "a/b"),
        (["--board", "fake", "--array", "no-such-array"], "no-such-array"),
    ],
)
def test_what_is_not_there_is_used_wrongly(
    arguments: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert said in refused(["selftest", *arguments], capsys)


def test_one_fake_that_did_not_pass_is_not_another_one(
    state: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([*FULL, *LOAD]) == 0
    assert cli.main(["selftest", "--board", "fake", "--array", "pad-8"]) == 1
    assert "NOT PASSED" in capsys.readouterr().out
    report = load(state)
    assert report is not None
    assert report.passed


def test_hardware_that_is_not_there_is_status_3(capsys: pytest.CaptureFixture[str]) -> None:
    shipped = Path(__file__).parents[2] / "config" / "etd.toml"
    assert cli.main(["selftest", "--config", str(shipped)]) == 3
    told = capsys.readouterr().err
    assert "hardware cannot be used:\n  - " in told, "each thing that is missing has its line"
    assert "\\n" not in told


def test_a_pass_does_not_outlive_a_later_test_that_was_cut_short(
    state: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert cli.main([*FULL, *LOAD]) == 0

    def cut(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(Table, "stage", cut)
    assert cli.main([*FULL, *LOAD]) == 130
    report = load(state)
    assert report is not None
    assert (report.passed, report.checks) == (False, ())


def test_a_pass_is_not_given_up_for_a_copy_that_cannot_be_written(
    state: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert cli.main([*FULL, *LOAD]) == 0
    capsys.readouterr()
    refused([*FULL, *LOAD, "--report", "/proc/r.json"], capsys)
    report = load(state)
    assert report is not None
    assert report.passed


def test_where_the_report_cannot_be_kept_nothing_is_tested(
    state: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    state.parent.parent.write_text("a file where the folder should be")
    assert "this is no folder" in refused([*FULL, *LOAD], capsys)


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGHUP])
def test_being_asked_to_end_makes_the_board_safe_first(
    monkeypatch: pytest.MonkeyPatch, ending: signal.Signals
) -> None:
    made_safe: list[str] = []
    safe_off = Board.safe_off

    def seen(board: Board) -> tuple[str, ...]:
        made_safe.append("safe")
        return safe_off(board)

    def end_at_probe(_table: Table, name: str, _what: str) -> None:
        if name == "probe":
            made_safe.clear()
            signal.raise_signal(ending)

    monkeypatch.setattr(Board, "safe_off", seen)
    monkeypatch.setattr(Table, "stage", end_at_probe)
    assert cli.main([*FULL, *LOAD]) == 130
    assert made_safe == ["safe"]


#: A self-test that says when it is at its probes, and when it is half way to the safe state; there
#: it waits for a line.
_HALF_WAY = """
import sys
from etd import cli
from etd.cli.selftest_table import Table
from etd_hal.board import Board

zero_dac, is_asked_to_end = Board._zero_dac, False

def half_way(board):
    if is_asked_to_end:
        print("half way", flush=True)
        sys.stdin.readline()
    zero_dac(board)

def wait_in_probe(table, name, what):
    global is_asked_to_end
    if name == "probe":
        is_asked_to_end = True
        print("probing", flush=True)
        sys.stdin.readline()

Board._zero_dac, Table.stage = half_way, wait_in_probe
sys.exit(cli.main(sys.argv[1:]))
"""


@pytest.mark.parametrize(
    "ending", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT, signal.SIGTSTP]
)
def test_no_further_signal_breaks_off_the_way_to_the_safe_state(ending: signal.Signals) -> None:
    told = subprocess.PIPE
    process = subprocess.Popen(
        [sys.executable, "-c", _HALF_WAY, *FULL, *LOAD],
        stdin=told,
        stdout=told,
        stderr=told,
        text=True,
    )
    try:
        assert process.stdout is not None
        assert "probing\n" in iter(process.stdout.readline, "")
        process.send_signal(ending)
        assert "half way\n" in iter(process.stdout.readline, "")
        further = {signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGQUIT} - {ending}
        for signals in further:
            process.send_signal(signals)
        said = process.communicate("go on\n", timeout=300.0)[1]
    finally:
        process.kill()
        process.wait()
    assert process.returncode == 130
    assert said == (
        "etd selftest: interrupted; the board is in its safe state\n"
        f"etd selftest: {len(further)} more signals were ignored\n"
    )


def test_a_way_to_the_safe_state_that_hangs_is_broken_off_in_time_and_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(selftest_ending, "MOST_S", 0.01)

    def hang() -> None:
        try:
            signal.raise_signal(signal.SIGINT)
        except KeyboardInterrupt:
            signal.raise_signal(signal.SIGTERM)
            while True:
                signal.pause()

    with pytest.raises(KeyboardInterrupt), selftest_ending.broken_off_once():
        hang()
    assert "cut the supply by hand" in capsys.readouterr().err
    assert signal.getsignal(signal.SIGINT) is signal.default_int_handler
