"""`kill -9` of the engine's service at random moments of a scan: what the board does until it is
safe, who makes it so, and when: first the stopper, which outlives the engine, then `etd safe`.

The killer's priority lies above the engine's: no moment of the engine is out of its reach. What is
judged is the kernel's trace; who `etd safe` was is told by the journal.
"""

from __future__ import annotations

import os
import random
import signal
import statistics
from dataclasses import dataclass

import pytest

import kernel_trace
import service_scene as scene
import trace_decoder
import trace_rules
from etd_hal.fake.trace import header
from guest_board import SEED, above_the_engine, report
from kernel_trace import Event
from service_scene import CLOCK, ENGINE

KILLS = int(os.environ.get("ETD_KILLS", "5"))
FACTS = trace_decoder.parse(header(scene.BOARD, range(scene.BOARD.switch.outputs)))[0]
#: Stamps are cut to whole microseconds.
REST_US = scene.BOARD.rest_us - 1
#: Words are read where their transfer is over.
TRACED = tuple(event for event in kernel_trace.EVENTS if event != "spi/spi_transfer_start")
#: For so long the opening of a frame lets nothing through.
OPENING_NS = 220_000_000
#: Then the scan comes often enough that it is seldom at rest, and goes on for up to three rounds.
RATE_HZ = 40
#: The node reads the same whatever flows, which is no skin: strong pulses of one polarity that some
#: electrodes had already would seem to come back through these.
CURRENT_UA = 200
SCANNED_NS = 75_000_000
#: By then it must be safe; the next engine starts later (RestartSec=).
SAFE_WITHIN_NS = 1_500_000_000


@dataclass(frozen=True)
class Told:
    """What is kept of a kill. Times count from it."""

    safe_pid: int
    is_in_scan: bool
    is_in_message: bool
    cut_ms: float
    first_line_ms: float
    last_word_ms: float


@dataclass(frozen=True)
class Kill:
    """One kill, and the trace from the engine's start until the next one's."""

    due_us: float
    events: list[Event]

    def __post_init__(self) -> None:
        assert len(self._later_pids) == 2, "after the kill the stopper cuts, and one makes it safe"

    @property
    def _later_pids(self) -> list[int]:
        """Of the processes that are not the engine, in the order of their first events."""
        engine = {event.pid for event in self.events if event.t_us <= self.due_us}
        return list(dict.fromkeys(event.pid for event in self.events if event.pid not in engine))

    @property
    def safe_pid(self) -> int:
        """Of the process that makes it safe, once the stopper is over."""
        return self._later_pids[1]

    @property
    def left(self) -> list[Event]:
        """What was there before anybody else moved a line."""
        return self.events[: [event.pid for event in self.events].index(self._later_pids[0])]

    @property
    def cut(self) -> list[Event]:
        """What the stopper did."""
        stopper = self._later_pids[0]
        return [event for event in self.events if event.pid == stopper]

    @property
    def made_safe(self) -> list[Event]:
        return self.events[len(self.left) + len(self.cut) :]

    @property
    def told(self) -> Told:
        last = self.left[-1]
        return Told(
            safe_pid=self.safe_pid,
            is_in_scan=self.due_us - last.t_us < 1e6 / RATE_HZ,
            is_in_message=last.name == "spi_message_done" and last.t_us > self.due_us,
            cut_ms=(self.cut[-1].t_us - self.due_us) / 1_000,
            first_line_ms=(self.made_safe[0].t_us - self.due_us) / 1_000,
            last_word_ms=(self.made_safe[-1].t_us - self.due_us) / 1_000,
        )


