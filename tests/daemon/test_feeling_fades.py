"""What *good* makes up for: by the calibrations of the lease, where the body site allows it."""

from __future__ import annotations

import datetime

import pytest
from msgspec.structs import replace

from engine_parts import calibration
from etd.engine.feeling import Feeling
from etd.protocol.adaptation import MeasuredAdaptation
from etd.protocol.felt import FeltDone
from etd.protocol.link import SayFelt

S = 1_000_000_000
DAY = datetime.date(2025, 1, 15)
#: *Weaker* after four minutes: 7.5 % of the current in four, as a logarithm.
SLOW = MeasuredAdaptation(
    answers=20, weaker=16, stronger=1, use_s=600.0, weaker_from_s=240.0, date=DAY
)
FAST = replace(SLOW, weaker_from_s=120.0)
UNTOLD = replace(SLOW, weaker_from_s=None)


def after_half_a_minute(
    *measured: MeasuredAdaptation | None, may_raise: bool = True
) -> tuple[FeltDone, float]:
    """The reply to *good* then, and the factor that follows."""
    feeling = Feeling(1, may_raise=may_raise)
    feeling.lease_begun(tuple([calibration(1, adaptation=each, date=DAY) for each in measured]))
    for second in range(31):
        feeling.fired(0, 1.0, second * S, 1_000, 1_000, 1_000)
    done = feeling.hear(SayFelt(ref=1, answer="good", lease="a"), 30 * S)
    return done, feeling.factor(0, 30 * S)


@pytest.mark.parametrize(("measured", "lost"), [(SLOW, 0.075 / 8.0), (FAST, 0.075 / 4.0)])
def test_it_makes_up_for_what_was_measured_to_be_lost_by_then(
    measured: MeasuredAdaptation, lost: float
) -> None:
    done, factor = after_half_a_minute(measured)
    assert (done.did, done.reason) == ("raises", "")
    assert 1.0 + 0.75 * lost < factor < 1.0 + 1.05 * lost


def test_of_several_calibrations_the_slowest_counts() -> None:
    assert after_half_a_minute(FAST, SLOW) == after_half_a_minute(SLOW)
    assert after_half_a_minute(SLOW, FAST) == after_half_a_minute(SLOW)


@pytest.mark.parametrize("measured", [(UNTOLD,), (FAST, UNTOLD), (UNTOLD, FAST), (FAST, None), ()])
def test_it_raises_nothing_where_one_of_them_does_not_tell(
    measured: tuple[MeasuredAdaptation | None, ...],
) -> None:
    done, factor = after_half_a_minute(*measured)
    assert (done.did, factor) == ("nothing", 1.0)


def test_it_raises_nothing_where_the_body_site_does_not_allow_it() -> None:
    done, factor = after_half_a_minute(FAST, may_raise=False)
    assert (done.did, factor) == ("nothing", 1.0)
