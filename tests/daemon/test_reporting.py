"""What the engine tells: every frame begun, exactly once as ended, whatever is dropped."""

from __future__ import annotations

from dataclasses import dataclass, field

from hypothesis import given
from hypothesis import strategies as st

from engine_parts import frame
from etd.engine.reporting import Reporter, Row
from etd.protocol.link import Report
from etd.protocol.messages import Halt, Scan
from etd.protocol.outcome import Clamp

MS = 1_000_000
START_NS = 2_000 * MS


@dataclass
class Listener:
    """Takes reports while it is listening, drops them otherwise."""

    is_listening: bool = True
    reports: list[Report] = field(default_factory=list)

    def send(self, report: Report) -> bool:
        if self.is_listening:
            self.reports.append(report)
        return self.is_listening

    @property
    def scans(self) -> list[Scan]:
        return [report.scan for report in self.reports if report.scan is not None]


def reporter() -> tuple[Reporter, Listener]:
    listener = Listener()
    return Reporter(4, listener.send), listener


def row(commanded_ua: int, voltage_v: float, resistance_ohm: int) -> Row:
    delivered_ua = commanded_ua - 400
    measured = 99.7, voltage_v, resistance_ohm
    return 1_200, commanded_ua, delivered_ua, *measured, "soft", 0, 0, None, None, None


def test_a_scan_report_tells_the_frame_and_what_was_fired() -> None:
    made, listener = reporter()
    made.frame_begun(frame(seq=7, tag=3), START_NS)
    made.scan_begun()
    made.fired(2, START_NS + 5, row(1_000, 28.5, 50_000))
    made.fired(2, START_NS + 9, row(1_100, 29.5, 50_100))
    made.scan_report(START_NS + 10, 1_500)
    (scan,) = listener.scans
    (shown,) = scan.shown
    assert (shown.seq, shown.tag, shown.begun_ns, shown.ended) == (7, 3, START_NS, False)
    assert (shown.first_ns, shown.last_ns) == (START_NS + 5, START_NS + 9)
    assert (scan.seq, scan.tag, scan.scans, scan.ceiling_ua) == (7, 3, 1, 1_500)
    assert scan.fired.wanted_ua == (0, 0, 1_200, 0)
    assert scan.fired.current_ua == (0, 0, 1_100, 0)
    assert scan.fired.delivered_ua == (0, 0, 700, 0)
    assert scan.fired.contact == (None, None, "soft", None)
    assert scan.fired.width_us == (0.0, 0.0, 99.7, 0.0)
    assert scan.fired.voltage_v == (None, None, 29.5, None)
    assert scan.fired.resistance_ohm == (None, None, 50_100, None)


def test_a_frame_without_a_pulse_has_no_times() -> None:
    made, listener = reporter()
    made.frame_begun(frame(seq=7), START_NS)
    made.scan_report(START_NS, 0)
    assert (listener.scans[0].shown[0].first_ns, listener.scans[0].shown[0].last_ns) == (None, None)


def test_nothing_new_is_not_told_again() -> None:
    made, listener = reporter()
    made.scan_report(START_NS, 0)
    made.frame_begun(frame(), START_NS)
    made.scan_report(START_NS, 0)
    made.scan_report(START_NS + 500 * MS, 0)
    assert len(listener.scans) == 1


def test_reports_come_at_most_thirty_times_a_second() -> None:
    made, listener = reporter()
    for step in range(1_000):
        made.scan_begun()
        made.scan_report(START_NS + step * MS, 0)
    assert 29 <= len(listener.scans) <= 31
    assert sum(scan.scans for scan in listener.scans) >= 960


def test_a_silence_is_told_at_once() -> None:
    made, listener = reporter()
    made.frame_begun(frame(), START_NS)
    made.scan_report(START_NS, 0)
    made.frame_ended("expired", 0)
    made.scan_report(START_NS + 1, 0, is_due=True)
    assert listener.scans[-1].shown[0].ended


def test_a_new_frame_forgets_what_the_one_before_fired() -> None:
    made, listener = reporter()
    made.frame_begun(frame(seq=1), START_NS)
    made.fired(2, START_NS, row(1_000, 28.5, 50_000))
    made.frame_begun(frame(seq=2), START_NS + 1)
    made.scan_report(START_NS + 2, 0)
    assert listener.scans[0].fired.current_ua == (0, 0, 0, 0)
    assert [shown.seq for shown in listener.scans[0].shown] == [1, 2]