def kill(scanned_ns: int) -> Kill:
    """Scan a frame, kill the engine after so long, wait for the next one, which is traced anew.

    With one processor the killer may have to wait for the end of a message: what counts is when it
    was due.
    """
    pid = scene.main_pid(ENGINE)
    assert pid > 0, "there is no engine"
    with scene.showing([CURRENT_UA] * 64) as display, above_the_engine():
        CLOCK.sleep_until_ns(CLOCK.now_ns() + OPENING_NS)
        display.show_current([CURRENT_UA] * 64, ttl_ms=1_000, rate_hz=RATE_HZ, allow_slower=True)
        due_ns = CLOCK.now_ns() + scanned_ns
        CLOCK.sleep_until_ns(due_ns)
        os.kill(pid, signal.SIGKILL)
    CLOCK.sleep_until_ns(due_ns + SAFE_WITHIN_NS)
    events = kernel_trace.events()
    kernel_trace.begin(TRACED)
    assert scene.started_again(pid), "it stays down"
    scene.clear_crash()
    return Kill(due_ns / 1_000, events)


def assert_quiet_until_safe(kill: Kill) -> None:
    """A message that had begun went on to its zero; nothing else happened."""
    for message in kernel_trace.messages(kill.left):
        words = [event.tx for event in message if event.tx]
        assert words[-1] == bytes(2), "a message ended with current on"
        assert not [event for event in message if event.name == "spi_set_cs"][-1].is_active
        assert message[0].t_us <= kill.due_us, "a message began after the kill"
    moved = [event for event in kill.left if event.name == "rig_line"]
    assert moved[-1].t_us <= kill.due_us, "a line moved after the kill"


def assert_made_safe(kill: Kill) -> None:
    """Cut by the stopper, which does nothing else: POL up, BL down. Then by one process alone the
    same, and the DAC at zero.
    """
    named = scene.BOARD.used_lines()
    assert [event.rest for event in kill.cut] == [f"{named['POL']} 1", f"{named['BL']} 0"]
    assert {event.pid for event in kill.made_safe} == {kill.safe_pid}, "somebody else helped"
    levels = kernel_trace.levels(kill.made_safe)
    lines = scene.BOARD.used_lines()
    assert (levels[lines["POL"]], levels[lines["BL"]]) == (1, 0)
    assert [event.tx for event in kill.made_safe if event.tx][-1] == bytes(2)


@pytest.mark.timeout(100 + 60 * KILLS)
def test_however_the_service_is_killed_its_stop_makes_the_board_safe_and_nothing_moves_before(
    services: None,
) -> None:
    since = scene.cursor()
    chance = random.Random(SEED)
    kills: list[Told] = []
    for _ in range(KILLS):
        # As an operator does: five starts in five minutes are allowed.
        scene.said_by("systemctl", "reset-failed", ENGINE)
        one = kill(chance.randrange(SCANNED_NS))
        assert_quiet_until_safe(one)
        assert_made_safe(one)
        assert trace_rules.violations(kernel_trace.records(one.events, FACTS), REST_US) == []
        kills.append(one.told)
    assert scene.safe_pids(scene.journal(since)) == [kill.safe_pid for kill in kills]
    tell(kills)


def tell(kills: list[Told]) -> None:
    in_scan = sum(kill.is_in_scan for kill in kills)
    assert in_scan >= max(1, KILLS // 2), "the engine was not scanning when it was killed"
    within = sum(kill.is_in_message for kill in kills)
    report(
        f"{KILLS} kills of the service (seed {SEED}), {in_scan} of them in a scan, {within} in a"
        " message; every message ended in zero"
    )
    cut = [kill.cut_ms for kill in kills]
    first, last = [kill.first_line_ms for kill in kills], [kill.last_word_ms for kill in kills]
    report(f"from the kill to outputs that the stopper has cut: {spread(cut)}")
    report(f"from the kill to the first line that ExecStopPost= sets: {spread(first)}")
    report(f"from the kill to the end of what ExecStopPost= does: {spread(last)}")


def spread(values_ms: list[float]) -> str:
    return f"p50 {statistics.median(values_ms):.1f}, max {max(values_ms):.1f} ms"
