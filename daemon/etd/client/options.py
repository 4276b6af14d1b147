"""The options of a frame, and the frame made from them and levels or currents.

Owns: the names that Python callers use, the same as on the wire. Must not know: lease, seq,
sockets.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal, TypedDict

from etd.client import clock, values
from etd.protocol.errors import Refused
from etd.protocol.frame import DEFAULT_TTL_MS, Polarity

Kind = Literal["level", "current_ua"]


class FrameOptions(TypedDict, total=False):
    """The options of a frame; each as in the protocol's `frame`.

    width_us 20..200, polarity and rate_hz (0.1..200): one value, or one per electrode.
    returns: "all", {"ring_mm": r}, or one list of electrodes for each electrode.
    ttl_ms 1..1000. pulses: that many per electrode, then silence. strict: refuse what would be
    clamped. allow_slower: slow down what does not fit. tag: a whole number, repeated in telemetry.
    sync: an edge on SYNC. on_trigger: begin with the next edge on TRIGGER; lasts_ms: for so long
    from it on; renews: the seq whose wait it goes on with. `present` gives the last two itself.
    """

    width_us: int | Sequence[int]
    polarity: Polarity | Sequence[Polarity]
    rate_hz: float | Sequence[float]
    returns: Literal["all"] | Mapping[str, float] | Sequence[Sequence[int]]
    ttl_ms: int
    pulses: int
    strict: bool
    allow_slower: bool
    tag: int
    sync: bool
    on_trigger: bool
    lasts_ms: int
    renews: int


#: 100.0, as it comes out of a calculation, is 100.
_WHOLE = frozenset({"width_us", "ttl_ms", "pulses", "tag", "lasts_ms", "renews"})
#: What only a frame has that waits for the trigger.
_OF_WAITING = frozenset({"on_trigger", "lasts_ms", "renews"})
_KNOWN = frozenset(FrameOptions.__annotations__)
_CHECKS = (
    ("tag", values.check_frame_tag),
    ("polarity", values.check_polarity),
    ("returns", values.check_returns),
)


def frame_fields(kind: Kind, numbers: values.Numbers, options: FrameOptions) -> dict[str, object]:
    """A frame without lease and seq, stamped with the time. Raises: Refused (`bad_frame`)."""
    for key in options:
        if key not in _KNOWN:
            raise Refused(
                "bad_frame", f"a frame has no option {key!r}; it has {', '.join(sorted(_KNOWN))}"
            )
    given = values.levels(numbers) if kind == "level" else values.currents_ua(numbers)
    extra = {
        key: values.option(key, value, is_whole=key in _WHOLE)
        for key, value in options.items()
        if value is not None
    }
    for key, check in _CHECKS:
        if key in extra:
            check(extra[key])
    return {kind: given, **extra, "sent_ns": clock.now_ns()}


def renewal_s(fields: dict[str, object]) -> float:
    """How often a held frame is sent again: three times within its ttl."""
    return ttl_ms_of(fields, DEFAULT_TTL_MS) / 3000


def ttl_ms_of(fields: dict[str, object], default_ms: int) -> int:
    """A frame's own, or else the default. Another kind of value is the daemon's to refuse."""
    ttl_ms = fields.get("ttl_ms")
    return ttl_ms if isinstance(ttl_ms, int) and ttl_ms > 0 else default_ms


def silent_fields(fields: dict[str, object], now_ns: int) -> dict[str, object]:
    """The same frame with every value 0, stamped anew."""
    kind = "level" if "level" in fields else "current_ua"
    numbers = fields[kind]
    zeros = [0] * len(numbers) if isinstance(numbers, list) else numbers
    return {**fields, kind: zeros, "sent_ns": now_ns}


def at_once_fields(fields: dict[str, object]) -> dict[str, object]:
    """The same frame without a wait for the trigger."""
    return {key: value for key, value in fields.items() if key not in _OF_WAITING}
