"""What `etd lsl` makes of telemetry: stamps against what flowed on the wires."""

from __future__ import annotations

import json
import math
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import pytest

from etd import cli
from etd.apps.lsl_streams import Streams
from etd.client.daemon_clock import DaemonClock
from etd.protocol.messages import Fired, Halt, Marked, Scan, Shown, StateReport
from stepped_daemon import SteppedDaemon, SteppedDisplay

pytestmark = pytest.mark.slow

N = 8
#: A pulse is timed from its message, a phase from the DAC's word in it.
WORD_NS = 30_000


@dataclass
class StandIn:
    """An outlet that keeps what it is given."""

    pushed: list[tuple[list[Any], float]] = field(default_factory=list)

    def push(self, sample: Sequence[str | float], stamp_s: float) -> None:
        self.pushed.append((list(sample), stamp_s))

    def named(self, what: str) -> list[tuple[str, dict[str, Any], int]]:
        """(name, facts, stamp in ns) of events that begin so."""
        return [
            (name, json.loads(facts), round(stamp_s * 1e9))
            for (name, facts), stamp_s in self.pushed
            if name.startswith(what)
        ]


@pytest.fixture
def daemon() -> Iterator[SteppedDaemon]:
    with SteppedDaemon("pad-8", is_traced=True) as made:
        yield made


def heard(display: SteppedDisplay, streams: Streams) -> None:
    """All reports that have come, and come within a tenth of a second."""
    for _ in range(10_000):
        item = display.receive(0.1)
        if item is None:
            return
        streams.hear(item[1])
    raise AssertionError("reports without end")


def test_a_frame_is_stamped_with_its_first_pulse_on_the_wires(daemon: SteppedDaemon) -> None:
    display = SteppedDisplay(daemon, 3_000, 100)
    display.arm()
    events, contact = StandIn(), StandIn()
    streams = Streams(DaemonClock(is_here=True), events, contact)
    for tag, seconds in ((1, 0.05), (2, 0.12), (3, 1.4), (4, 0.05)):
        display.present([0, 700, 0, 0, 0, 0, 0, 0], seconds, 50.0, tag=tag)
        heard(display, streams)
    fired: dict[int, int] = {}
    for phase in daemon.followed.phases():
        if phase.electrode == 1 and phase.tag is not None and phase.current_ua:
            fired.setdefault(phase.tag, phase.from_ns)
    begun = events.named("frame")
    assert [name for name, _, _ in begun] == ["frame/1", "frame/2", "frame/3", "frame/4"]
    for tag, (_, facts, stamp_ns) in enumerate(begun, start=1):
        assert abs(stamp_ns - facts["first_ns"]) < 1_000
        assert 0 <= fired[tag] - stamp_ns < WORD_NS
    renewed = events.named("renewed")
    assert {name for name, _, _ in renewed} == {"renewed/3"}, "a frame lives for a second"
    assert len({facts["seq"] for _, facts, _ in (*begun, *renewed)}) == len(begun) + len(renewed)


def test_without_the_package_the_line_that_installs_it_is_told(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "pylsl", None)
    assert cli.main(["lsl", "--seconds", "1"]) == 1
    assert "pip install 'etd[lsl]'" in capsys.readouterr().err


def test_contact_is_pushed_as_it_is_told(daemon: SteppedDaemon) -> None:
    display = SteppedDisplay(daemon, 3_000, 100)
    daemon.fake.world.lift(6)
    display.arm()
    events, contact = StandIn(), StandIn()
    streams = Streams(DaemonClock(is_here=True), events, contact)
    display.present([700] * N, 0.3, 50.0)
    heard(display, streams)
    sample, stamp_s = contact.pushed[-1]
    assert [sample[one] for one in (1, 6)] == [1.0, 0.0]
    assert 0.0 <= daemon.now_ns() / 1e9 - stamp_s < 1.0
    assert len(sample) == N


