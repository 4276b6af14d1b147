"""The gateway's first look at a lease.

Owns: whose it is, by token and by user.
"""

from __future__ import annotations

import pytest

from etd.gateway.lease import LeaseView, StandingLease
from etd.protocol.errors import Refused


def test_a_lease_belongs_to_the_user_who_opened_it() -> None:
    view = LeaseView()
    view.begin(StandingLease("token", "me", uid=1000))

    assert view.check("token", 1000).client == "me"
    for uid in (1001, None):
        with pytest.raises(Refused, match="another user") as refused:
            view.check("token", uid)
        assert refused.value.code == "other_lease"


def test_only_the_lease_that_ended_is_forgotten() -> None:
    view = LeaseView()
    view.begin(StandingLease("new", "me", uid=1))
    view.end("old", "lapsed")
    assert view.check("new", 1).token == "new"
    view.end("new", "halted")
    with pytest.raises(Refused, match="the last one ended: halted"):
        view.check("new", 1)


def test_the_last_lease_belongs_to_its_user_until_another_begins_or_the_engine_goes() -> None:
    view = LeaseView()
    view.begin(StandingLease("first", "me", uid=1))
    assert not view.has_ended("first", 1)
    view.end("first", "halted")
    assert view.has_ended("first", 1)
    assert not view.has_ended("first", 2)
    assert not view.has_ended("other", 1)
    view.begin(StandingLease("second", "me", uid=1))
    assert not view.has_ended("first", 1)
    view.end("second", "lapsed")
    view.reset()
    assert not view.has_ended("second", 1)


def test_seq_must_rise_and_the_first_may_be_0() -> None:
    view, lease = LeaseView(), StandingLease("token", "me", uid=1)
    for seq in (0, 5, 6):
        view.check_seq(lease, seq)
        lease.last_seq = seq
        with pytest.raises(Refused, match=f"seq {seq} follows {seq}") as refused:
            view.check_seq(lease, seq)
        assert refused.value.code == "old_seq"
    with pytest.raises(Refused, match="seq 5 follows 6"):
        view.check_seq(lease, 5)
    with pytest.raises(Refused, match="seq -1 follows -1"):
        view.check_seq(StandingLease("other", "me", uid=1), -1)


def test_with_the_engine_every_lease_is_gone() -> None:
    view = LeaseView()
    view.begin(StandingLease("token", "me", uid=1))
    view.reset()
    with pytest.raises(Refused, match="the last one ended: the engine is gone") as refused:
        view.check("token", 1)
    assert refused.value.code == "no_lease"
    assert not view.has_ended("token", 1)


def test_a_token_outside_ascii_is_a_foreign_one() -> None:
    view = LeaseView()
    view.begin(StandingLease("token", "me", uid=1))
    with pytest.raises(Refused, match="held by 'me'") as refused:
        view.check("t\u00f6ken", 1)
    assert refused.value.code == "other_lease"


def test_before_the_first_lease_there_is_none_that_could_end_or_has_ended() -> None:
    view = LeaseView()
    view.end("token", "lapsed")
    assert not view.has_ended("token", 1)
    with pytest.raises(Refused, match="none has been opened"):
        view.check("token", 1)