def test_clamps_and_skipped_pulses_are_told_once_by_electrode_and_reason() -> None:
    made, listener = reporter()
    for allowed_ua in (800, 700):
        made.clamped(
            Clamp(
                electrode=1, wanted_ua=900, allowed_ua=allowed_ua, reason="soft_start", limited_by=1
            )
        )
    made.clamped(Clamp(electrode=1, wanted_ua=900, allowed_ua=500, reason="cap", limited_by=1))
    made.not_fired(3, "ledger")
    made.not_fired(3, "ledger")
    made.not_fired(None, "overrun")
    made.scan_begun()
    made.scan_report(START_NS, 0)
    made.scan_begun()
    made.scan_report(START_NS + 100 * MS, 0)
    first, second = listener.scans
    assert [(clamp.reason, clamp.allowed_ua) for clamp in first.clamped] == [
        ("soft_start", 700),
        ("cap", 500),
    ]
    assert [
        (shortfall.electrode, shortfall.reason, shortfall.pulses) for shortfall in first.not_fired
    ] == [
        (3, "ledger", 2),
        (None, "overrun", 1),
    ]
    assert (second.clamped, second.not_fired) == ((), ())
    assert made.counters["clamped"] == 3
    assert made.counters["not_fired_ledger"] == 2


def test_what_was_dropped_comes_with_the_next_report_and_is_counted() -> None:
    made, listener = reporter()
    listener.is_listening = False
    made.frame_begun(frame(seq=1), START_NS)
    made.clamped(Clamp(electrode=1, wanted_ua=9, allowed_ua=5, reason="cap", limited_by=1))
    made.scan_report(START_NS, 0)
    made.frame_begun(frame(seq=2), START_NS + 1)
    listener.is_listening = True
    made.scan_report(START_NS + 100 * MS, 0)
    (scan,) = listener.scans
    assert [(shown.seq, shown.ended) for shown in scan.shown] == [(1, True), (2, False)]
    assert len(scan.clamped) == 1
    assert scan.dropped_reports == 1


def test_other_reports_that_are_dropped_are_counted_too() -> None:
    made, listener = reporter()
    listener.is_listening = False
    made.halt(Halt(cause="stop", source="me", detail="", t_ns=START_NS))
    assert made.counters["reports_dropped"] == 1


actions = st.lists(
    st.one_of(
        st.just("begin"),
        st.just("end"),
        st.just("report"),
        st.just("deaf"),
        st.just("hear"),
        st.just("due"),
    ),
    max_size=60,
)


@given(actions, st.lists(st.integers(1, 50), min_size=60, max_size=60))
def test_every_frame_begun_is_told_exactly_once_as_ended(
    steps: list[str], gaps_ms: list[int]
) -> None:
    made, listener = reporter()
    begun, now_ns = 0, START_NS
    for step, gap_ms in zip(steps, gaps_ms, strict=False):
        now_ns += gap_ms * MS
        if step == "begin":
            made.frame_begun(frame(seq=begun), now_ns)
            begun += 1
        elif step == "end":
            made.frame_ended("expired", 0)
        elif step in ("report", "due"):
            made.scan_report(now_ns, 0, is_due=step == "due")
        else:
            listener.is_listening = step == "hear"
    listener.is_listening = True
    made.frame_ended("expired", 0)
    made.scan_report(now_ns + 100 * MS, 0)
    ended = [shown.seq for scan in listener.scans for shown in scan.shown if shown.ended]
    assert ended == list(range(begun))


@dataclass
class Body:
    """A body that says what it is told to."""

    felt: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    pain: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0)
    asked: int = 0

    def take(self) -> Body:
        self.asked += 1
        return self


def modelled_in(listener: Listener) -> list[tuple[float, ...]]:
    return [report.modelled.felt for report in listener.reports if report.modelled is not None]


def test_what_a_body_is_modelled_to_feel_is_told_ten_times_a_second() -> None:
    made, listener = reporter()
    body = Body(felt=(0.0, 1.23456, 0.0, 0.0))
    for ms in range(1_000):
        made.modelled(body.take, START_NS + ms * MS)
    assert body.asked == 10
    assert modelled_in(listener) == [(0.0, 1.235, 0.0, 0.0)] * 10


def test_the_end_of_a_modelled_sensation_is_told_once() -> None:
    made, listener = reporter()
    body = Body(pain=(0.5, 0.0, 0.0, 0.0))
    made.modelled(body.take, START_NS)
    body.pain = (0.0, 0.0, 0.0, 0.0)
    for ms in range(100, 1_000, 100):
        made.modelled(body.take, START_NS + ms * MS)
    assert len(modelled_in(listener)) == 2
