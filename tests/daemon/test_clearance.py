"""A clearance that keeps what it cleared last clears what one without a memory does."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import product

import pytest

import engine_rig
from engine_parts import currents, frame, planner
from etd.engine.clearance import Clearance
from etd.engine.components import Components
from etd.planning.schedule import AfterProbe, DuePulse
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.pulse.request import PulseRequest
from etd.safety.bookings import Entry
from etd.safety.conductance import Reading, Whole
from etd.safety.ledger import Bounds, Ledger
from plain_records import told

pytestmark = pytest.mark.slow

N = 16
ELECTRODE = 3
REQUEST = PulseRequest(800, 100)
AGAIN = PulseRequest(800, 100)
WEAKER = PulseRequest(700, 100)
STRONG, WEAK = (
    planner().plan(frame(current_ua=currents(e3=ua), width_us=100, rate_hz=20.0)).schedule[0]
    for ua in (800, 600)
)
Change = Callable[[Components], object]


def touches(node_v: float) -> Change:
    return lambda parts: parts.contact.update_touch(ELECTRODE, 400, node_v, parts.clock.now_ns())


def share_falls(parts: Components) -> None:
    """Two more contacts become known, between two updates of what follows from them."""
    share, now_ns = parts.returns.share, parts.clock.now_ns()
    whole = Whole(400.0, 8.0, 8.0, 8.0, 0.0, 19_000.0, 0.0)
    for electrode in (5, 6, 7):
        share.update(electrode, True, now_ns, Reading(400.0, 19_000.0, 21_000.0, whole))
    share.refresh(now_ns + 10_000_000)


def low_charge(parts: Components) -> None:
    parts.maxima.now = replace(parts.maxima.now, charge_pc=50_000)


CHANGES: dict[str, Change] = {
    "nothing": lambda parts: None,
    "it is open": touches(120.0),
    "a re-contact": lambda parts: parts.soft_start.touched_again(ELECTRODE),
    "low caps": lambda parts: parts.returns.set_caps((3_000, 300, *(3_000,) * (N - 2))),
    "another share": share_falls,
    "low maxima": low_charge,
    "a calibration": lambda parts: parts.board.calibrate(),
}


def unbound(parts: Components) -> None:
    """Nothing but the request and the ceiling bounds a pulse then."""
    parts.returns.set_caps((3_000,) * N)
    parts.maxima.follow(20, 200)
    parts.soft_start.restart()
    touches(3.0)(parts)


PULSES = [
    (DuePulse(scheduled, "stimulus", 0, after=after), request, ceiling_ua)
    for scheduled, request, ceiling_ua, after in product(
        (STRONG, WEAK),
        (REQUEST, AGAIN, WEAKER),
        (5_000, 750),
        (None, AfterProbe(REQUEST, 100, 0, 5_000)),
    )
]


@pytest.fixture(scope="module")
def parts() -> Iterator[Components]:
    rig = engine_rig.make(electrodes=N)
    rig.open()
    rig.arm()
    # The engine takes no turn here: the stopper would find it silent, and cut amid calibrations.
    rig.stopper.is_looking = False
    yield rig.engine.components
    rig.close()


def new_clearance(parts: Components, ledger: Ledger | None = None) -> Clearance:
    return Clearance(
        parts.board,
        parts.maxima,
        ledger or parts.ledger,
        parts.soft_start,
        parts.contact,
        parts.returns,
        parts.reporter,
        parts.feeling,
    )


@pytest.mark.parametrize("change", CHANGES)
def test_what_is_cleared_does_not_depend_on_what_was_cleared_before(
    parts: Components, change: str
) -> None:
    now_ns = parts.clock.now_ns()
    # A calibration takes as long as all else here: every seventh pair has each pulse on both sides.
    step = 7 if change == "a calibration" else 1
    for before, asked in list(product(PULSES, PULSES))[::step]:
        unbound(parts)
        clearance = new_clearance(parts)
        assert clearance.limit(*before, now_ns) is not None
        CHANGES[change](parts)
        found, fresh = (each.limit(*asked, now_ns) for each in (clearance, new_clearance(parts)))
        assert told(found) == told(fresh)
        assert (found and found.pulse) is (fresh and fresh.pulse)


@pytest.mark.parametrize("after", [None, AfterProbe(REQUEST, 100, 0, 5_000)])
def test_a_pulse_as_the_one_before_is_not_made_again(
    parts: Components, after: AfterProbe | None
) -> None:
    unbound(parts)
    clearance, now_ns = new_clearance(parts), parts.clock.now_ns()
    due = DuePulse(STRONG, "stimulus", 0, after=after)
    first = clearance.limit(due, REQUEST, 5_000, now_ns)
    assert first is not None
    assert clearance.limit(due, AGAIN, 5_000, now_ns) is first


def test_nor_is_its_probe_and_the_ledger_is_asked_for_both(parts: Components) -> None:
    unbound(parts)
    clearance, now_ns = new_clearance(parts), parts.clock.now_ns()
    due, probe = DuePulse(STRONG, "stimulus", 0), PulseRequest(100, 50)
    cleared = clearance.limit(due, REQUEST, 5_000, now_ns)
    assert cleared is not None
    first = clearance.fit(due, cleared, probe, now_ns)
    assert first is not None
    assert (first.leads, first.given, first.entry.charge_pc) == (True, probe, probe.charge_pc)
    assert clearance.fit(due, cleared, probe, now_ns) is first
    other = PulseRequest(100, 60)
    assert told(clearance.fit(due, cleared, other, now_ns)) == told(
        new_clearance(parts).fit(due, cleared, other, now_ns)
    )


@pytest.mark.parametrize("what", ["charge", "net charge"])
def test_a_pulse_has_room_where_its_probe_has_room_too(parts: Components, what: str) -> None:
    unbound(parts)
    ledger = Ledger(N, Bounds.of(parts.maxima.now))
    clearance, now_ns = new_clearance(parts, ledger), parts.clock.now_ns()
    due, probe = DuePulse(STRONG, "stimulus", 0), PulseRequest(300, 50)
    cleared = clearance.limit(due, REQUEST, 5_000, now_ns)
    assert cleared is not None
    maxima, led_pc = parts.maxima.now, cleared.entry.charge_pc + probe.charge_pc // 2
    bound_pc = maxima.mean_current_ua * 1_000_000 if what == "charge" else maxima.net_charge_pc
    left_pc = bound_pc - led_pc
    way = 0 if what == "charge" else cleared.entry.net_pc // cleared.entry.charge_pc
    ledger.book(Entry(ELECTRODE, left_pc, 0, None, 0.0, 0, way * left_pc), now_ns, left_pc)
    assert clearance.fit(due, cleared, None, now_ns) is cleared
    assert clearance.fit(due, cleared, probe, now_ns) is None
    assert ledger.first_violation(cleared.entry, now_ns) is None


def test_a_pulse_and_its_probe_together_keep_the_charge_of_a_pulse(parts: Components) -> None:
    unbound(parts)
    now_ns, probe = parts.clock.now_ns(), PulseRequest(300, 50)
    led = ScheduledPulse(
        STRONG.electrode,
        STRONG.selection,
        STRONG.request,
        STRONG.phases,
        STRONG.rate_hz,
        STRONG.returns,
        STRONG.path,
        STRONG.bounds,
        probe,
    )
    given = parts.maxima.now
    parts.maxima.now = replace(given, charge_pc=REQUEST.charge_pc + probe.charge_pc // 2)
    try:
        alone, both = (
            new_clearance(parts).limit(DuePulse(one, "stimulus", 0), REQUEST, 5_000, now_ns)
            for one in (STRONG, led)
        )
    finally:
        parts.maxima.now = given
    assert alone is not None
    assert both is not None
    assert (alone.clamp, alone.given.current_ua) == (None, REQUEST.current_ua)
    assert both.clamp is not None
    assert both.given.charge_pc + probe.charge_pc <= REQUEST.charge_pc + probe.charge_pc // 2
