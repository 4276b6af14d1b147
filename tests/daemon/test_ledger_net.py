"""Net charge, as a ledger books, corrects and takes it back: added up by hand.

On four electrodes of the same conductance, so that those that carry a pulse back share it evenly.
"""

from __future__ import annotations

import pytest

from etd.safety.ledger import Ledger
from ledger_parts import AMPLE, NOW_NS, SECOND_NS, book, bounds, entry

WORST_PC, PLANNED_PC, HAD_PC = 120_000, 90_000, 96_000


def net_pc(ledger: Ledger, now_ns: int = NOW_NS) -> list[float]:
    return [round(pc, 3) for pc in ledger.net.all(now_ns)]


def test_a_pulse_through_all_others_leaves_what_it_was_booked_at_and_then_what_it_had() -> None:
    ledger = Ledger(4, AMPLE)
    booking = ledger.book(entry(1, PLANNED_PC), NOW_NS, WORST_PC)
    assert net_pc(ledger) == [-40_000, 120_000, -40_000, -40_000]
    ledger.settle_net(booking, HAD_PC)
    assert net_pc(ledger) == [-32_000, 96_000, -32_000, -32_000]


def test_each_named_return_may_have_what_a_pulse_leaves_and_others_have_nothing_of_it() -> None:
    ledger = Ledger(4, AMPLE)
    booking = ledger.book(entry(0, PLANNED_PC, returns=(2, 3)), NOW_NS, WORST_PC)
    assert net_pc(ledger) == [120_000, 0, -120_000, -120_000]
    ledger.settle_net(booking, HAD_PC)
    assert net_pc(ledger) == [96_000, 0, -96_000, -96_000]


@pytest.mark.parametrize(
    ("returns", "before_pc"), [(None, [90_000, -30_000]), ((1,), [90_000, -90_000])]
)
def test_what_is_taken_back_has_left_nothing(
    returns: tuple[int, ...] | None, before_pc: list[float]
) -> None:
    ledger = Ledger(4, AMPLE)
    book(ledger, entry(0, PLANNED_PC, returns=returns), NOW_NS)
    assert net_pc(ledger)[:2] == before_pc
    ledger.take_back(ledger.book(entry(0, PLANNED_PC, returns=returns), NOW_NS, WORST_PC))
    assert net_pc(ledger)[:2] == before_pc


def test_anodic_and_cathodic_pulses_of_the_same_charge_leave_nothing() -> None:
    ledger = Ledger(4, AMPLE)
    book(ledger, entry(0, PLANNED_PC), NOW_NS)
    book(ledger, entry(0, PLANNED_PC, net_pc=-PLANNED_PC), NOW_NS)
    assert net_pc(ledger) == [0, 0, 0, 0]


def test_a_correction_of_its_charge_leaves_net_charge_as_it_is() -> None:
    """Which of two phases it was is not known to it."""
    for net, left_pc in ((0, 0), (PLANNED_PC, WORST_PC), (-PLANNED_PC, -WORST_PC)):
        ledger = Ledger(4, AMPLE)
        booking = ledger.book(entry(0, PLANNED_PC, net_pc=net), NOW_NS, WORST_PC)
        ledger.correct(booking, HAD_PC, NOW_NS)
        assert net_pc(ledger)[0] == left_pc


def test_what_did_not_balance_after_all_stays_on_either_side() -> None:
    ledger = Ledger(4, AMPLE)
    booking = ledger.book(entry(0, PLANNED_PC, net_pc=0), NOW_NS, WORST_PC)
    ledger.settle_net(booking, 45_000)
    assert net_pc(ledger) == [45_000, -15_000, -15_000, -15_000]
    ledger.settle_net(booking, -45_000)
    assert net_pc(ledger) == [-45_000, 15_000, 15_000, 15_000]
    ledger.settle_net(booking, 0)
    assert net_pc(ledger) == [0, 0, 0, 0]


def test_what_was_left_counts_as_of_when_the_pulse_was_booked() -> None:
    """Of what it had the third part and a little more, 1/e, is left after a second."""
    ledger = Ledger(4, AMPLE)
    booking = ledger.book(entry(0, PLANNED_PC), NOW_NS, WORST_PC)
    ledger.correct(booking, 100_000, NOW_NS + SECOND_NS // 2)
    ledger.settle_net(booking, 100_000)
    assert ledger.net.of(0, NOW_NS + SECOND_NS) == pytest.approx(36_787.944)


def test_a_pulse_that_would_leave_more_than_the_bound_does_not_fit() -> None:
    ledger = Ledger(4, bounds(net_charge_pc=251_000))
    for _ in range(2):
        assert ledger.first_violation(entry(0), NOW_NS) is None
        book(ledger, entry(0), NOW_NS)
    assert ledger.first_violation(entry(0), NOW_NS) == "net charge"
    assert ledger.first_violation(entry(0, net_pc=50_000), NOW_NS) is None
    assert ledger.first_violation(entry(0, net_pc=52_000), NOW_NS) == "net charge"
    assert ledger.first_violation(entry(0, net_pc=-100_000), NOW_NS) is None
    assert ledger.first_violation(entry(1), NOW_NS) is None


def test_a_named_return_that_would_have_more_than_the_bound_refuses_the_pulse() -> None:
    ledger = Ledger(4, bounds(net_charge_pc=251_000))
    for electrode in (0, 1):
        book(ledger, entry(electrode, returns=(3,)), NOW_NS)
    assert net_pc(ledger) == [100_000, 100_000, 0, -200_000]
    assert ledger.first_violation(entry(2, returns=(3,)), NOW_NS) == "net charge"
    assert ledger.first_violation(entry(2, returns=(1, 3)), NOW_NS) == "net charge"
    assert ledger.first_violation(entry(2, returns=(0, 1)), NOW_NS) is None


def test_what_balances_does_not_fit_while_phases_have_left_more_than_the_bound() -> None:
    """Neither of the electrode itself nor of one that would carry it back, until enough leaked."""
    ledger = Ledger(4, bounds(net_charge_pc=100_000))
    balanced = [entry(each, net_pc=0) for each in (0, 1)]
    named = entry(2, net_pc=0, returns=(3,))
    ledger.settle_net(ledger.book(balanced[0], NOW_NS, WORST_PC), -100_000)
    assert [ledger.first_violation(each, NOW_NS) for each in balanced] == [None, None]
    ledger.settle_net(ledger.book(balanced[0], NOW_NS, WORST_PC), -20_000)
    assert [ledger.first_violation(each, NOW_NS) for each in balanced] == ["net charge"] * 2
    assert ledger.first_violation(named, NOW_NS) is None
    ledger.settle_net(ledger.book(named, NOW_NS, WORST_PC), 150_000)
    assert ledger.first_violation(named, NOW_NS) == "net charge"
    assert ledger.first_violation(balanced[0], NOW_NS + SECOND_NS) is None
