"""The one lease, on the machine's clock."""

from __future__ import annotations

import pytest

from etd.engine.timeouts import Timeouts
from etd.protocol.errors import Refused
from etd.protocol.opening import LeaseCalibration
from etd.safety.lease import Lease, calibrations_of, check_holder, check_seq
from etd.safety.limits import PersonLimits

NOW_NS = 7_000_000_000


def lease() -> Lease:
    made = Lease("mine", "player", PersonLimits((1_000,), 100, 100, None), Timeouts().lease_ns)
    made.renew(NOW_NS)
    return made


def test_a_lease_lasts_one_second_from_its_renewal() -> None:
    assert Timeouts().lease_ns == 1_000_000_000
    assert not lease().has_lapsed(NOW_NS + 999_999_999)
    assert lease().has_lapsed(NOW_NS + 1_000_000_000)


def test_a_lease_that_was_never_renewed_has_lapsed_from_the_first_moment() -> None:
    never = Lease("mine", "player", PersonLimits((1_000,), 100, 100, None), Timeouts().lease_ns)
    assert never.has_lapsed(0)


def test_a_lease_stands_with_its_calibrations_and_no_lease_with_none() -> None:
    named = (LeaseCalibration(name="P01", polarity="anodic", digest="0" * 64),)
    held = Lease("mine", "player", PersonLimits((1_000,), 100, 100, None), 1, named)
    assert calibrations_of(held) == named
    assert calibrations_of(lease()) == ()
    assert calibrations_of(None) == ()


def test_the_holder_is_known_by_the_token() -> None:
    held = lease()
    assert check_holder(held, "mine") is held


def test_another_token_is_told_who_holds_it() -> None:
    with pytest.raises(Refused, match="player") as refusal:
        check_holder(lease(), "yours")
    assert refusal.value.code == "other_lease"


def test_without_a_lease_everybody_is_told_so() -> None:
    with pytest.raises(Refused) as refusal:
        check_holder(None, "mine")
    assert refusal.value.code == "no_lease"


def test_seq_must_rise() -> None:
    held = lease()
    with pytest.raises(Refused, match="seq -1"):
        check_seq(held, -1)
    check_seq(held, 0)
    held.last_seq = 5
    check_seq(held, 6)
    for seq in (5, 4, 0):
        with pytest.raises(Refused, match=f"seq {seq}") as refusal:
            check_seq(held, seq)
        assert refusal.value.code == "old_seq"
