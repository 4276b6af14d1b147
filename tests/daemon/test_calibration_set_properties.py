"""Whatever the calibrations of a set are, it is no less strict than each of them alone."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration_sets import N, made, person_of, planner_of
from engine_parts import frame
from etd.engine.returns import Returns
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.calibration import Calibration
from etd.protocol.frame import PHASES, POLARITIES
from etd.safety.ledger import Ledger
from ledger_parts import AMPLE
from path_readings import SOURCE

pytestmark = pytest.mark.slow

CAPS = st.tuples(*[st.integers(60, 2_500)] * N)
SETS = st.lists(st.sampled_from(POLARITIES), min_size=2, unique=True).flatmap(
    lambda kinds: st.tuples(*[st.builds(made, st.just(kind), CAPS) for kind in kinds])
)


@given(together=SETS, data=st.data())
def test_every_pulse_has_its_own_polaritys_cap_and_no_return_more_than_each_alone(
    together: tuple[Calibration, ...], data: st.DataObject
) -> None:
    """Over frames that give an electrode another polarity each time."""
    person = person_of(*together)
    planner = planner_of(*together)
    returns = Returns(N, SOURCE, Ledger(N, AMPLE))
    returns.set_caps(person.caps_ua)
    by_phases = {PHASES[alone.polarity]: alone for alone in together}
    for _ in range(3):
        kinds = data.draw(st.tuples(*[st.sampled_from([it.polarity for it in together])] * N))
        for scheduled in planner.plan(frame(current_ua=(50,) * N, polarity=kinds)).schedule:
            electrode, own = scheduled.electrode, by_phases[scheduled.phases]
            assert own.polarity == kinds[electrode]
            for path in (scheduled.path, returns.path_now(scheduled.path, 0)):
                assert path.cap_ua == own.electrode[electrode].cap_ua
                for alone in together:
                    others = [it.cap_ua for n, it in enumerate(alone.electrode) if n != electrode]
                    assert path.return_ua <= min(others)


@given(together=SETS)
def test_probes_returns_and_widths_are_bounded_by_the_strictest(
    together: tuple[Calibration, ...],
) -> None:
    person = person_of(*together)
    for alone in map(person_of, together):
        assert all(mine <= its for mine, its in zip(person.caps_ua, alone.caps_ua, strict=True))
        assert (person.width_us, person.accepted_us) == (alone.width_us, alone.accepted_us)


@given(together=SETS, levels=st.tuples(*[st.sampled_from([0.0, 0.3, 1.0])] * N), data=st.data())
def test_a_mixed_frame_asks_and_allows_no_more_than_each_calibration_alone(
    together: tuple[Calibration, ...], levels: tuple[float, ...], data: st.DataObject
) -> None:
    """The bounds of stabilizers included, and with the clamps foreseen."""
    kinds = data.draw(st.tuples(*[st.sampled_from([it.polarity for it in together])] * N))
    mixed = planner_of(*together).plan(frame(level=levels, polarity=kinds, allow_slower=True))
    allowed = {clamp.electrode: clamp.allowed_ua for clamp in mixed.clamped}
    for alone in together:
        own = tuple(
            level if kind == alone.polarity else 0.0
            for level, kind in zip(levels, kinds, strict=True)
        )
        plan = planner_of(alone).plan(frame(level=own, allow_slower=True))
        allowed_alone = {clamp.electrode: clamp.allowed_ua for clamp in plan.clamped}
        mine = {it.electrode: it for it in mixed.schedule if it.phases == PHASES[alone.polarity]}
        assert mine.keys() == {it.electrode for it in plan.schedule}
        for scheduled in plan.schedule:
            found = mine[scheduled.electrode]
            assert found.request == scheduled.request
            assert _bounds(found) == _bounds(scheduled)
            most_ua = allowed.get(found.electrode, found.current_ua)
            assert most_ua <= allowed_alone.get(found.electrode, scheduled.current_ua)


def _bounds(scheduled: ScheduledPulse) -> tuple[float, ...]:
    bounds = scheduled.bounds
    return bounds.current_ua, bounds.cap_us, bounds.width_us, bounds.charge_pc
