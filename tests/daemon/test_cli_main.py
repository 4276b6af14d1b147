"""The command as a whole: its verbs, its exit statuses, and what it may import.

Owns: nothing of any verb.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from importlib.metadata import entry_points
from pathlib import Path

import pytest

from etd import cli
from etd.cli.stop import Stopped, lines_of
from etd.protocol.errors import (
    AlreadyRunning,
    BoardFault,
    BusError,
    DaemonGone,
    EtdError,
    FileError,
    HardwareMissing,
    PartEnded,
    PatternError,
    Refused,
)


def test_the_help_screen_names_every_verb_and_an_example(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["--help"])
    told = capsys.readouterr().out
    assert ended.value.code == 0
    firsts = [line.split()[0] for line in told.splitlines() if line.startswith("    ")]
    assert [verb for verb in cli.VERBS if verb not in firsts] == []
    assert "etd play FILE --board fake" in told


def test_ctrl_c_while_a_verb_is_loaded_is_an_end_without_a_traceback(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def interrupted(_: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("importlib.import_module", interrupted)
    assert cli.main(["demo"]) == cli.INTERRUPTED


@pytest.mark.parametrize("entry", ["-m etd", "-c from|etd.__main__|import|main;exit(main())"])
def test_ctrl_c_while_the_command_itself_is_loaded_is_one_too(tmp_path: Path, entry: str) -> None:
    """By a module that is interrupted, in the place of one that takes long to load."""
    for module in ("msgspec", "typing_extensions"):
        (tmp_path / f"{module}.py").write_text("raise KeyboardInterrupt\n", encoding="utf-8")
    option, _, program = entry.partition(" ")
    ended = subprocess.run(
        [sys.executable, option, program.replace("|", " "), "status"],
        env={**os.environ, "PYTHONPATH": str(tmp_path)},
        capture_output=True,
        timeout=60,
        check=False,
    )
    assert (ended.returncode, ended.stdout, ended.stderr) == (cli.INTERRUPTED, b"", b"")


def test_the_installed_command_begins_there() -> None:
    (entry,) = entry_points(group="console_scripts", name="etd")
    assert entry.value == "etd.__main__:main"


@pytest.mark.parametrize("verb", cli.VERBS)
def test_every_verb_explains_itself_with_an_example(
    verb: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main([verb, "--help"])
    assert ended.value.code == 0
    told = capsys.readouterr().out
    assert f"usage: etd {verb}" in told
    if verb != "check":
        assert "example" in told


@pytest.mark.parametrize(
    "arguments",
    [
        ["fly"],
        ["status", "--nam", "main"],
        ["run", "--board", "kajimoto-hv507"],
        ["run", "--board", "fake", "--config", "etd.toml"],
        ["run", "--part", "both"],
        ["demo", "--seconds", "0"],
        ["demo", "--seconds", "nan"],
        ["play"],
        ["play", "x.json", "--level", "1.5"],
        ["play", "x.json", "--polarity", "both"],
        ["play", "x.json", "--returns", "some"],
        ["play", "x.json", "--returns", "ring:-1"],
        ["play", "x.json", "--repeat", "0"],
        ["play", "x.json", "--current-ua", "1.5", "--width-us", "100"],
    ],
)
def test_bad_usage_ends_with_status_2(
    arguments: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    assert ended.value.code == 2
    assert "--help` explains its use" in capsys.readouterr().err


def test_without_a_verb_it_shows_help_and_status_2(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main([]) == 2
    assert "first steps" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("error", "status"),
    [
        (Refused("no_lease", "none"), 1),
        (Refused("engine_gone", "gone"), 3),
        (FileError("f", "k", "v", "a"), 1),
        (PatternError("f", 3, "r"), 1),
        (AlreadyRunning("main", "x"), 1),
        (BoardFault("what", "1", "2"), 1),
        (DaemonGone("ipc:///x", "nobody"), 3),
        (HardwareMissing(("no board",)), 3),
        (BusError("busy", "x", "request"), 3),
        (BusError("absent", "x", "open"), 3),
        (BusError("io", "x", "transfer"), 1),
        (PartEnded("engine", "exit status 3", 3), 3),
        (PartEnded("engine", "killed by SIGKILL", 1), 1),
    ],
)
def test_the_status_tells_not_there_from_no(error: EtdError, status: int) -> None:
    assert cli.status_of(error) == status


def test_an_error_is_one_sentence_on_standard_error(capsys: pytest.CaptureFixture[str]) -> None:
    assert cli.main(["disarm"]) == 1
    told = capsys.readouterr()
    assert told.out == ""
    assert told.err.startswith("etd: only the holder of the lease may disarm")
    assert len(told.err.splitlines()) == 1


def test_a_late_frame_is_told_as_a_sentence(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def late(_: argparse.Namespace) -> int:
        raise Refused("expired", "sent 300 ms ago, its ttl is 200 ms")

    monkeypatch.setattr("etd.cli.disarm.run", late)
    assert cli.main(["disarm"]) == 1
    assert "was not shown: sent 300 ms ago" in capsys.readouterr().err


def test_with_json_an_error_is_one_object_on_standard_output(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert cli.main(["disarm", "--json"]) == 1
    told = capsys.readouterr()
    assert told.err == ""
    answer = json.loads(told.out)
    assert (answer["ok"], answer["error"]) == (False, "no_lease")


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["play", "x.json", "--current-ua", "1000"], "a current needs a width"),
        (["play", "x.json", "--array", "pad-8"], "go with --board fake"),
        (["play", "x.json", "--trace", "t.jsonl"], "go with --board fake"),
        (["play", "x.json", "--timeout-factor", "3"], "go with --board fake"),
        (
            ["calibrate", "P1", "--max-current-ua", "900", "--timeout-factor", "3"],
            "go with --board fake",
        ),
        (
            ["calibrate", "P1", "--max-current-ua", "900", "--fit", "--baseline", "P2"],
            "say with --as",
        ),
        (
            ["play", "x.json", "--current-ua", "9", "--width-us", "50", "--calibration", "P01"],
            "one of the two",
        ),
        (["run", "--array", "pad-8"], "--array needs --board fake"),
        (
            ["run", "--board", "fake", "--part", "engine", "--seconds", "1"],
            "--seconds goes without --part",
        ),
        (
            ["run", "--board", "fake", "--part", "gateway", "--seconds", "1"],
            "--seconds goes without --part",
        ),
        (
            ["run", "--board", "fake", "--trace", "t", "--board-socket", "s"],
            "writes its own trace",
        ),
        (["safe", "--board", "kajimoto-hv507"], "--board needs --machine"),
    ],
)
def test_options_that_do_not_go_together_are_misuse(
    arguments: list[str], sentence: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(arguments)
    assert ended.value.code == 2
    assert sentence in capsys.readouterr().err


def test_stop_tells_two_daemons_of_one_name_apart() -> None:
    answers = [
        Stopped(name="main", address="ipc:///run/etd/main/control.sock"),
        Stopped(name="main", address="ipc:///run/user/1000/etd/main/control.sock"),
        Stopped(name="left", address="ipc:///run/etd/left/control.sock"),
    ]
    told = lines_of(answers)
    assert told[1].startswith("main (ipc:///run/user/1000/etd/main/control.sock): silent")
    assert told[2].startswith("left: silent")


@pytest.mark.parametrize("folder", ["d8", "its own/d8"])
def test_a_folder_is_no_name_to_stop_a_service_by(
    folder: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """Also where it could be one: the daemon may have any name, and is no service."""
    assert cli.main(["stop", "--folder", folder]) == 3
    said = capsys.readouterr().out
    assert said.startswith(f"{folder}: NOT STOPPED")
    assert "then end\n  the `etd run` that runs it" in said
    state = "d8/state" if folder == "d8" else "'its own/d8/state'"
    assert f"`etd safe --config FILE --state {state}`" in said
    assert "systemctl" not in said
    assert "--name" not in said
    assert cli.main(["stop", "--json", "--folder", folder]) == 3
    (answer,) = json.loads(capsys.readouterr().out)["daemons"]
    assert (answer["name"], answer["folder"]) == (None, folder)


def test_a_name_that_does_not_answer_is_told_with_its_service(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    assert cli.main(["stop", "--name", "left"]) == 3
    said = capsys.readouterr().out
    assert "run\n  `systemctl stop etd-engine@left` and `etd safe --name left`." in said


def test_a_name_that_cannot_be_a_folder_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["run", "--name", "no/name", "--board", "fake"])
    assert ended.value.code == 2
    assert "no/name" in capsys.readouterr().err


def test_real_buses_are_not_recorded(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shipped = Path(cli.__file__).parents[3] / "config" / "etd.toml"
    config = tmp_path / "etd.toml"
    config.write_text(shipped.read_text(encoding="utf-8"), encoding="utf-8")
    assert cli.main(["run", "--config", str(config), "--trace", "t.jsonl"]) == 1
    assert "real buses cannot be recorded" in capsys.readouterr().err


def test_nothing_lengthens_a_timeout_on_a_real_board(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    shipped = Path(cli.__file__).parents[3] / "config" / "etd.toml"
    config = tmp_path / "etd.toml"
    config.write_text(shipped.read_text(encoding="utf-8"), encoding="utf-8")
    for part in ([], ["--part", "engine"], ["--part", "gateway"]):
        assert cli.main(["run", "--config", str(config), "--timeout-factor", "1", *part]) == 1
        assert "cannot be lengthened" in capsys.readouterr().err


@pytest.mark.parametrize("factor", ["0", "101", "-1", "1.5", "x", ""])
def test_a_timeout_factor_is_a_whole_number_within_bounds(
    factor: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        cli.main(["run", "--board", "fake", "--timeout-factor", factor])
    assert ended.value.code == 2
    assert "not a whole number from 1 to 100" in capsys.readouterr().err


@pytest.mark.parametrize(
    "asked",
    [
        ["stop", "--json", "--folder", "/tmp/\udcff"],
        ["check", "--json", "\udcff.toml"],
        ["run", "--board", "fake", "--folder", "/tmp/\udcff"],
        ["note", "\udcff"],
    ],
)
def test_an_argument_that_is_no_text_is_wrong_use(
    asked: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    """As the shell hands over a byte that is none in UTF-8."""
    with pytest.raises(SystemExit) as ended:
        cli.main(asked)
    assert ended.value.code == 2
    said = capsys.readouterr()
    assert "an argument is no text in UTF-8" in said.err
    if "--json" in asked:
        assert json.loads(said.out)["error"] == "used_wrongly"


IMPORTED_BY_SAFE = """
import json, sys
from etd.cli import main
main(["safe", "--board", "no-such-board", "--machine", "pi4"])
print(json.dumps(list(sys.modules)))
"""
IMPORTED_BY_ENGINE = """
import json, sys
from etd.cli import main
folder = sys.argv[1]
part = ["run", "--board", "fake", "--part", "engine", "--folder", folder]
main([*part, "--board-socket", folder + "/none"])
print(json.dumps(list(sys.modules)))
"""
IMPORTED_BY_CHECK = """
import contextlib, io, json, sys
from etd.cli import main
with contextlib.redirect_stdout(io.StringIO()):
    main(["check", "etd.toml"])
