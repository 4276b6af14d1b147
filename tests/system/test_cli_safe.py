"""`etd safe` on a board process: after an engine was killed, and while one is running."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest

from board_process import RunningBoard, running_board
from command_rig import CommandRig, command_rig
from etd.files.resources import find
from etd_hal.boardfile import load_board

pytestmark = pytest.mark.slow

BOARD = "kajimoto-hv507"


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


@pytest.fixture
def board(rig: CommandRig) -> Iterator[RunningBoard]:
    with running_board(load_board(find("boards", BOARD)), rig.folder) as running:
        yield running


def safe(rig: CommandRig, board: RunningBoard) -> tuple[str, ...]:
    return ("safe", "--board", BOARD, "--machine", "pi4", "--board-socket", str(board.socket))


def last_levels(trace: Path, lines: dict[int, str]) -> dict[str, int]:
    """The level of each line after all that the trace tells."""
    found: dict[str, int] = {}
    for text in trace.read_text().splitlines():
        event = json.loads(text)
        if event.get("bus") == "gpio" and event["line"] in lines:
            found[lines[event["line"]]] = event["value"]
    return found


def test_a_board_that_nobody_holds_is_made_safe(rig: CommandRig, board: RunningBoard) -> None:
    made = rig.run(*safe(rig, board), "--json")
    assert made.status == 0, made.err
    assert made.answer == {"ok": True, "backend": "fake", "board": BOARD, "problems": []}
    assert last_levels(board.trace, {4: "POL", 23: "BL"}) == {"POL": 1, "BL": 0}


def test_while_an_engine_runs_it_asks_for_stop(rig: CommandRig, board: RunningBoard) -> None:
    with rig.daemon("--board-socket", str(board.socket)):
        refused = rig.run(*safe(rig, board))
    assert refused.status == 3
    assert "etd stop" in refused.err


def test_after_a_killed_engine_the_daemon_makes_the_board_safe_itself(
    rig: CommandRig, board: RunningBoard
) -> None:
    command = rig.start("run", "--board", "fake", "--board-socket", str(board.socket))
    command.line()
    os.kill(command.children()["engine"], signal.SIGKILL)
    said = command.ended()
    assert said.status == 1
    assert "safe (fake): kajimoto-hv507: outputs off" in said.out
    assert board.state().dac_code == 0
    assert not board.state().held


@pytest.mark.parametrize("ending", ["Ctrl-C", "SIGTERM", "the gateway's death"])
def test_a_hung_engine_is_killed_at_the_end_and_the_board_is_made_safe_after_it(
    rig: CommandRig, board: RunningBoard, ending: str
) -> None:
    command = rig.start("run", "--board", "fake", "--board-socket", str(board.socket))
    command.line()
    parts = command.children()
    os.kill(parts["engine"], signal.SIGSTOP)
    if ending == "the gateway's death":
        os.kill(parts["gateway"], signal.SIGKILL)
    else:
        command.signal(signal.SIGINT if ending == "Ctrl-C" else signal.SIGTERM)
    said = command.ended()
    assert said.status == 1
    assert "the engine ended (killed: it did not end within 5 s): `etd safe` makes" in said.err
    assert "safe (fake): kajimoto-hv507: outputs off" in said.out
    assert not board.state().held


def test_an_engine_that_ended_well_is_not_made_safe_again(
    rig: CommandRig, board: RunningBoard
) -> None:
    said = rig.run(
        "run", "--board", "fake", "--board-socket", str(board.socket), "--seconds", "0.1"
    )
    assert said.status == 0
    assert "safe" not in said.out + said.err


def test_without_a_board_process_the_status_is_3(rig: CommandRig) -> None:
    absent = rig.run(
        *("safe", "--board", BOARD, "--machine", "pi4"),
        *("--board-socket", str(rig.folder / "none.sock"), "--json"),
    )
    assert absent.status == 3
    assert absent.answer["error"] == "bus_error"


def test_the_board_is_found_through_the_configuration(rig: CommandRig, board: RunningBoard) -> None:
    config = rig.folder / "etd.toml"
    config.write_text(f'backend = "linux"\nboard = "{BOARD}"\nmachine = "pi4"\n')
    made = rig.run("safe", "--config", str(config), "--board-socket", str(board.socket))
    assert made.status == 0, made.err


def test_a_configuration_without_a_board_says_so(rig: CommandRig) -> None:
    config = rig.folder / "etd.toml"
    config.write_text('backend = "linux"\nmachine = "pi4"\n')
    refused = rig.run("safe", "--config", str(config))
    assert refused.status == 1
    assert "board: it is missing" in refused.err


def test_a_pipe_in_the_place_of_the_configuration_is_not_waited_for(rig: CommandRig) -> None:
    config = rig.folder / "etd.toml"
    os.mkfifo(config)
    refused = rig.run("safe", "--config", str(config))
    assert refused.status == 1
    assert "it is a pipe" in refused.err
    assert "name the board: --board and --machine" in refused.err


@pytest.fixture
def copy(rig: CommandRig, board: RunningBoard) -> Path:
    """What an engine on Linux keeps of its board's file, in the folder that it was given."""
    with rig.daemon("--board", "fake", "--array", "pad-8"):
        (kept,) = rig.folder.rglob("board-as-started-fake.toml")
        assert kept.read_bytes().endswith(SHIPPED.read_bytes())
        assert kept.stat().st_mode & 0o777 == 0o600
        assert of_copy(kept)["file"] == str(SHIPPED)
    return kept.rename(kept.with_name("board-as-started-linux.toml"))


