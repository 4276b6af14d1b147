"""The board process: what is left when its client is not."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from board_process import HAL, RunningBoard, running_board
from command_rig import WITHIN_S
from etd_hal.boardfile import BoardFile
from etd_hal.chips import ads1115
from etd_hal.compose import open_fake
from etd_hal.errors import BusError
from etd_hal.fake import wire
from etd_hal.fake.faults import SpiStall
from etd_hal.fake.pressure_sensors import LYING_KPA
from etd_hal.linesetup import line_setup
from etd_hal.ports import Message, Transfer
from stepped_board import BOARDS, shipped_board

#: Plays pulses without end, saying so after the first; told the board's file and socket.
PULSES_WITHOUT_END = """
import sys
from pathlib import Path
from etd_hal.boardfile import load_board
from etd_hal.compose import open_fake
from etd_hal.ports import Message, Transfer

backend = open_fake(
    load_board(Path(sys.argv[1])), electrodes=range(64), board_socket=Path(sys.argv[2])
)
pulse = Message(
    (Transfer(b"\\x13\\x30", cs_change=True), *[Transfer(delay_us=10)] * 8, Transfer(b"\\0\\0"))
)
backend.spi.transfer(pulse)
print("pulsing", flush=True)
while True:
    backend.spi.transfer(pulse)
"""


@pytest.fixture
def board() -> BoardFile:
    return shipped_board("reference-hv507")


def events(trace: Path) -> list[dict[str, Any]]:
    text = trace.read_text()
    assert text.endswith("\n"), "a line was cut"
    return [json.loads(line) for line in text.splitlines()[1:]]


def kill_a_pulsing_client(running: RunningBoard) -> None:
    client = subprocess.Popen(
        [
            *(sys.executable, "-c", PULSES_WITHOUT_END),
            *(str(BOARDS / "reference-hv507.toml"), str(running.socket)),
        ],
        stdout=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": str(HAL)},
    )
    assert client.stdout is not None
    with client.stdout as said:
        assert said.readline() == b"pulsing\n"
        client.send_signal(signal.SIGKILL)
        client.wait(WITHIN_S)


def request_when_free(board: BoardFile, running: RunningBoard) -> None:
    """The process notices a client's end at its next turn; the state is asked in between."""
    for _ in range(1_000):
        if not running.state().held:
            break
    else:
        pytest.fail("the lines are still held")
    open_fake(board, electrodes=range(64), board_socket=running.socket).close()


def test_a_killed_client_leaves_whole_messages_and_free_lines(
    board: BoardFile, tmp_path: Path
) -> None:
    with running_board(board, tmp_path) as running:
        kill_a_pulsing_client(running)
        request_when_free(board, running)
        state = running.state()
    assert state.dac_code == 0
    assert state.violations == ()
    played = [event["event"] for event in events(running.trace) if event["bus"] == "spi"]
    assert played.count("message") == played.count("done") > 0


def test_a_message_that_stood_still_when_its_client_died_runs_to_its_end(
    board: BoardFile, tmp_path: Path
) -> None:
    with running_board(board, tmp_path) as running:
        running.knock(wire.PutIn(SpiStall(stall_us=2_000_000, at_message=2)))
        kill_a_pulsing_client(running)
        request_when_free(board, running)
        assert running.state().dac_code == 0
    played = [event["event"] for event in events(running.trace) if event["bus"] == "spi"]
    assert played.count("message") == played.count("done")


def test_a_second_client_is_told_who_holds_the_lines(board: BoardFile, tmp_path: Path) -> None:
    with running_board(board, tmp_path) as running:
        first = open_fake(board, electrodes=range(64), board_socket=running.socket)
        with pytest.raises(BusError) as raised:
            open_fake(board, electrodes=range(64), board_socket=running.socket)
        first.close()
    assert raised.value.kind == "busy"
    assert "held by etd" in raised.value.detail


def test_levels_stay_when_a_client_leaves(board: BoardFile, tmp_path: Path) -> None:
    hv_enable = board.guards.hv_enable
    heartbeat = board.guards.heartbeat
    assert hv_enable != "absent"
    assert heartbeat != "absent"
    with running_board(board, tmp_path) as running:
        first = open_fake(board, electrodes=range(64), board_socket=running.socket)
        first.gpio.set(((hv_enable.line, 1), (heartbeat.line, 1)))
        first.close()
        before = [event for event in events(running.trace) if event["bus"] == "gpio"]
        assert [event["value"] for event in before if event["line"] == hv_enable.line] == [0, 1]
        request_when_free(board, running)
        after = [event for event in events(running.trace) if event["bus"] == "gpio"]
    added = [(event["line"], event["value"]) for event in after[len(before) :]]
    assert added == list(line_setup(board).outputs)


def test_a_stop_line_is_pressed_through_the_second_door(board: BoardFile, tmp_path: Path) -> None:
    with running_board(board, tmp_path) as running:
        backend = open_fake(board, electrodes=range(64), board_socket=running.socket)
        running.knock(wire.Press("emergency_stop", 0))
        (edge,) = backend.gpio.edges()
        backend.close()
    assert (edge.line, edge.value) == (board.guards.emergency_stop, 0)


def test_an_edge_on_the_trigger_comes_through_the_second_door(
    board: BoardFile, tmp_path: Path
) -> None:
    with running_board(board, tmp_path) as running:
        backend = open_fake(board, electrodes=range(64), board_socket=running.socket)
        running.knock(wire.GiveEdge(lasts_ns=60_000_000_000))
        (edge,) = backend.gpio.edges()
        backend.close()
    assert board.trigger != "absent"
    assert (edge.line, edge.value) == (board.trigger.line, 1)


def test_another_boards_file_is_refused(board: BoardFile, tmp_path: Path) -> None:
    other = shipped_board("kajimoto-hv507")
    with running_board(board, tmp_path) as running, pytest.raises(BusError) as raised:
        open_fake(other, electrodes=range(64), board_socket=running.socket)
    assert raised.value.kind == "invalid"


def test_without_a_board_process_its_socket_is_absent(board: BoardFile, tmp_path: Path) -> None:
    with pytest.raises(BusError) as raised:
        open_fake(board, electrodes=range(64), board_socket=tmp_path / "nobody.sock")
    assert raised.value.kind == "absent"


def test_when_the_board_process_dies_its_client_is_told(board: BoardFile, tmp_path: Path) -> None:
    with running_board(board, tmp_path) as running:
        backend = open_fake(board, electrodes=range(64), board_socket=running.socket)
        running.process.kill()
        running.process.wait(WITHIN_S)
        with pytest.raises(BusError) as raised:
            backend.spi.transfer(Message((Transfer(b"\0\0"),)))
        backend.close()
    assert raised.value.kind == "gone"


def test_a_board_process_has_the_sensors_that_it_was_started_with(
    tmp_path: Path, board: BoardFile
) -> None:
    with running_board(board, tmp_path, "0x48:1:0.5:100", "0x4a:3:0.2:50") as running:
        backend = open_fake(board, electrodes=range(64), board_socket=running.socket)
        assert backend.i2c is not None

        def wait(duration_ns: int) -> None:
            backend.clock.sleep_until_ns(backend.clock.now_ns() + duration_ns)

        volts = [
            ads1115.convert_v(backend.i2c, address, channel, wait)
            for address, channel in ((0x48, 1), (0x4A, 3))
        ]
        backend.close()
    assert volts == [
        pytest.approx(0.5 + LYING_KPA / 100, abs=0.001),
        pytest.approx(0.2 + LYING_KPA / 50, abs=0.001),
    ]
