"""`kill -9` of each process, with the board in a process of its own that goes on recording.

What docs/architecture.md promises is asserted here from the board's own trace: how long until the
skin is silent, that every message that began ended at zero, what the other process says, and that
a restart comes up silent, and HALTED where the one before was killed with the supply on.
"""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

import pytest

import trace_decoder
import trace_rules
from board_process import RunningBoard, running_board
from command_rig import WITHIN_S
from etd.client import Display, clock
from etd.protocol.errors import Refused
from etd.protocol.messages import StateReport
from etd_hal.boardfile import load_board
from state_report import state_when

pytestmark = pytest.mark.slow

BOARD = "kajimoto-hv507"
BOARD_FILE = Path(__file__).parents[2] / "config" / "boards" / f"{BOARD}.toml"
REST_US = load_board(BOARD_FILE).rest_us
#: A busy machine may hold a process back by so much; the promise itself is tighter.
SLACK_NS = 150_000_000

CLIENT = """
import sys
from etd import Display, Refused
with Display(address=sys.argv[1], max_current_ua=1000, width_us=100) as display:
    display.arm()
    print("armed", flush=True)
    while True:
        try:
            display.show_current([1000] * 24 + [0] * 40, ttl_ms=200)
        except Refused as refusal:
            if refusal.code != "expired":  # a busy machine may be late; the next frame is not
                raise
"""
#: Between two looks at what other processes do.
LOOK_S = 0.01


@dataclass
class Scene:
    """A board process, and the daemon's parts on it."""

    board: RunningBoard
    folder: Path
    parts: dict[str, subprocess.Popen[bytes]]

    @property
    def address(self) -> str:
        return f"ipc://{self.folder / 'control.sock'}"

    def start(self, part: str) -> None:
        command = [
            *(sys.executable, "-m", "etd", "run", "--part", part, "--board", f"fake:{BOARD}"),
            *("--board-socket", str(self.board.socket), "--folder", str(self.folder)),
        ]
        self.parts[part] = subprocess.Popen(command, stdin=subprocess.DEVNULL)

    def start_client(self) -> None:
        client = subprocess.Popen(
            [sys.executable, "-c", CLIENT, self.address], stdout=subprocess.PIPE
        )
        self.parts["client"] = client
        assert client.stdout is not None
        assert client.stdout.readline() == b"armed\n"

    def kill(self, part: str) -> int:
        """`kill -9`, by id; when it was gone, with all that it held."""
        self.parts[part].send_signal(signal.SIGKILL)
        self.parts[part].wait(WITHIN_S)
        return clock.now_ns()

    def wait_until(self, **fields: object) -> StateReport:
        return state_when(self.address, WITHIN_S, **fields)

    def wait_for_pulses(self, count: int) -> None:
        """Until the board has seen so many more phases."""
        deadline_ns = clock.now_ns() + int(WITHIN_S * 1e9)
        size = self.board.trace.stat().st_size
        while clock.now_ns() < deadline_ns:
            with self.board.trace.open("rb") as trace:
                trace.seek(size)
                if trace.read().count(b'"bus": "body"') >= count:
                    return
            clock.sleep_s(LOOK_S)
        pytest.fail("the client's frames are not felt")

    def make_safe(self) -> int:
        command = [
            *(sys.executable, "-m", "etd", "safe", "--board", BOARD, "--machine", "pi4"),
            *("--board-socket", str(self.board.socket)),
        ]
        return subprocess.run(command, timeout=WITHIN_S, check=False).returncode


@contextmanager
def scene(client: bool = True) -> Iterator[Scene]:
    """Board, engine, gateway and a client that holds a frame; all ended at the end."""
    with ExitStack() as stack:
        # A Unix socket's path has at most 107 bytes: not in pytest's folder.
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="etd")))
        board = stack.enter_context(running_board(load_board(BOARD_FILE), folder))
        running = Scene(board, folder, {})
        stack.callback(_end_all, running.parts)
        running.start("engine")
        running.start("gateway")
        running.wait_until(engine="there", state="SAFE")
        if client:
            running.start_client()
            running.wait_for_pulses(200)
        yield running


def _end_all(parts: dict[str, subprocess.Popen[bytes]]) -> None:
    for part in reversed(parts.values()):
        if part.poll() is None:
            part.terminate()
        part.wait(WITHIN_S)
        if part.stdout is not None:
            part.stdout.close()


def last_pulse_ns(board: RunningBoard) -> int:
    return max(phase.from_ns for phase in trace_decoder.decode(trace_decoder.read(board.trace)))


