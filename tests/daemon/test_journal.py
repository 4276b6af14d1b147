"""The log of a daemon: a line an event, and never a wait."""

from __future__ import annotations

import io
import threading
import unicodedata
from collections import Counter

from hypothesis import given
from hypothesis import strategies as st

from etd.gateway.journal import SUM_UP_NS, Journal
from etd.gateway.lease import StandingLease
from etd.protocol.messages import Halt, StateReport
from scripted_engine import engine_hello


def report(state: str, **fields: object) -> StateReport:
    return StateReport(state=state, now_ns=1, engine="there", **fields)  # type: ignore[arg-type]


def lines_of(journal: Journal, stream: io.StringIO) -> list[str]:
    journal.close()
    return stream.getvalue().splitlines()


def test_each_change_of_state_is_one_line_with_its_cause() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    halt = Halt(cause="stop", source="operator", detail="asked to stop", t_ns=1)
    for said in (
        report("SAFE"),
        report("SAFE"),
        report("ARMED"),
        report("HALTED", halt=halt),
        report("SAFE", last_disarm="halted by stop: asked to stop"),
        report("ARMED"),
        report("SAFE", last_disarm="lapsed"),
    ):
        journal.state(said)
    assert lines_of(journal, stream) == [
        "etd main: SAFE",
        "etd main: ARMED",
        "etd main: HALTED by stop (operator): asked to stop",
        "etd main: SAFE: the halt was cleared",
        "etd main: ARMED",
        "etd main: SAFE: lapsed",
    ]


def test_what_was_not_granted_is_told_once_for_each_engine() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    for _ in range(2):
        for state in ("SAFE", "ARMED", "SAFE"):
            journal.state(report(state, not_granted=("no real time",)))
        journal.engine_lost(is_cut_off=False)
    assert [line for line in lines_of(journal, stream) if "no real time" in line] == [
        "etd main: no real time"
    ] * 2


def test_an_event_is_one_line_whatever_text_it_quotes() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    forged = "x\n\x1b[31metd main: ARMED"
    halt = Halt(cause="stop", source=forged, detail="asked to stop", t_ns=1)
    journal.state(report("HALTED", halt=halt))
    journal.state(report("SAFE", last_disarm=forged, not_granted=(forged,)))
    lines = lines_of(journal, stream)
    assert len(lines) == 3
    assert all(line.isprintable() for line in lines)


def test_what_is_not_believed_is_told_once_while_a_board_is_live() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    for state, count in (("ARMED", 0), ("ARMED", 1), ("ARMED", 2), ("SAFE", 2), ("ARMED", 2)):
        journal.state(report(state, counters={"rejected_flicker": count}))
    journal.state(report("ARMED", counters={"rejected_flicker": 3}))
    told = [line for line in lines_of(journal, stream) if "not stabilized" in line]
    why = "resistances flicker (a noisy ADC, a shaking hand)"
    assert told == [f"etd main: not stabilized for a while: {why}"] * 2


def test_next_to_nothing_for_long_is_told_once_and_not_as_if_it_were_given_up() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    for count in (0, 1, 2):
        journal.state(report("ARMED", counters={"rejected_narrow": count}))
    (told,) = [line for line in lines_of(journal, stream) if "almost nothing" in line]
    assert "not stabilized" not in told


def test_a_pulse_that_a_probe_withheld_is_told_once_while_a_board_is_live() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    for count in (0, 1, 2):
        journal.state(report("ARMED", counters={"probes_alone": count}))
    (told,) = [line for line in lines_of(journal, stream) if "withheld" in line]
    assert "not stabilized" not in told


def test_a_lease_is_told_when_it_begins_and_when_it_ends() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    lease = StandingLease("t", "player", 1000)
    for standing in (lease, lease, None):
        journal.lease(standing)
    assert lines_of(journal, stream) == [
        "etd main: lease opened by 'player' (user 1000)",
        "etd main: lease of 'player' ended",
    ]


def test_a_thousand_leases_are_a_few_lines_and_a_count() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    for number in range(1_000):
        if number == 700:
            journal.lease(StandingLease("t", "newcomer", 1001))
            journal.lease(None)
        journal.lease(StandingLease("t", "loop", 1000))
        journal.lease(None)
    journal.refusals(Counter(), SUM_UP_NS)
    lines = lines_of(journal, stream)
    assert len(lines) <= 50
    assert lines[:2] == [
        "etd main: lease opened by 'loop' (user 1000)",
        "etd main: lease of 'loop' ended",
    ]
    assert "etd main: lease opened by 'newcomer' (user 1001)" in lines
    told = sum(line.startswith("etd main: lease opened by 'loop'") for line in lines)
    assert lines[-1] == (
        f"etd main: since the last summary: {1_000 - told} more leases opened by user 1000; the"
        " last: lease opened by 'loop' (user 1000)"
    )


