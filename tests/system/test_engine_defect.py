"""An engine that is ended by a defect of its own, as a process: what the next one makes of it."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

import defective_engine
from command_rig import WITHIN_S, Command, CommandRig, command_rig
from etd.cli.part_ending import DEFECT
from etd.client import Display
from etd.files.paths import address_of
from etd.protocol.errors import Refused
from etd.protocol.messages import StateReport
from state_report import state_when

pytestmark = pytest.mark.slow

#: Its stops are read at each poll.
BOARD = "reference-hv507"
PROGRAM = Path(defective_engine.__file__)
#: Between two looks at what other processes do.
LOOK_S = 0.01


class Scene:
    """A folder with a gateway, and the engines that come one after the other."""

    def __init__(self, rig: CommandRig) -> None:
        self._rig = rig
        self.folder = rig.folder / "d"
        self.folder.mkdir(mode=0o700)
        self.start("gateway")

    @property
    def address(self) -> str:
        return address_of(self.folder)

    def start(self, part: str) -> Command:
        return self._rig.start(
            *("run", "--part", part, "--board", f"fake:{BOARD}", "--folder", str(self.folder)),
            *(("--timeout-factor", "10") if part == "engine" else ()),
        )

    @contextmanager
    def defective(self) -> Iterator[subprocess.Popen[str]]:
        command = [sys.executable, str(PROGRAM), str(self.folder), BOARD]
        with subprocess.Popen(
            command, stderr=subprocess.PIPE, text=True, env=self._rig.environment
        ) as engine:
            try:
                yield engine
            finally:
                engine.kill()

    def show_defect(self, engine: subprocess.Popen[str]) -> str:
        """What it says as it ends."""
        (self.folder / defective_engine.DEFECT).touch()
        _, said = engine.communicate(timeout=WITHIN_S)
        assert engine.returncode == DEFECT, said
        return said

    def wait_until(self, **fields: object) -> StateReport:
        return state_when(self.address, WITHIN_S, **fields)

    def display(self) -> Display:
        return Display(address=self.address, max_current_ua=1_000, width_us=100)


@pytest.fixture
def scene() -> Iterator[Scene]:
    with command_rig() as rig:
        yield Scene(rig)


def test_a_defect_while_armed_is_remembered_until_it_is_cleared(scene: Scene) -> None:
    with scene.defective() as engine:
        scene.wait_until(engine="there", state="SAFE")
        with scene.display() as display:
            display.arm(WITHIN_S)
            said = scene.show_defect(engine)
    assert "IndexError: the defect" in said
    scene.wait_until(engine="gone")
    scene.start("engine")
    report = scene.wait_until(engine="there")
    assert (report.state, report.holder) == ("HALTED", None)
    assert report.halt is not None
    assert (report.halt.cause, report.halt.source) == ("fault", "crash")
    assert report.halt.detail.startswith("the last engine was ended by a defect of its own")
    with scene.display() as display, pytest.raises(Refused, match="a defect of its own"):
        display.arm()
    with scene.display() as display:
        display.clear()
        display.arm(WITHIN_S)


def test_a_defect_of_an_engine_that_was_disarmed_leaves_nothing_to_be_cleared(scene: Scene) -> None:
    with scene.defective() as engine:
        scene.wait_until(engine="there", state="SAFE")
        with scene.display() as display:
            display.arm(WITHIN_S)
            display.disarm()
            assert display.status().state == "SAFE"
            scene.show_defect(engine)
    scene.wait_until(engine="gone")
    scene.start("engine")
    report = scene.wait_until(engine="there")
    assert (report.state, report.halt) == ("SAFE", None)
