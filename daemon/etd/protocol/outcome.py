"""What becomes of a frame: what its limits take, what is not fired, and the account of it all.

Owns: these structs. Must not know: sockets, requests, who decides.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from etd.protocol.errors import TimePart

ClampReason = Literal[
    "cap", "return_cap", "soft_start", "recontact", "contact_open", "charge", "frame", "felt"
]


class Clamp(msgspec.Struct, frozen=True, kw_only=True):
    """A current that was lowered: electrode, the requested and the allowed current, and why.

    `limited_by` is the electrode whose cap was the smallest in the path (a return, perhaps).
    `felt`: the person said that it is too strong.
    `ends_in_ms`: when a rise will be over, in the reply to a frame that is shown until then.
    """

    electrode: int
    wanted_ua: int
    allowed_ua: int
    reason: ClampReason
    limited_by: int
    ends_in_ms: int | None = None


ShortfallReason = Literal[
    "ledger", "net_charge", "balanced", "rate", "processor", "overrun", "resolution", "timing"
]


class Shortfall(msgspec.Struct, frozen=True, kw_only=True):
    """Pulses that were not fired, or a rate lowered to `rate_hz`, and what most of a scan is.

    `lasts_ms`: in the reply to a frame whose pulses leave direct current on this electrode: so long
    it can be shown, renewals included. With all its pulses at `lasting_hz` it could be for ever;
    None: no rate is known that lasts, perhaps since returns are not measured yet.
    `balanced`: its pulses have both phases instead, because the direct current of one would pass
    the bound of this electrode, as the body site says.
    """

    electrode: int | None
    reason: ShortfallReason
    pulses: int = 0
    rate_hz: float | None = None
    bound_by: TimePart | None = None
    lasts_ms: int | None = None
    lasting_hz: float | None = None


#: The ledger's bounds of the last second, or a limit that leaves less than the source can make.
WithheldReason = Literal[
    "interval",
    "charge",
    "pulses",
    "duty",
    "array charge",
    "array duty",
    "return charge",
    "net charge",
    "cap",
    "return_cap",
    "soft_start",
    "recontact",
    "contact_open",
    "frame",
    "resolution",
]


class Withheld(msgspec.Struct, frozen=True, kw_only=True):
    """A probe that was not fired, so that contact is unknown there, and by which limit.
    `after_ms`: there is room for it so long after the reply, if nothing is fired until then; None:
    not before that limit changes.
    """

    electrode: int
    reason: WithheldReason
    after_ms: int | None


#: `expired`: its ttl was over. `replaced`: by a newer frame. `pulses`: it had all of them.
#: `silenced`: by a stop, a halt, disarming, the end of its lease, or other maxima.
FrameEnd = Literal["expired", "replaced", "pulses", "silenced"]


class Account(msgspec.Struct, frozen=True, kw_only=True):
    """What became of a frame that was begun. Times are of the board's clock, which is
    CLOCK_MONOTONIC but for a fake's, which was behind it by `clock_lag_us`; None: no pulse.

    Per electrode: how many `pulses` were fired, the frame's current (`wanted_ua`), the lowest and
    the highest current commanded to the source (`least_ua`, `most_ua`), and the mean that passed
    the skin at the end of its pulses (`delivered_ua`). 0 where nothing was fired.

    `clamped`: of each electrode and reason the clamp that left the least. `calibrated_hz`: the rate
    that its levels were calibrated at, where the frame asked for a lower one. `trigger_ns`: the
    edge that began it, by the kernel's stamp; None: it did not wait for one. `ended_ns`: when it
    was over; None: an older daemon, which does not tell.
    """

    seq: int
    tag: int | None
    ended: FrameEnd
    rate_hz: float
    begun_ns: int
    first_ns: int | None
    last_ns: int | None
    pulses: tuple[int, ...]
    wanted_ua: tuple[int, ...]
    least_ua: tuple[int, ...]
    most_ua: tuple[int, ...]
    delivered_ua: tuple[int, ...]
    clamped: tuple[Clamp, ...] = ()
    not_fired: tuple[Shortfall, ...] = ()
    clock_lag_us: int = 0
    calibrated_hz: float | None = None
    trigger_ns: int | None = None
    ended_ns: int | None = None