def test_a_thousand_names_are_a_few_lines_too_and_the_holder_is_told() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    for number in range(1_000):
        journal.lease(StandingLease("t", f"loop {number}", 1000))
    journal.refusals(Counter(), SUM_UP_NS)
    journal.lease(None)
    journal.lease(StandingLease("t", "after", 1000))
    lines = lines_of(journal, stream)
    assert len(lines) <= 50
    opened = [line for line in lines if line.startswith("etd main: lease opened by")]
    untold = 1_001 - len(opened)
    assert any(f"{untold} more leases opened by user 1000" in line for line in lines)
    assert lines[-3:] == [
        "etd main: the lease is now held by 'loop 999' (user 1000)",
        "etd main: lease of 'loop 999' ended",
        "etd main: lease opened by 'after' (user 1000)",
    ]


def test_a_loop_of_stops_and_clears_is_bounded_and_the_last_state_is_told() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    for number in range(1_000):
        halt = Halt(cause="stop", source="client", detail=f"stop {number}", t_ns=1)
        journal.state(report("HALTED", halt=halt))
        journal.state(report("SAFE"))
    journal.state(report("HALTED", halt=halt))
    journal.refusals(Counter(), SUM_UP_NS)
    lines = lines_of(journal, stream)
    assert len(lines) <= 50
    assert lines[0] == "etd main: HALTED by stop (client): stop 0"
    halts = sum(line.startswith("etd main: HALTED") for line in lines)
    (last,) = (line for line in lines if "of them HALTED" in line)
    assert f"{1_001 - halts} of them HALTED" in last
    assert last.endswith("the last: HALTED by stop (client): stop 999")


def test_a_loop_of_records_is_bounded_and_the_last_is_told() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    for number in range(1_000):
        journal.record(f"r{number}", None, 1000)
        journal.record(None, "the disk is full" if number == 999 else None, 1000)
    journal.refusals(Counter(), SUM_UP_NS)
    journal.record("after", None)
    lines = lines_of(journal, stream)
    assert len(lines) <= 50
    assert lines[:2] == ["etd main: record 'r0' begun", "etd main: record 'r0' ended"]
    told = len(lines) - 2
    assert lines[-2] == (
        f"etd main: since the last summary: {2_001 - told} more lines of records by user"
        " 1000; the last: record 'r999' ended"
    )
    assert "etd main: the disk is full" in lines
    assert lines[-1] == "etd main: record 'after' begun"


def test_an_engine_that_comes_and_goes_in_a_loop_is_told_in_short() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    for _ in range(1_000):
        journal.engine_found(engine_hello())
        journal.engine_lost(is_cut_off=False)
    journal.refusals(Counter(), SUM_UP_NS)
    lines = lines_of(journal, stream)
    assert len(lines) <= 50
    assert lines[0].startswith("etd main: engine there: scripted (fake), 4 electrodes")
    assert "990 of them gone; the last: engine gone" in lines[-1]


TEXT = st.text(max_size=50) | st.sampled_from(["\n", "\x1b[2J", "x\netd main: ARMED", "a" * 5_000])


@given(said=st.lists(TEXT, min_size=10, max_size=10))
def test_no_text_of_a_client_makes_a_line_or_a_sign_of_its_own(said: list[str]) -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    halt = Halt(cause="stop", source=said[0], detail=said[1], t_ns=1)
    journal.state(report("HALTED", halt=halt, not_granted=(said[2],)))
    journal.state(report("SAFE", last_disarm=said[3], sensor_problems={said[4]: said[5]}))
    journal.lease(StandingLease("t", said[6], 1000))
    journal.lease(None)
    journal.record(said[7], None)
    journal.record(None, said[8])
    journal.refusals(Counter({said[9]: 1}), SUM_UP_NS)
    journal.close()
    text = stream.getvalue()
    assert text.endswith("\n")
    lines = text[:-1].split("\n")
    assert all(line.startswith("etd main: ") for line in lines)
    assert len(lines) <= 10
    for line in lines:
        assert all(
            unicodedata.category(sign) not in ("Cc", "Cf", "Cs", "Zl", "Zp") for sign in line
        )
        assert len(line) <= 1_100


def test_refusals_are_summed_up_and_not_told_one_by_one() -> None:
    stream = io.StringIO()
    journal = Journal("main", stream)
    counters = Counter({"malformed": 1})
    journal.refusals(counters, SUM_UP_NS)
    counters["malformed"] += 5
    journal.refusals(counters, SUM_UP_NS + 1)
    journal.refusals(counters, 2 * SUM_UP_NS)
    assert lines_of(journal, stream) == [
        "etd main: since the last summary: 1 malformed",
        "etd main: since the last summary: 5 malformed",
    ]


class Blocked(io.StringIO):
    """Takes nothing until it is let go: a journal that hangs."""

    def __init__(self) -> None:
        super().__init__()
        self.let_go = threading.Event()

    def write(self, text: str) -> int:
        self.let_go.wait(10)
        return super().write(text)


def test_a_log_that_cannot_be_written_drops_lines_and_tells_how_many() -> None:
    stream = Blocked()
    journal = Journal("main", stream)
    for _ in range(2_000):
        journal.asked_to_end()
    stream.let_go.set()
    journal.close()
    told = stream.getvalue().splitlines()
    assert 1_000 <= len(told) <= 1_002
    assert journal.dropped == 2_000 - len(told)