print(json.dumps(list(sys.modules)))
"""
IMPORTED_BY_STOP = """
import contextlib, io, json, sys
from etd.cli import main
with contextlib.redirect_stdout(io.StringIO()):
    main(["stop", "--folder", sys.argv[1]])
print(json.dumps(list(sys.modules)))
"""
IMPORTED_BY_NOTHING = "import json, sys; print(json.dumps(list(sys.modules)))"


def modules_of(program: str, *arguments: str) -> set[str]:
    ran = subprocess.run(
        [sys.executable, "-c", program, *arguments],
        capture_output=True,
        text=True,
        check=True,
        timeout=300,
    )
    return set(json.loads(ran.stdout))


def test_checking_files_loads_no_pictures_and_no_network() -> None:
    loaded = modules_of(IMPORTED_BY_CHECK) - modules_of(IMPORTED_BY_NOTHING)
    assert "etd.files.check" in loaded
    assert not {name for name in loaded if name.startswith(("etd.draw", "http", "ssl", "xml"))}


def test_safe_needs_the_hal_and_the_standard_library_only() -> None:
    # What is loaded anyway (an editable install's finder, say) is not the command's.
    loaded = modules_of(IMPORTED_BY_SAFE) - modules_of(IMPORTED_BY_NOTHING)
    ours = {name for name in loaded if name.split(".")[0] == "etd"}
    assert ours == {
        "etd",
        "etd.cli",
        "etd.cli.safe",
        "etd.files",
        "etd.protocol",
        "etd.protocol.errors",
        "etd.protocol.text",
        "etd.files.resources",
        "etd.version",
    }
    packages = {name.split(".")[0] for name in loaded} - sys.stdlib_module_names
    # msgspec takes typing_extensions where it is installed, and does without where it is not.
    assert packages - {"typing_extensions"} == {"etd", "etd_hal", "msgspec"}


def test_a_stop_waits_for_no_module_that_it_has_no_use_for(tmp_path: Path) -> None:
    loaded = modules_of(IMPORTED_BY_STOP, str(tmp_path)) - modules_of(IMPORTED_BY_NOTHING)
    assert "etd.client.stopping" in loaded
    assert not {"zmq", "asyncio", "numpy", "rich"} & {name.split(".")[0] for name in loaded}
    unused = {"display", "ssh", "course", "telemetry", "patterns"}
    assert not {f"etd.client.{name}" for name in unused} & loaded


def test_the_engine_part_holds_no_zeromq_and_no_network_side() -> None:
    with tempfile.TemporaryDirectory(prefix="etd-") as folder:
        loaded = modules_of(IMPORTED_BY_ENGINE, folder)
    assert "etd.engine.process" in loaded
    assert not [name for name in loaded if name.split(".")[0] in ("zmq", "rich")]
    assert not [name for name in loaded if name.startswith(("etd.gateway", "etd.client"))]
