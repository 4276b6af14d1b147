"""What a user does in a loop takes no line of the log from a fault, or from another user."""

from __future__ import annotations

import io
import itertools
from collections import Counter

import pytest

from etd.gateway.inbound import InboundMessage
from etd.gateway.journal import SUM_UP_NS, Journal
from etd.gateway.lease import StandingLease
from etd.gateway.state_log import LASTING_NS
from etd.gateway.summed_up import MOST_APART, MOST_ONE_BY_ONE
from etd.protocol.messages import Arm, Clear, Halt, State, StateReport
from etd.protocol.who import who

FAULT = Halt(cause="fault", source="SpiError", detail="the transfer failed", t_ns=1)
#: Users who act together, more than are told apart.
MANY = range(2_001, 2_001 + 2 * MOST_APART)


class Story:
    """A gateway's log, told what an engine reports."""

    def __init__(self) -> None:
        self._stream = io.StringIO()
        self._journal = Journal("main", self._stream)
        self._lease: StandingLease | None = None
        self.now_ns = 1
        self.state("SAFE")

    def state(self, state: State, halt: Halt | None = None, last_disarm: str | None = None) -> None:
        report = StateReport(
            state=state, now_ns=self.now_ns, engine="there", halt=halt, last_disarm=last_disarm
        )
        self._journal.state(report, self._lease)

    def stop(self, uid: int, client: str = "") -> None:
        source = who(client, uid)
        halt = Halt(cause="stop", source=source, detail="asked to stop", t_ns=self.now_ns)
        self.halt(halt)

    def halt(self, halt: Halt) -> None:
        self.state("HALTED", halt)
        self.lease(None)

    def clear(self, by: int = 1000) -> None:
        self._ask(Clear(), by)
        self.state("SAFE")
        self.replied()

    def _ask(self, request: Clear | Arm, uid: int) -> None:
        self._asked = InboundMessage(1, (), uid, b"")
        self._journal.asked(request, self._asked)

    def replied(self, *, is_done: bool = True) -> None:
        self._journal.replied(self._asked, is_done=is_done)

    def answered(self, request: Clear | Arm, uid: int, *, is_done: bool = True) -> None:
        self._ask(request, uid)
        self.replied(is_done=is_done)

    def lease(self, standing: StandingLease | None) -> None:
        self._lease = standing
        self._journal.lease(standing)

    def open(self, uid: int, client: str) -> None:
        self.lease(StandingLease("t", client, uid))

    def arm(self, by: int = 1000) -> None:
        self._ask(Arm(), by)
        self.state("PROBE")
        self.state("ARMED")
        self.replied()

    def disarm(self) -> None:
        self.state("SAFE", last_disarm="disarmed")

    def record(self, uid: int, name: str) -> None:
        self._journal.record(name, None, uid)
        self._journal.record(None, None, uid)

    def sum_up(self) -> None:
        self._journal.refusals(Counter(), SUM_UP_NS)

    def lines(self) -> list[str]:
        self._journal.close()
        told = self._stream.getvalue().splitlines()
        return [line.removeprefix("etd main: ") for line in told]

    def events(self) -> list[str]:
        """The lines that are no summary."""
        return [line for line in self.lines() if not line.startswith("since the last summary")]


def test_a_fault_has_its_line_after_any_number_of_stops() -> None:
    story = Story()
    for _ in range(500):
        story.stop(2001)
        story.clear()
    story.halt(FAULT)
    story.clear()
    story.stop(2001)
    story.clear()
    story.sum_up()
    assert "HALTED by fault (SpiError): the transfer failed" in story.lines()


def test_a_halt_by_a_stop_line_has_its_line_after_any_number_of_faults() -> None:
    """A client may clear a fault in a loop that comes again at once."""
    story = Story()
    for _ in range(500):
        story.halt(FAULT)
        story.clear()
    story.halt(Halt(cause="wearer_stop", source="wearer_stop", detail="it opened", t_ns=1))
    story.sum_up()
    lines = story.lines()
    assert "HALTED by wearer_stop (wearer_stop): it opened" in lines
    more = f"{500 - MOST_ONE_BY_ONE} more halts by fault (SpiError)"
    assert any(line.startswith(f"since the last summary: {more}") for line in lines)


def test_another_halt_is_told_where_the_report_between_was_lost() -> None:
    story = Story()
    story.stop(2001)
    story.halt(FAULT)
    assert story.lines()[-1] == "HALTED by fault (SpiError): the transfer failed"


def test_stops_of_a_user_take_no_line_of_another_users() -> None:
    story = Story()
    for _ in range(500):
        story.stop(2001)
        story.clear()
    story.stop(1001, "study")
    story.sum_up()
    lines = story.lines()
    assert "HALTED by stop ('study' (user 1001)): asked to stop" in lines
    (summary,) = (line for line in lines if "more changes of state by user 2001" in line)
    assert summary == (
        f"since the last summary: {500 - MOST_ONE_BY_ONE} more changes of state by user 2001,"
        f" {500 - MOST_ONE_BY_ONE} of them HALTED; the last: HALTED by stop (user 2001): asked to"
        " stop"
    )