def assert_no_rule_is_broken(board: RunningBoard) -> None:
    assert trace_rules.violations(trace_decoder.read(board.trace), REST_US) == []
    state = board.state()
    assert state.dac_code == 0
    assert not state.violations


def test_a_killed_client_is_felt_no_longer_than_its_frame_and_its_lease_disarms() -> None:
    with scene() as running:
        killed_ns = running.kill("client")
        report = running.wait_until(state="SAFE", holder=None)
        assert report.last_disarm == "lapsed"
        assert last_pulse_ns(running.board) - killed_ns <= 200_000_000 + SLACK_NS
        _end_all(running.parts)
        assert_no_rule_is_broken(running.board)


def test_a_killed_gateway_leaves_silence_and_the_engine_says_so_to_the_next_one() -> None:
    with scene() as running:
        killed_ns = running.kill("gateway")
        running.parts["client"].wait(WITHIN_S)  # its frame is never answered
        running.start("gateway")
        report = running.wait_until(engine="there")
        assert (report.state, report.holder) == ("SAFE", None)
        assert report.last_disarm == "the gateway is gone"
        assert last_pulse_ns(running.board) - killed_ns <= 2_000_000 + SLACK_NS
        _end_all(running.parts)
        assert_no_rule_is_broken(running.board)


def test_a_gateway_that_hangs_is_found_out_after_250_ms() -> None:
    with scene() as running:
        gateway = running.parts["gateway"]
        gateway.send_signal(signal.SIGSTOP)
        stopped_ns = clock.now_ns()
        _wait_for_silence(running.board)
        gateway.send_signal(signal.SIGCONT)
        report = running.wait_until(engine="there", state="SAFE", holder=None)
        assert report.last_disarm == "the gateway is silent"
        assert last_pulse_ns(running.board) - stopped_ns <= 250_000_000 + SLACK_NS


def _wait_for_silence(board: RunningBoard) -> None:
    """Until no phase has been recorded for so long that an engine had its turn meanwhile."""
    deadline_ns = clock.now_ns() + int(WITHIN_S * 1e9)
    size, since_ns = board.trace.stat().st_size, clock.now_ns()
    while clock.now_ns() - since_ns < 1_500_000_000:
        assert clock.now_ns() < deadline_ns, "never silent"
        if board.trace.stat().st_size != size:
            size, since_ns = board.trace.stat().st_size, clock.now_ns()
        clock.sleep_s(LOOK_S)


@pytest.mark.parametrize("pulses", [200, 277])
def test_a_killed_engine_ends_its_message_and_safe_deselects(pulses: int) -> None:
    with scene() as running:
        running.wait_for_pulses(pulses - 200 + 1)
        killed_ns = running.kill("engine")
        report = running.wait_until(engine="gone")
        assert report.state == "SAFE"
        assert last_pulse_ns(running.board) <= killed_ns + SLACK_NS
        assert running.board.state().dac_code == 0

        assert running.make_safe() == 0
        assert_no_rule_is_broken(running.board)

        running.start("engine")
        report = running.wait_until(engine="there")
        assert (report.state, report.holder) == ("HALTED", None)
        assert report.halt is not None
        assert report.halt.source == "crash"
        display = Display(address=running.address, max_current_ua=1000, width_us=100)
        with display, pytest.raises(Refused, match="the last engine was killed with the supply on"):
            display.arm()
        with Display(address=running.address) as display:
            display.clear()
        running.wait_until(state="SAFE", halt=None)
        assert last_pulse_ns(running.board) <= killed_ns + SLACK_NS, "a restart fired"


def test_safe_says_who_holds_the_lines_while_an_engine_runs() -> None:
    with scene(client=False) as running:
        assert running.make_safe() == 3


def test_a_second_engine_and_a_second_gateway_are_refused() -> None:
    with scene(client=False) as running:
        for part in ("engine", "gateway"):
            second = subprocess.run(
                [
                    *(sys.executable, "-m", "etd", "run", "--part", part),
                    *("--board", f"fake:{BOARD}", "--folder", str(running.folder)),
                ],
                capture_output=True,
                stdin=subprocess.DEVNULL,
                timeout=WITHIN_S,
                check=False,
            )
            assert second.returncode == 1, second.stderr
            assert b"already running" in second.stderr
        running.wait_until(engine="there", state="SAFE")


def test_the_two_parts_end_when_they_are_told_and_leave_no_sockets() -> None:
    with scene(client=False) as running:
        for part in ("gateway", "engine"):
            os.kill(running.parts[part].pid, signal.SIGTERM)
            assert running.parts[part].wait(WITHIN_S) == 0
        left = {path.name for path in running.folder.glob("*.sock")}
        assert left == {"board.sock", "door.sock"}
