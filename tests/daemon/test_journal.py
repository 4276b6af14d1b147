"""The log of a daemon: a line an event, and never a wait."""

from __future__ import annotations

import io
import threading
from collections import Counter

from etd.gateway.journal import SUM_UP_NS, Journal
from etd.gateway.lease import StandingLease
from etd.protocol.messages import Halt, StateReport


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
        journal.engine_lost()
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
    for state in ("SAFE", "ARMED") * 1_000:
        journal.state(report(state))
    stream.let_go.set()
    journal.close()
    told = stream.getvalue().splitlines()
    assert 1_000 <= len(told) <= 1_002
    assert journal.dropped == 2_000 - len(told)
