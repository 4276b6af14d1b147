"""*Good* of whom it was measured how fast use is felt less, on the wires."""

from __future__ import annotations

import msgspec
import pytest

from etd.stabilize.said_electrode import RISE_A_MINUTE, fades_a_minute
from felt_scenes import ADAPTS, MakeRig, done, felt_rig, hold, last_ua, of_four, say

#: 5 % of the current in a minute of use, which is the most.
FADES = msgspec.structs.replace(ADAPTS, weaker_from_s=60.0)
HALF = 1.0 + (RISE_A_MINUTE - 1.0) / 2.0


def test_good_makes_up_for_what_was_measured_to_be_lost_in_use(make_rig: MakeRig) -> None:
    """Of half a minute."""
    assert fades_a_minute(60.0) == pytest.approx(0.0488, abs=0.001)
    rig = felt_rig(make_rig, may_raise=True, adaptation=FADES)
    before_ua = last_ua(rig)
    hold(rig, 28_000)
    assert done(say(rig, "good")) == ("raises", "")
    hold(rig, 1_000)
    assert before_ua * 1.018 < last_ua(rig) <= before_ua * HALF + 1.0


def test_a_cap_stays(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig, 2_010, may_raise=True, adaptation=FADES)
    hold(rig, 20_000, level=1.0)
    assert last_ua(rig) == pytest.approx(2_000, abs=2)
    say(rig, "good")
    hold(rig, 1_000, level=1.0)
    assert 2_005 < last_ua(rig) <= 2_010


def test_after_the_wearers_word_good_gives_back_no_more_than_that(make_rig: MakeRig) -> None:
    rig = felt_rig(make_rig, may_raise=True, adaptation=FADES)
    before_ua = last_ua(rig)
    hold(rig, 20_000)
    say(rig, "too_strong", lease=None)
    hold(rig, 61_000)
    for _ in range(2):
        say(rig, "good")
        hold(rig, 10_000)
    assert last_ua(rig) == pytest.approx(before_ua, abs=6)
    assert max(of_four(rig)) <= before_ua + 6


@pytest.mark.parametrize("weaker_from_s", [None, 60.0])
def test_good_raises_nothing_where_it_is_not_told_how_fast_or_not_allowed(
    make_rig: MakeRig, weaker_from_s: float | None
) -> None:
    measured = msgspec.structs.replace(ADAPTS, weaker_from_s=weaker_from_s)
    rig = felt_rig(make_rig, may_raise=weaker_from_s is None, adaptation=measured)
    before_ua = last_ua(rig)
    hold(rig, 28_000)
    assert done(say(rig, "good"))[0] == "nothing"
    hold(rig, 1_000)
    assert last_ua(rig) == before_ua
