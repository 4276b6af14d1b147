"""A frame: the stimulation that a client requests.

Owns: the types of what clients send, a frame's fields with the bounds that hold everywhere, and
what one value for all or N values means. Must not know: boards, states, time, sockets.
"""

from __future__ import annotations

from typing import Annotated, Literal, TypeVar, get_args

import msgspec
from msgspec import Meta

from etd.protocol.errors import Refused
from etd.protocol.text import NAME_PATTERN, PLAIN_PATTERN

Polarity = Literal["anodic", "cathodic", "biphasic", "biphasic_cathodic_first"]
POLARITIES: tuple[Polarity, ...] = get_args(Polarity)
#: Anodic phases are True.
PHASES: dict[Polarity, tuple[bool, ...]] = {
    "anodic": (True,),
    "cathodic": (False,),
    "biphasic": (True, False),
    "biphasic_cathodic_first": (False, True),
}

#: No array has more: what would name more is refused as it is decoded, in every message and file. A
#: short text of empty lists would else become fifteen times its size.
MAX_ELECTRODES = 256
PerElectrode = Meta(max_length=MAX_ELECTRODES)

Level = Annotated[float, Meta(ge=0.0, le=1.0)]
CurrentUa = Annotated[int, Meta(ge=0, le=10_000)]
WidthUs = Annotated[int, Meta(ge=20, le=200)]
RateHz = Annotated[float, Meta(ge=0.1, le=200.0)]
TtlMs = Annotated[int, Meta(ge=1, le=1_000)]
#: Any number that a client chooses; larger ones cannot be sent to the engine.
Int64 = Annotated[int, Meta(ge=-(2**63), le=2**63 - 1)]
Name = Annotated[str, Meta(pattern=NAME_PATTERN)]
Lease = Annotated[str, Meta(max_length=64)]
PlainText = Annotated[str, Meta(pattern=PLAIN_PATTERN)]
#: As an array, a body site or a program is called in a calibration.
ShortText = Annotated[str, Meta(max_length=200, pattern=PLAIN_PATTERN)]
#: As a client calls itself.
ClientName = Annotated[str, Meta(max_length=64, pattern=PLAIN_PATTERN)]
MOST_OF_A_TAG = 64
#: As a client calls a moment: a number, or a few words.
MarkTag = Int64 | Annotated[str, Meta(max_length=MOST_OF_A_TAG, pattern=PLAIN_PATTERN)]

#: How long a frame without a ttl is shown.
DEFAULT_TTL_MS = 200

T = TypeVar("T")


class Ring(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """All electrodes whose distance from the stimulating one is `ring_mm`, within a quarter of it.

    A concentric electrode of another diameter (paper, section 3.2): the rest is open.
    """

    ring_mm: Annotated[float, Meta(gt=0, le=100)]


Members = Annotated[tuple[int, ...], PerElectrode]
Returns = Literal["all"] | Ring | Annotated[tuple[Members, ...], PerElectrode]
RETURNS_IN_WORDS = '"all", {"ring_mm": a radius}, or a list of electrodes for each electrode'


class Frame(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """A frame: `level` or `current_ua`, N values each.

    Values that may be given once or N times: `width_us`, `polarity`, `rate_hz`; where they are not
    given, the calibration's or else the body site's hold. Level 0 is silent.

    `account`: keep an account of it, for the request of that name. `preview`: answer what would be
    fired now, and show nothing.

    `on_trigger`: it replaces the frame before it at once, and its first scan begins with the next
    edge of the board's trigger; without one it expires by its ttl. `lasts_ms`: shown for so long
    from that edge on, and in no case for longer than its ttl. `renews`: the seq of the frame with
    `on_trigger` whose wait it goes on with; if an edge has begun that one, this one is not shown,
    and the answer has `trigger_ns`.
    """

    lease: Lease
    seq: Annotated[int, Meta(ge=0, le=2**63 - 1)]
    level: Annotated[tuple[Level, ...], PerElectrode] | None = None
    current_ua: Annotated[tuple[CurrentUa, ...], PerElectrode] | None = None
    width_us: WidthUs | Annotated[tuple[WidthUs, ...], PerElectrode] | None = None
    polarity: Polarity | Annotated[tuple[Polarity, ...], PerElectrode] | None = None
    rate_hz: RateHz | Annotated[tuple[RateHz, ...], PerElectrode] | None = None
    returns: Returns | None = None
    ttl_ms: TtlMs = DEFAULT_TTL_MS
    pulses: Annotated[int, Meta(ge=1, le=100_000)] | None = None
    strict: bool = False
    allow_slower: bool = False
    sent_ns: Int64 | None = None
    tag: Int64 | None = None
    sync: bool = False
    account: bool = False
    preview: bool = False
    on_trigger: bool = False
    lasts_ms: TtlMs | None = None
    renews: Annotated[int, Meta(ge=0, le=2**63 - 1)] | None = None


def per_electrode(value: T | tuple[T, ...], n: int, key: str) -> tuple[T, ...]:
    """One value for each of `n` electrodes. Raises: Refused (`bad_frame`) for another length."""
    if not isinstance(value, tuple):
        return (value,) * n
    if len(value) != n:
        raise Refused("bad_frame", f"{key} has {len(value)} values, the array has {n} electrodes")
    return value


def check_shape(frame: Frame, n: int) -> None:
    """Lengths and electrode numbers against an array of `n`. Raises: Refused (`bad_frame`)."""
    if (frame.level is None) == (frame.current_ua is None):
        raise Refused("bad_frame", "give level or current_ua, one of the two")
    for key in ("lasts_ms", "renews"):
        if getattr(frame, key) is not None and not frame.on_trigger:
            raise Refused("bad_frame", f"{key} is for frames that wait: give on_trigger, too")
    for key in ("level", "current_ua", "width_us", "polarity", "rate_hz"):
        value = getattr(frame, key)
        if isinstance(value, tuple):
            per_electrode(value, n, key)
    if isinstance(frame.returns, tuple):
        _check_return_sets(frame.returns, n)


def _check_return_sets(sets: tuple[tuple[int, ...], ...], n: int) -> None:
    if len(sets) != n:
        raise Refused("bad_frame", f"returns has {len(sets)} lists, the array has {n} electrodes")
    there = frozenset(range(n))
    for electrode, members in enumerate(sets):
        # As sets: the engine checks as many as 65 000 members between two pulses.
        named = frozenset(members)
        if not named <= there:
            raise Refused(
                "bad_frame",
                f"returns of electrode {electrode} name {min(named - there)}: 0 to {n - 1}",
                electrode,
            )
        if electrode in named:
            raise Refused(
                "bad_frame", f"electrode {electrode} is named as its own return", electrode
            )
        if len(named) != len(members):
            raise Refused(
                "bad_frame", f"returns of electrode {electrode} name one twice", electrode
            )
