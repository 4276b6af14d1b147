"""The checks before the supply goes on, each with what to do about it."""

from __future__ import annotations

import pytest

from etd.engine.power_up import Readiness, check_ready
from etd.protocol.errors import Refused

READY = Readiness((), (), None)


def test_a_board_with_nothing_in_the_way_is_ready() -> None:
    check_ready(READY)


@pytest.mark.parametrize(
    ("ready", "said"),
    [
        (Readiness(("readback", "heartbeat"), (), None), "readback, heartbeat: accept each"),
        (Readiness((), ("emergency_stop", "wearer_stop"), None), "and wearer_stop open"),
        (Readiness((), (), "press and release it once"), "press and release it once"),
    ],
)
def test_what_is_in_the_way_is_named_with_what_to_do(ready: Readiness, said: str) -> None:
    with pytest.raises(Refused, match=said) as refusal:
        check_ready(ready)
    assert refusal.value.code == "arm_failed"
