"""Stage 3, outputs blanked: shifts a known word through the whole chain and reads it back.

Owns: which words. Must not know: what the outputs do.
"""

from __future__ import annotations

import hashlib

from etd.selftest.fixture import Fixture
from etd.selftest.log import CheckLog
from etd_hal.boardfile import Relays

#: 512 pseudo-random bits, the length of the longest chain: no shift of them equals the original.
_WORD = int.from_bytes(hashlib.sha512(b"a word for the chain").digest(), "big")


def check(fixture: Fixture, log: CheckLog) -> None:
    """Raises: BusError, BoardFault, GuardRefusal."""
    if fixture.file.guards.readback == "absent":
        log.absent("readback")
        return
    switch = fixture.file.switch
    stages = switch.outputs * (2 if isinstance(switch, Relays) else 1)
    full = (1 << stages) - 1
    word = _WORD & full
    wrong = 0
    for sent in (word, ~word & full):
        wrong += (fixture.board.switch.loop_back(sent) ^ sent).bit_count()
    fixture.board.switch.clear()
    log.judge(
        "readback",
        wrong == 0,
        f"{wrong} of {2 * stages} bits came back wrong" if wrong else f"{2 * stages} bits right",
        f"{stages} bits and their complement, as sent",
        "check DATA, CLK, the chain's supply and the read-back line",
    )