def of_copy(copy: Path) -> dict[str, str]:
    found: dict[str, str] = json.loads(copy.read_text().partition("\n")[0].removeprefix("# etd: "))
    return found


def rewrite(copy: Path, **changed: str) -> None:
    """The copy, of something else."""
    text = copy.read_text().partition("\n")[2]
    copy.write_text(f"# etd: {json.dumps({**of_copy(copy), **changed})}\n{text}")


def asked_with(
    rig: CommandRig, board: RunningBoard, settings: str, edited: str = ""
) -> tuple[str, ...]:
    """`etd safe` with these settings, which may name a board's file that is so."""
    (rig.folder / "edited.toml").write_text(edited)
    (rig.folder / "main.toml").write_text(settings.format(rig.folder / "edited.toml"))
    return (
        *("safe", "--config", str(rig.folder / "main.toml")),
        *("--board-socket", str(board.socket)),
    )


SHIPPED = find("boards", BOARD)
SETTINGS = 'backend = "linux"\nboard = "{}"\nmachine = "pi4"\n'
EDITED = {
    "settings that cannot be read": ("backend = [", ""),
    "a file that cannot be read": (SETTINGS, "[maxima"),
    "a key that is not known": (
        SETTINGS,
        SHIPPED.read_text().replace("[maxima]", "[maxima]\ntypo = 1"),
    ),
    "another line": (SETTINGS, SHIPPED.read_text().replace("BL = 23", "BL = 25")),
}


@pytest.mark.parametrize("edit", EDITED)
def test_what_was_edited_since_the_engine_was_started_is_made_safe_as_it_was_then(
    rig: CommandRig, board: RunningBoard, copy: Path, edit: str
) -> None:
    asked = asked_with(rig, board, *EDITED[edit])
    made = rig.run(*asked)
    assert made.status == 0, made.err
    assert "the board is made safe as the engine was started with it" in made.err
    assert last_levels(board.trace, {4: "POL", 23: "BL"}) == {"POL": 1, "BL": 0}
    elsewhere = ("safe", "--config", str(rig.folder / "none.toml"), *asked[3:])
    assert rig.run(*elsewhere).status != 0, "without settings there need not be that board"


def test_a_copy_counts_until_the_computer_is_started_again(
    rig: CommandRig, board: RunningBoard, copy: Path
) -> None:
    rewrite(copy, boot="another")
    assert rig.run(*asked_with(rig, board, "backend = [")).status != 0


def test_a_board_that_the_command_names_is_made_safe_as_the_engine_had_that_file(
    rig: CommandRig, board: RunningBoard, copy: Path
) -> None:
    asked_with(rig, board, SETTINGS, EDITED["another line"][1])
    asked = ("safe", "--board", str(rig.folder / "edited.toml"), *safe(rig, board)[3:])
    other = rig.run(*asked)
    assert other.status == 0, other.err
    assert other.err == "", "the copy is of another file"
    rewrite(copy, file=str(rig.folder / "edited.toml"))
    assert "as the engine was started with it" in rig.run(*asked).err


def test_a_daemon_with_a_folder_of_its_own_has_its_copy_there(
    rig: CommandRig, board: RunningBoard, copy: Path
) -> None:
    (rig.folder / "state").mkdir(exist_ok=True)
    copy.rename(rig.folder / "state" / copy.name)
    asked = asked_with(rig, board, "backend = [")
    assert rig.run(*asked).status != 0
    made = rig.run(*asked, "--state", str(rig.folder / "state"))
    assert made.status == 0, made.err
    assert str(rig.folder / "state" / copy.name) in made.err


def test_a_copy_that_cannot_be_used_leaves_the_file_as_it_is(
    rig: CommandRig, board: RunningBoard, copy: Path
) -> None:
    copy.write_text(copy.read_text().replace("[maxima]", "[maxima]\ntypo = 1"))
    made = rig.run(*asked_with(rig, board, SETTINGS, SHIPPED.read_text()))
    assert made.status == 0, made.err
    assert "the board's file is used as it is now" in made.err
    assert rig.run(*asked_with(rig, board, "backend = [")).status != 0
