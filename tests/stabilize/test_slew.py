"""A factor that rises only so fast, and falls at once."""

from __future__ import annotations

from itertools import pairwise

from hypothesis import given
from hypothesis import strategies as st

from etd.pulse.measured import MAX_AGE_NS
from etd.stabilize.slew import LONGEST_STEP_NS, SlewLimiter

MS = 1_000_000


@given(steps=st.lists(st.tuples(st.floats(0.0, 4.0), st.integers(0, 2_000)), min_size=2))
def test_it_never_rises_faster_and_never_holds_a_fall_back(steps: list[tuple[float, int]]) -> None:
    slew, now_ns, found = SlewLimiter(1.0, 2.0), 0, []
    for wanted, pause_ms in steps:
        now_ns += pause_ms * MS
        reached = slew.toward(0, wanted, now_ns)
        assert reached <= wanted
        found.append(reached)
    for (before, after), (_, pause_ms) in zip(pairwise(found), steps[1:], strict=True):
        from_where = 1.0 if pause_ms * MS >= MAX_AGE_NS else before
        assert after <= from_where + 2.0 * LONGEST_STEP_NS / 1e9 + 1e-9


def test_electrodes_do_not_know_one_another() -> None:
    slew = SlewLimiter(0.0, 1.0)
    slew.toward(0, 1.0, 0)
    slew.toward(1, 1.0, 0)
    assert slew.toward(0, 1.0, 50 * MS) == 0.05
    assert slew.toward(1, 0.0, 50 * MS) == 0.0


def test_after_a_pause_it_starts_anew_from_above_and_from_below() -> None:
    for reached in (0.2, 3.0):
        slew = SlewLimiter(1.0, 20.0)
        for step in range(20):
            slew.toward(0, reached, step * 100 * MS)
        last_ns = 1_900 * MS
        assert slew.toward(0, 1.5, last_ns + MAX_AGE_NS) == 1.0
        slew.toward(0, reached, last_ns + MAX_AGE_NS + 1)
        assert slew.toward(0, reached, last_ns + 2 * MAX_AGE_NS) == min(reached, 3.0)


def test_after_forgetting_it_starts_anew() -> None:
    slew = SlewLimiter(1.0, 1.0)
    slew.toward(0, 0.0, 0)
    slew.reset()
    assert slew.toward(0, 1.0, 10 * MS) == 1.0
