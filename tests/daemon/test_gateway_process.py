"""The gateway as a process of its own: how it begins, ends and dies.

Owns: signals, the lock after a kill, and what the engine sees of it.
"""

from __future__ import annotations

import gc
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from command_rig import WITHIN_S
from etd import AlreadyRunning, Display
from etd.files.paths import address_of
from etd.gateway.config import GatewayConfig
from etd.gateway.process import run_gateway
from etd.gateway.server import Gateway
from gateway_rig import HandClock
from scripted_engine import ScriptedEngine

pytestmark = pytest.mark.slow

_SCRIPT = """
import sys
from pathlib import Path
from gateway_rig import RunningClock
from etd.gateway.config import GatewayConfig
from etd.gateway.process import run_gateway
folder = Path(sys.argv[1])
config = GatewayConfig(name="p", runtime_folder=folder, state_dir=folder / "state")
sys.exit(run_gateway(config, RunningClock(), on_ready=lambda: print("ready", flush=True)))
"""


@pytest.fixture
def folder() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="etd-") as name:
        yield Path(name)


@contextmanager
def process(folder: Path) -> Iterator[subprocess.Popen[str]]:
    environment = {"PYTHONPATH": ":".join(sys.path)}
    with subprocess.Popen(
        [sys.executable, "-c", _SCRIPT, str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env=environment,
    ) as running:
        assert running.stdout is not None
        assert running.stdout.readline() == "ready\n"
        try:
            yield running
        finally:
            running.kill()


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGINT])
def test_it_serves_until_it_is_told_to_end(folder: Path, ending: signal.Signals) -> None:
    with process(folder) as running:
        with Display(address=address_of(folder)) as display:
            assert display.status().engine == "gone"
        running.send_signal(ending)
        assert running.wait(WITHIN_S) == 0
    assert not (folder / "control.sock").exists()


def test_a_collection_steps_through_nothing_that_is_there_from_the_beginning(
    folder: Path,
) -> None:
    """It would take 10 ms and more, in the middle of a turn."""

    class Ready(Exception):
        pass

    def ready() -> None:
        frozen.append(gc.get_freeze_count())
        raise Ready

    gc.unfreeze()
    frozen: list[int] = []
    config = GatewayConfig(name="p", runtime_folder=folder, state_dir=folder / "state")
    try:
        with pytest.raises(Ready):
            run_gateway(config, HandClock(), ready)
        assert frozen[0] > 10_000
    finally:
        gc.unfreeze()


def test_a_second_process_of_the_name_is_refused_until_the_first_was_killed(folder: Path) -> None:
    config = GatewayConfig(name="p", runtime_folder=folder, state_dir=folder / "state")
    with process(folder) as running:
        with pytest.raises(AlreadyRunning, match=f"process {running.pid} holds"):
            Gateway(config, HandClock())
        running.kill()
        running.wait(WITHIN_S)
    Gateway(config, HandClock()).close()


def test_a_killed_gateway_is_seen_by_its_engine_at_once(folder: Path) -> None:
    engine = ScriptedEngine(folder)
    with process(folder) as running:
        while not engine.alive:
            engine.step()
        running.kill()
        running.wait(WITHIN_S)
        engine.step()
        assert not engine.is_connected
    engine.close()


@pytest.mark.parametrize("is_asked", [True, False])
def test_the_end_of_the_engine_is_logged_unless_the_daemon_was_asked_to_end(
    folder: Path, is_asked: bool
) -> None:
    engine = ScriptedEngine(folder)
    with process(folder) as running:
        while not engine.alive:
            engine.step()
        # Stopped, it hears of both at once.
        running.send_signal(signal.SIGSTOP)
        os.waitid(os.P_PID, running.pid, os.WSTOPPED)
        if is_asked:
            running.send_signal(signal.SIGTERM)
        engine.close()
        running.send_signal(signal.SIGCONT)
        if not is_asked:
            with Display(address=address_of(folder)) as display:
                while display.status().engine == "there":
                    pass
            running.terminate()
        _, log = running.communicate(timeout=WITHIN_S)
    assert ("engine gone" in log) is not is_asked
    assert log.splitlines()[-1] == "etd p: asked to end"
