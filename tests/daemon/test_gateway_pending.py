"""Requests that wait: of which kind and whose they are decides which others are refused.

Owns: the bounds of each kind, and that no *too strong* meets what others wait for.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress

import pytest
import zmq

from etd.gateway.inbound import InboundMessage
from etd.gateway.pending import BOUNDS, Kind, PendingRequest, PendingRequests
from etd.gateway.replies import done
from etd.protocol.errors import Refused
from etd.protocol.link import Answer, ArmBoard, AskAccount, ClearHalt, Command, NewFrame, SayFelt
from gateway_rig import GatewayRig
from scripted_engine import full_answer

HOLDER, OTHERS = 1_001, range(1_002, 1_012)
#: Each asked again where it is refused.
MANY = 100
KINDS = sorted(BOUNDS)


def ask(pending: PendingRequests, uid: int, kind: Kind) -> None:
    ref = pending.next_ref_of(uid, kind)
    pending.add(ref, PendingRequest(InboundMessage(1, (), uid, b""), None, done, 0, kind))


def fill(pending: PendingRequests, uid: int, kind: Kind) -> int:
    """How many were let in."""
    let_in = 0
    with suppress(Refused):
        while let_in < MANY:
            ask(pending, uid, kind)
            let_in += 1
    return let_in


@pytest.mark.parametrize("kind", KINDS)
def test_a_user_fills_the_places_of_no_other_user(kind: Kind) -> None:
    pending = PendingRequests()
    assert fill(pending, HOLDER, kind) == BOUNDS[kind].of_a_user
    for uid in OTHERS:
        ask(pending, uid, kind)


@pytest.mark.parametrize("kind", KINDS)
def test_nor_those_of_another_kind(kind: Kind) -> None:
    pending = PendingRequests()
    for uid in (HOLDER, *OTHERS):
        assert fill(pending, uid, kind)
    for other in KINDS:
        if other != kind:
            assert fill(pending, HOLDER, other) == BOUNDS[other].of_a_user


@pytest.mark.parametrize("kind", ["engine", "account"])
def test_all_users_together_have_a_bound_beyond_which_each_has_one(kind: Kind) -> None:
    pending, bound = PendingRequests(), BOUNDS[kind].in_all
    assert bound is not None
    let_in = [fill(pending, uid, kind) for uid in (HOLDER, *OTHERS)]
    assert bound < sum(let_in) < bound + len(let_in)
    assert min(let_in) == 1


@pytest.mark.parametrize("kind", KINDS)
def test_a_refusal_says_whose_they_are_and_what_to_do(kind: Kind) -> None:
    pending = PendingRequests()
    fill(pending, HOLDER, kind)
    with pytest.raises(Refused, match=r"^\d+ .*this user.*: (send|ask)") as refused:
        ask(pending, HOLDER, kind)
    assert refused.value.code == "busy"
    if BOUNDS[kind].in_all is not None:
        for uid in OTHERS:
            fill(pending, uid, kind)
        with pytest.raises(Refused, match=r"all users.*: (send|ask)"):
            ask(pending, OTHERS[-1], kind)


@pytest.fixture
def rig() -> Iterator[GatewayRig]:
    with GatewayRig() as made:
        yield made


def test_accounts_that_wait_refuse_nothing_else(rig: GatewayRig) -> None:
    lease = rig.open()
    rig.engine.answer = unless_an_account
    assert fill_with_accounts(rig, lease) == BOUNDS["account"].of_a_user
    for request, heard in (
        ({"op": "felt", "answer": "too_strong"}, SayFelt),
        ({"op": "clear"}, ClearHalt),
        ({"op": "arm"}, ArmBoard),
        ({"op": "keep", "lease": lease}, Command),
    ):
        assert rig.call(**request)["ok"], request
        assert isinstance(rig.engine.heard[-1], heard)


def test_too_strong_is_heard_while_all_else_waits(rig: GatewayRig) -> None:
    lease = rig.open()
    rig.engine.answer = only_what_is_felt
    fill_with_accounts(rig, lease)
    for number in range(BOUNDS["engine"].of_a_user + 1):
        rig.control.send(json.dumps({"op": "keep", "lease": lease, "id": number}).encode())
    reply = rig.reply()
    assert (reply["error"], reply["id"]) == ("busy", BOUNDS["engine"].of_a_user)
    for said in ({}, {"lease": lease}):
        assert rig.call(op="felt", answer="too_strong", **said)["did"] == "lowered"
    assert rig.call(op="felt", answer="good", lease=lease)["error"] == "busy"


def fill_with_accounts(rig: GatewayRig, lease: str) -> int:
    """By a connection of its own; how many wait."""
    asker = rig.socket(zmq.DEALER, "control.sock")
    for number in range(MANY // 2):
        asker.send(json.dumps({"op": "account", "lease": lease, "seq": 1, "id": number}).encode())
    refused = [rig.reply(asker) for _ in range(MANY // 2 - BOUNDS["account"].of_a_user)]
    assert {reply["error"] for reply in refused} == {"busy"}
    return sum(isinstance(message, AskAccount) for message in rig.engine.heard)


def unless_an_account(message: Command | NewFrame) -> Answer | None:
    return None if isinstance(message, AskAccount) else full_answer(message)


def only_what_is_felt(message: Command | NewFrame) -> Answer | None:
    return full_answer(message) if isinstance(message, SayFelt) else None
