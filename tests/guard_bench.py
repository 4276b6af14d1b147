"""Messages by hand, and what the guard of a board on the fake says to them.

Owns: the words that the guard's tests share. On the machine file of the Pi 4 the guard reckons
26 us a word and 1.2 us on top of a delay at worst, 12 us a word at best; 1000 uA of 10 mA is code
409, which makes 998.8 uA.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from board_rig import ZERO_WORD, BoardRig
from etd_hal.errors import GuardRefusal
from etd_hal.ports import Message, Transfer
from etd_hal.switch_shadow import Approval, Prepulse

ON = bytes.fromhex("0664")
ALL = (1 << 64) - 1
ZERO = Transfer(ZERO_WORD)


def silent(*transfers: Transfer) -> Message:
    return Message((*transfers, ZERO))


def approval(
    output: int = 0,
    current_ua: int = 10_000,
    width_us: int = 200,
    prepulse: Prepulse | None = None,
) -> Approval:
    return Approval(1 << output, ALL & ~(1 << output), current_ua, width_us, prepulse)


def connected(rig: BoardRig, output: int = 0, is_anodic: bool = True) -> BoardRig:
    """Output 0 on the source against all others, with nothing approved yet."""
    selection = rig.board.selection(output, None)
    rig.board.prepare(selection)
    rig.board.connect(selection, is_anodic)
    return rig


def send(rig: BoardRig, message: Message, approved: Approval | None = None) -> None:
    if approved is not None:
        rig.board.guard.approve(approved)
    rig.board.guard.spi.transfer(message)


class Refused:
    """What the guard said."""

    error: GuardRefusal


@contextmanager
def refused(rig: BoardRig, rule: str) -> Iterator[Refused]:
    """What stands in the block is refused by this rule, and nothing crosses the wire."""
    before, told = len(rig.records()), Refused()
    with pytest.raises(GuardRefusal) as caught:
        yield told
    told.error = caught.value
    assert told.error.rule == rule
    assert rig.since(before) == []


def assert_refused(
    rig: BoardRig, rule: str, message: Message, approved: Approval | None = None
) -> GuardRefusal:
    with refused(rig, rule) as told:
        send(rig, message, approved)
    return told.error
