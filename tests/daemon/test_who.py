"""How a client is named: whatever it calls itself, the user is the kernel's."""

from __future__ import annotations

import os

import msgspec
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from etd.protocol.link import StopNow
from etd.protocol.messages import Stop
from etd.protocol.who import user_of, who
from gateway_rig import GatewayRig

ANY = st.text(max_size=64)


def taken_as_a_name(text: str) -> bool:
    try:
        msgspec.convert({"op": "stop", "client": text}, Stop)
    except msgspec.ValidationError:
        return False
    return True


@given(client=ANY.filter(taken_as_a_name), uid=st.integers(0, 2**32 - 1))
@example(client="\U0010ffff" * 64, uid=2**32 - 1)
@example(client="bob (user 1001)", uid=2001)
@example(client="it's (user 1)' (user 2", uid=2001)
def test_the_user_is_the_last_word_and_what_crosses_to_the_engine_is_bounded(
    client: str, uid: int
) -> None:
    named = who(client, uid)
    assert user_of(named) == f"user {uid}"
    sent = msgspec.msgpack.encode(StopNow(client=named))
    assert msgspec.msgpack.decode(sent, type=StopNow).client == named


@pytest.mark.parametrize(
    ("asked", "named"),
    [
        ({}, "user {}"),
        ({"client": "bob (user 1001)"}, "'bob (user 1001)' (user {})"),
    ],
)
def test_a_stop_names_the_sender_as_the_kernel_does(asked: dict[str, str], named: str) -> None:
    with GatewayRig() as rig:
        assert rig.call(op="stop", **asked)["ok"]
        (stop,) = (command for command in rig.engine.heard if isinstance(command, StopNow))
        assert stop.client == named.format(os.getuid())