def test_stops_and_leases_hide_no_arming_and_not_the_stop_that_ends_it() -> None:
    story = Story()
    for number in range(500):
        story.stop(2001)
        story.clear()
        story.open(2001, f"c{number}")
        story.lease(None)
    story.open(2001, "EVIL")
    story.arm()
    story.stop(2001, "again")
    lines = story.events()
    assert lines[-2:] == [
        "ARMED by user 1000: the lease of 'EVIL' (user 2001)",
        "HALTED by stop ('again' (user 2001)): asked to stop",
    ]


@pytest.mark.parametrize("is_reported_meanwhile", [False, True])
def test_an_arming_that_lasts_has_its_lines_after_any_number_of_short_ones(
    is_reported_meanwhile: bool,
) -> None:
    story = Story()
    for number in range(500):
        story.open(2001, f"c{number}")
        story.arm()
        story.disarm()
    story.open(2001, "EVIL")
    story.arm()
    story.now_ns += LASTING_NS
    if is_reported_meanwhile:
        story.state("ARMED")
    story.disarm()
    story.sum_up()
    lines = story.lines()
    at = lines.index("ARMED by user 1000: the lease of 'EVIL' (user 2001)")
    assert lines[at + 1] == "SAFE: disarmed"
    more = 2 * 500 - MOST_ONE_BY_ONE
    assert any(f"{more} more beginnings and ends of ARMED by user 2001" in line for line in lines)


def test_a_fault_tells_whose_arming_it_ends_however_many_there_were() -> None:
    story = Story()
    for _ in range(500):
        story.open(2001, "loop")
        story.arm()
        story.disarm()
    story.open(2001, "last")
    story.arm()
    story.halt(FAULT)
    assert story.events()[-2:] == [
        "ARMED by user 1000: the lease of 'last' (user 2001)",
        "HALTED by fault (SpiError): the transfer failed",
    ]


def test_what_had_no_line_of_its_own_is_summed_up_at_the_end_too() -> None:
    story = Story()
    for _ in range(500):
        story.stop(2001)
        story.clear()
    assert f"{500 - MOST_ONE_BY_ONE} more changes of state by user 2001" in story.lines()[-2]


def test_leases_and_records_of_a_user_take_no_line_of_another_users() -> None:
    story = Story()
    for number in range(500):
        story.open(2001, f"c{number}")
        story.lease(None)
        story.record(2001, f"r{number}")
    story.open(1001, "study")
    story.record(1001, "P01")
    lines = story.events()
    assert "lease opened by 'study' (user 1001)" in lines
    assert lines[-2:] == ["record 'P01' begun", "record 'P01' ended"]


def test_the_log_of_many_users_who_act_together_is_bounded() -> None:
    """All that clients can make in a loop, between two summaries."""
    story = Story()
    numbers = itertools.count()
    for _ in range(100):
        for uid in MANY:
            story.open(uid, f"c{next(numbers)}")
            story.arm()
            story.disarm()
            story.lease(None)
            story.record(uid, f"r{next(numbers)}")
            story.stop(uid)
            story.clear()
            story.halt(FAULT)
            story.clear()
    story.sum_up()
    kinds = 6  # leases opened, leases ended, records, changes, armings, halts
    assert len(story.lines()) <= kinds * (MOST_APART + 1) * (MOST_ONE_BY_ONE + 1)


def test_who_cleared_and_who_armed_is_named_and_whose_lease_it_was() -> None:
    story = Story()
    story.stop(2001)
    story.clear(by=1000)
    story.open(2001, "study (user 1000)")
    story.arm(by=1002)
    assert story.lines()[-4:] == [
        "SAFE: the halt was cleared by user 1000",
        "lease opened by 'study (user 1000)' (user 2001)",
        "PROBE",
        "ARMED by user 1002: the lease of 'study (user 1000)' (user 2001)",
    ]


def test_what_was_refused_names_nobody() -> None:
    story = Story()
    story.stop(2001)
    story.answered(Clear(), 1001, is_done=False)
    story.state("SAFE")
    story.answered(Clear(), 1001, is_done=False)
    story.answered(Arm(), 1001)
    assert story.lines()[-1] == "SAFE: the halt was cleared"


def test_a_change_whose_answer_was_lost_is_told_before_the_next_one() -> None:
    story = Story()
    story.stop(2001)
    story.state("SAFE")
    story.stop(1001)
    story.answered(Clear(), 2001)
    assert story.lines()[-2:] == [
        "SAFE: the halt was cleared",
        "HALTED by stop (user 1001): asked to stop",
    ]


def test_clears_of_a_user_take_no_line_of_another_users() -> None:
    story = Story()
    for _ in range(500):
        story.stop(2001)
        story.clear(by=2002)
    story.stop(2001)
    story.clear(by=1001)
    assert story.events()[-1] == "SAFE: the halt was cleared by user 1001"
