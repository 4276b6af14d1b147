"""What all electrodes want in common for long: taken back from everybody, and told."""

from __future__ import annotations

import math
from collections.abc import Callable
from statistics import median

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.stabilize.common_mode import QUORUM, CommonMode
from etd.stabilize.pipeline import ignore_rejection
from etd.stabilize.plausibility import Plausibility

N, SCAN_MS = 16, 100
Wanted = Callable[[int, float], float]


def played(common: CommonMode, wanted: Wanted, seconds: float, electrodes: int = N) -> list[float]:
    """Scan after scan; of the last one what is left of each electrode's want."""
    left: list[float] = []
    for scan in range(round(seconds * 1_000 / SCAN_MS)):
        now_ns = scan * SCAN_MS * 1_000_000
        left = [
            common.without_common(
                electrode, wanted(electrode, now_ns * 1e-9), now_ns + electrode * 1_000_000
            )
            for electrode in range(electrodes)
        ]
    return left


def test_what_all_want_alike_is_taken_back_and_told_once() -> None:
    told: list[str] = []
    left = played(CommonMode(told.append), lambda electrode, at_s: 1.5, 5.0)
    assert left == pytest.approx([1.0] * N)
    assert told == ["common"]


def test_it_is_told_anew_only_when_it_had_gone() -> None:
    told: list[str] = []
    common = CommonMode(told.append)
    played(common, lambda electrode, at_s: 1.5 if at_s < 60.0 or at_s > 160.0 else 1.0, 240.0)
    assert told == ["common", "common"]


def test_one_electrode_that_is_wetter_than_the_others_is_still_answered() -> None:
    left = played(
        CommonMode(ignore_rejection), lambda electrode, at_s: 1.4 if electrode == 3 else 1.0, 60.0
    )
    assert left[3] == pytest.approx(1.4)


def test_who_wants_more_than_the_others_is_still_answered_and_nobody_comes_below_the_frame() -> (
    None
):
    left = played(
        CommonMode(ignore_rejection), lambda electrode, at_s: 1.4 * (1.0 + electrode / N), 60.0
    )
    assert median(left) == pytest.approx(1.0, abs=0.04)
    assert min(left) == 1.0
    assert left[-1] == pytest.approx((2.0 - 1.0 / N) / (1.5 - 0.5 / N), rel=1e-3)


def test_sound_electrodes_keep_their_own_beside_bad_ones() -> None:
    bad = {0: 1.5, 1: 1.5}
    left = played(
        CommonMode(ignore_rejection), lambda electrode, at_s: bad.get(electrode, 1.0), 60.0, QUORUM
    )
    assert left[2:] == [1.0] * (QUORUM - 2)
    assert max(left) < 1.3


def test_when_it_is_over_nobody_gets_less_than_the_frame_wants() -> None:
    common = CommonMode(ignore_rejection)
    played(common, lambda electrode, at_s: 1.35, 60.0)
    after = [common.without_common(electrode, 1.0, 60_000_000_000) for electrode in range(N)]
    assert after == [1.0] * N


@pytest.mark.parametrize("pause_s", [1, 3_600])
def test_what_many_told_is_forgotten_when_only_few_ask(pause_s: int) -> None:
    common = CommonMode(ignore_rejection)
    played(common, lambda electrode, at_s: 1.35, 30.0)
    later_ns = (30 + pause_s) * 1_000_000_000
    assert common.without_common(0, 1.35, later_ns) == 1.35
    played_again = [
        common.without_common(electrode, 1.35, later_ns + 100_000_000 * scan)
        for scan in range(1, 5)
        for electrode in range(N)
    ]
    assert played_again[-1] == pytest.approx(1.0), "and is known again when many do"


def test_a_finger_that_presses_harder_and_lighter_is_answered() -> None:
    common = CommonMode(ignore_rejection)
    played(
        common, lambda electrode, at_s: math.exp(0.3 * math.sin(2 * math.pi * at_s / 9.0)), 56.25
    )
    pressed_hardest = common.without_common(0, math.exp(0.3), 56_250_000_000)
    assert pressed_hardest > 1.25


def test_what_narrows_is_not_given_back() -> None:
    assert played(CommonMode(ignore_rejection), lambda electrode, at_s: 0.7, 30.0) == pytest.approx(
        [0.7] * N
    )


def test_few_electrodes_have_nothing_in_common_that_skin_could_not_have() -> None:
    few = QUORUM - 1
    assert played(
        CommonMode(ignore_rejection), lambda electrode, at_s: 1.5, 30.0, few
    ) == pytest.approx([1.5] * few)


def test_who_has_not_asked_for_a_second_has_no_vote() -> None:
    common = CommonMode(ignore_rejection)
    played(common, lambda electrode, at_s: 1.0, 1.0)
    later_ns = 3_000_000_000
    left = [
        common.without_common(electrode, 1.5, later_ns + scan * SCAN_MS * 1_000_000)
        for scan in range(600)
        for electrode in range(QUORUM)
    ]
    assert left[-1] == pytest.approx(1.0, abs=0.05)


@given(
    st.lists(
        st.tuples(st.integers(0, 7), st.floats(1e-3, 1e3), st.integers(0, 5_000_000_000)),
        max_size=60,
    )
)
def test_nobody_gets_more_than_the_law_wants_or_less_than_the_frame_for_it(
    asked: list[tuple[int, float, int]],
) -> None:
    trust, now_ns = Plausibility(1.5, ignore_rejection), 0
    for electrode, wanted, elapsed_ns in asked:
        now_ns += elapsed_ns
        assert min(1.0, wanted) <= trust.plausible(electrode, wanted, now_ns) <= wanted