def test_an_edge_that_began_a_frame_is_in_its_facts(daemon: SteppedDaemon) -> None:
    display = SteppedDisplay(daemon, 3_000, 100)
    display.arm()
    events = StandIn()
    streams = Streams(DaemonClock(is_here=True), events, StandIn())
    display.present([0, 700, 0, 0, 0, 0, 0, 0], 0.5, 50.0)
    edge_ns = daemon.now_ns() + 700_000_000
    daemon.fake.world.trigger(edge_ns)
    display.present([0, 700, 0, 0, 0, 0, 0, 0], 0.1, 50.0, on_trigger=True, tag=5)
    heard(display, streams)
    ((_, facts, stamp_ns),) = events.named("frame/5")
    assert facts["trigger_ns"] == edge_ns
    assert 0 < stamp_ns - edge_ns < 1_000_000


def test_marks_halts_and_changes_of_state_are_events() -> None:
    events = StandIn()
    streams = Streams(DaemonClock(is_here=True), events, StandIn())
    for state in ("SAFE", "SAFE", "ARMED"):
        streams.hear(StateReport(state=state, now_ns=5_000_000_000, engine="there"))
    streams.hear(Marked(marked_ns=6_000_000_000, tag=7, sync=True))
    streams.hear(Marked(marked_ns=7_000_000_000, tag=None, sync=False))
    streams.hear(Halt(cause="stop", source="wearer_stop", detail="", t_ns=8_000_000_000))
    told = [(sample[0], stamp_s) for sample, stamp_s in events.pushed]
    assert told == [
        *(("state/SAFE", 5.0), ("state/ARMED", 5.0), ("mark/7", 6.0), ("mark", 7.0)),
        ("halt/wearer_stop", 8.0),
    ]
    assert streams.events == len(told)
    assert json.loads(events.pushed[2][0][1])["sync"] is True


def test_the_other_computers_clock_and_a_fakes_lag_are_taken_into_account() -> None:
    """Its clock is 100 s ahead of the one here, as known within 1 ms; its board lags by 2 ms."""
    clock, events = DaemonClock(is_here=False), StandIn()
    clock.observe(sent_ns=0, got_ns=2_000_000, daemon_ns=100_001_000_000)
    streams = Streams(clock, events, StandIn())
    streams.hear(StateReport(state="SAFE", now_ns=0, engine="there", clock_lag_us=2_000))
    streams.hear(Marked(marked_ns=103_000_000_000, tag=1, sync=True))
    (name, facts), stamp_s = events.pushed[-1]
    told = json.loads(facts)
    assert (name, told["within_ns"], told["clock_lag_us"]) == ("mark/1", 1_000_000, 2_000)
    assert math.isclose(stamp_s, 3.002, abs_tol=1e-9)


def test_a_frame_is_one_event_however_often_it_is_told() -> None:
    events = StandIn()
    streams = Streams(DaemonClock(is_here=True), events, StandIn())
    for seq, begun_ns in ((1, 10), (1, 10), (2, 20), (1, 900)):
        for ended in (False, True):
            shown = Shown(
                seq=seq, tag=None, begun_ns=begun_ns, first_ns=begun_ns + 1, last_ns=99, ended=ended
            )
            streams.hear(scan_of(shown))
    assert [facts["seq"] for _, facts, _ in events.named("frame")] == [1, 2, 1]


def scan_of(shown: Shown) -> Scan:
    nothing: tuple[Any, ...] = (None,) * N
    fired = Fired(
        wanted_ua=(0,) * N,
        current_ua=(0,) * N,
        delivered_ua=(0,) * N,
        width_us=(0.0,) * N,
        voltage_v=nothing,
        resistance_ohm=nothing,
        contact=nothing,
    )
    return Scan(
        now_ns=0,
        shown=(shown,),
        seq=1,
        tag=None,
        scans=1,
        fired=fired,
        clamped=(),
        not_fired=(),
        ceiling_ua=0,
        dropped_reports=0,
    )
