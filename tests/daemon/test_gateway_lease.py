"""The gateway's first look at a lease.

Owns: whose it is, by token and by user.
"""

from __future__ import annotations

import pytest

from etd.gateway.lease import LeaseView
from etd.protocol.errors import Refused


def test_a_lease_belongs_to_the_user_who_opened_it() -> None:
    view = LeaseView()
    view.begin("token", "me", uid=1000)

    assert view.check("token", 1000).client == "me"
    for uid in (1001, None):
        with pytest.raises(Refused, match="another user") as refused:
            view.check("token", uid)
        assert refused.value.code == "other_lease"


def test_only_the_lease_that_ended_is_forgotten() -> None:
    view = LeaseView()
    view.begin("new", "me", uid=1)
    view.end("old", "lapsed")
    assert view.check("new", 1).token == "new"
    view.end("new", "halted")
    with pytest.raises(Refused, match="the last one ended: halted"):
        view.check("new", 1)


def test_a_token_outside_ascii_is_a_foreign_one() -> None:
    view = LeaseView()
    view.begin("token", "me", uid=1)
    with pytest.raises(Refused, match="me"):
        view.check("t\u00f6ken", 1)
