"""What the person said of the strength, and what followed, as reply and state report tell it.

Owns: these structs, and the form of a list of electrodes. Must not know: sockets, how an answer is
heeded.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta

from etd.protocol.frame import MAX_ELECTRODES
from etd.stabilize.offset_estimate import Answer
from etd.stabilize.said import Followed
from etd.stabilize.said_electrode import HARDLY_ANYTHING as HARDLY_ANYTHING

#: Electrodes that an answer is about.
Named = Annotated[
    tuple[Annotated[int, Meta(ge=0, lt=MAX_ELECTRODES)], ...],
    Meta(min_length=1, max_length=MAX_ELECTRODES),
]


class FeltDone(msgspec.Struct, frozen=True, kw_only=True):
    """What an answer did: `lowered` at once; `gives_back`: what was lowered comes back, by at most
    5 % a minute; `raises`: the same, above the frame's own strength; `nothing`. `reason`: why it
    did not do more, or not yet, where more was asked for; and why *good* lowered.
    """

    did: Followed
    reason: str = ""


class FeltFacts(msgspec.Struct, frozen=True, kw_only=True):
    """`answers`: how many since arming. The last one was said at `said_ns`, of these `electrodes`
    (null: all), by the lease's holder or (`lowers_only`) by another. `factors`: what these
    words leave of the current that was asked of each electrode, as of its last pulse. `laws_off`:
    why laws by resistance are off until the lease ends; empty: they are not.
    """

    answers: int
    said_ns: int
    answer: Answer | None
    electrodes: tuple[int, ...] | None
    lowers_only: bool
    factors: tuple[float, ...]
    laws_off: str = ""
