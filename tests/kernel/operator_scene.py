"""`etd selftest` on the guest's real buses, and the person beside the board.

Owns: running the command as a person does, and doing what it asks for: pressing stops, moving the
load. Must not know: what is checked.
"""

from __future__ import annotations

import re
import subprocess
import sys
from pathlib import Path

from etd.selftest.report import Report, load
from etd_body.electrode import OPEN_CONTACT, Contact, grounded
from etd_body.electrode import load as resistor
from etd_hal.bench import StopName
from etd_hal.fake import wire
from etd_hal.linux.clock import LinuxClock
from guest_board import Chips

LOAD_OHM, SECOND_OHM = 47_000, 10_000
_FIRST, _SECOND = 1, 2
_STOP = re.compile(r"(press|release) the (emergency|wearer) stop(, and (release|HOLD) it.*)?")
_NAMES: dict[str, StopName] = {"emergency": "emergency_stop", "wearer": "wearer_stop"}
_CLIP = re.compile(r"connect (\d+) ohm between electrodes (\d+) and (\d+)")
_GROUND = re.compile(r"connect (\d+) ohm between electrode (\d+) and the board's ground")
_PRESSES_NS = 200_000_000
_CLOCK = LinuxClock()


class Operator:
    """A person with two resistors."""

    def __init__(self, chips: Chips) -> None:
        self._chips = chips
        self._on: tuple[int, ...] = ()
        self.clip(LOAD_OHM, _FIRST, _SECOND)

    def hear(self, said: str) -> None:
        """Do it, if it is something to be done."""
        asked = said.removeprefix("  -> ").strip()
        clip = _CLIP.fullmatch(asked)
        if clip:
            self.clip(int(clip[1]), int(clip[2]), int(clip[3]))
        ground = _GROUND.fullmatch(asked)
        if ground:
            self._put(grounded(int(ground[1])), int(ground[2]))
        stop = _STOP.fullmatch(asked)
        if stop:
            self._move(_NAMES[stop[2]], is_pressed=stop[1] == "press", is_held=stop[4] == "HOLD")

    def _move(self, stop: StopName, is_pressed: bool, is_held: bool) -> None:
        """A press that is not to be held is a release, too."""
        if is_pressed:
            self._chips.knock(wire.Press(stop, 0))
            _CLOCK.sleep_until_ns(_CLOCK.now_ns() + _PRESSES_NS)
        if not is_held:
            self._chips.knock(wire.Press(stop, 1))
            _CLOCK.sleep_until_ns(_CLOCK.now_ns() + _PRESSES_NS)

    def clip(self, load_ohm: int, *electrodes: int) -> None:
        """Half of the resistance at each of the two: what flows in at one leaves by the other."""
        self._put(resistor(load_ohm / 2), *electrodes)

    def _put(self, contact: Contact, *electrodes: int) -> None:
        for electrode in self._on:
            self._touch(electrode, OPEN_CONTACT)
        for electrode in electrodes:
            self._touch(electrode, contact)
        self._on = electrodes

    def _touch(self, electrode: int, contact: Contact) -> None:
        self._chips.knock(wire.Touch(electrode, contact))


def selftest(config: Path, chips: Chips, kept: Path) -> tuple[int, Report]:
    """The command's exit status, and its report, which lies at `kept` afterwards."""
    operator = Operator(chips)
    command = [
        *(sys.executable, "-m", "etd", "selftest", "--config", str(config)),
        *("--dummy-load", str(LOAD_OHM), "--second-load", str(SECOND_OHM)),
        *("--load-electrodes", f"{_FIRST},{_SECOND}"),
        *("--one-shot-us", "250", "--report", str(kept)),
    ]
    with subprocess.Popen(
        command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, text=True
    ) as running:
        assert running.stdout is not None
        for line in running.stdout:
            operator.hear(line)
    report = load(kept)
    assert report is not None, f"etd selftest ended with {running.returncode} and kept no report"
    return running.returncode, report
