"""Stage 3, outputs blanked: a known word through the whole chain of switches, and back.

Owns: which words. Must not know: what the outputs do.
"""

from __future__ import annotations

import hashlib

from etd.selftest.bed import Bed
from etd.selftest.log import Log
from etd_hal.boardfile import Relays

#: 512 bits without a pattern, so that no shift of them looks like themselves: the longest chain.
_WORD = int.from_bytes(hashlib.sha512(b"a word for the chain").digest(), "big")


def check(bed: Bed, log: Log) -> None:
    """Raises: BusError, BoardFault, GuardRefusal."""
    if bed.file.guards.readback == "absent":
        log.absent("readback")
        return
    switch = bed.file.switch
    stages = switch.outputs * (2 if isinstance(switch, Relays) else 1)
    full = (1 << stages) - 1
    word = _WORD & full
    wrong = 0
    for sent in (word, ~word & full):
        wrong += (bed.board.switch.loop_back(sent) ^ sent).bit_count()
    bed.board.switch.clear()
    log.judge(
        "readback",
        wrong == 0,
        f"{wrong} of {2 * stages} bits came back wrong" if wrong else f"{2 * stages} bits right",
        f"{stages} bits and their complement, as sent",
        "DATA, CLK, the chain's supply and the read-back line itself",
    )
