"""What phases may have left: of what each may have had, the end that is furthest from nothing."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from etd.firing import Flowed, left_pc

charges_pc = st.integers(0, 10**9)


@given(
    phases=st.lists(st.tuples(charges_pc, charges_pc).map(sorted), min_size=1, max_size=2),
    is_anodic=st.booleans(),
    parts=st.tuples(st.floats(0.0, 1.0), st.floats(0.0, 1.0)),
)
def test_no_phases_may_have_left_more_than_is_booked(
    phases: list[list[int]], is_anodic: bool, parts: tuple[float, float]
) -> None:
    left = left_pc(is_anodic=is_anodic, flowed=[Flowed(*each) for each in phases])
    had_pc = [
        least + part * (most - least) for (least, most), part in zip(phases, parts, strict=False)
    ]
    truth_pc = had_pc[0] - sum(had_pc[1:])
    assert abs(truth_pc) <= abs(left) + 1.0
    one_end_pc = phases[0][1] - sum(least for least, _ in phases[1:])
    other_end_pc = phases[0][0] - sum(most for _, most in phases[1:])
    assert (left if is_anodic else -left) in (one_end_pc, other_end_pc)
