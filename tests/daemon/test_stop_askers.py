"""Who may lift a stop: who alone asked for it, or an operator, in whatever order it was asked."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_rig import EngineRig
from etd.protocol.errors import Refused
from etd.protocol.link import ClearHalt, StopNow
from etd.safety.stop_askers import StopAskers

MakeRig = Callable[..., EngineRig]
USERS = st.integers(min_value=0, max_value=3)


def may(askers: StopAskers, uid: int | None, *, is_operator: bool = False) -> bool:
    try:
        askers.check(uid, is_operator=is_operator)
    except Refused as refused:
        return refused.code != "not_permitted"
    return True


@given(asked=st.lists(st.none() | USERS), uid=st.none() | USERS)
def test_a_user_lifts_no_stop_but_their_own(asked: list[int | None], uid: int | None) -> None:
    askers = StopAskers()
    for one in asked:
        askers.asked(one)
    assert may(askers, uid) == all(one in (None, uid) for one in asked)
    assert may(askers, uid, is_operator=True)
    askers.lifted()
    assert may(askers, 99)


def test_the_refusal_names_who_asked_and_who_can_lift_it() -> None:
    askers = StopAskers()
    askers.asked(1001)
    with pytest.raises(Refused, match=r"user 1001 asked for a stop.*root, or for an operator"):
        askers.check(1002, is_operator=False)
    askers.asked(1003)
    askers.asked(5)
    with pytest.raises(Refused, match="users 1001 and others"):
        askers.check(1002, is_operator=False)


@pytest.fixture
def rig(make_rig: MakeRig) -> EngineRig:
    return make_rig("kajimoto-hv507")


def test_a_strangers_clear_leaves_the_board_halted(rig: EngineRig) -> None:
    rig.open()
    rig.arm()
    rig.ask(StopNow, client="wearer", uid=1001)
    refused = rig.ask(ClearHalt, uid=1002)
    assert (refused.error, rig.state) == ("not_permitted", "HALTED")
    assert rig.ask(ClearHalt, uid=1001).error is None
    assert rig.state == "SAFE"


def test_a_stop_of_who_came_second_stands_as_well(rig: EngineRig) -> None:
    """Who stops first, to clear it at once, lifts no other user's."""
    rig.ask(StopNow, client="attacker", uid=1002)
    rig.ask(StopNow, client="wearer", uid=1001)
    assert rig.ask(ClearHalt, uid=1002).error == "not_permitted"
    assert rig.ask(ClearHalt, uid=0, is_operator=True).error is None
    rig.ask(StopNow, client="attacker", uid=1002)
    assert rig.ask(ClearHalt, uid=1002).error is None, "the wearer's was lifted"
