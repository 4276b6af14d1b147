"""What the limits would leave of a pulse that is fired now: what a frame's reply is told by.

Owns: what is known, when a frame is planned, of the ceilings, the contacts and the returns. Must
not know: how any of it came to be known, frames, clocks.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Final, Protocol

import msgspec

from etd.protocol.outcome import Clamp, ClampReason
from etd.safety.limits import Path
from etd.safety.net_charge import NetState

#: In how long a pulse of this electrode and current would be let through, if it is pulsed each
#: period in ns from now on; None where it would not within a minute.
RisenAfter = Callable[[int, int, int], int | None]


class FeltUa(Protocol):
    """What is left of a current at an electrode since the person said too strong."""

    def __call__(self, electrode: int, current_ua: int, *, may_be_raised: bool) -> int | None: ...


#: Of clamps that pass with time: what a refusal says of them.
WHAT_TO_DO: Final[Mapping[ClampReason, str]] = {
    "soft_start": ": show it without strict until its reply has no clamps, or arm(open_to=...)",
    "recontact": ": show it without strict until its reply has no clamps",
    "felt": ": the person said that it is too strong; too_weak gives it back by 5 % a minute, and"
    " where hardly anything is left only disarming does",
    "contact_open": ": nothing touches it",
    "return_cap": ": ask for less; or, after a silence of a second, show a silent frame for a tenth"
    " of one, in which contact polls tell what its returns carry",
}


class Outlook:
    """`path` sets what all others allow as returns of a path. `recontacts_ua`: by electrode, the
    ceilings of those that are touched again. `is_touched`: for all electrodes; None is unknown.
    `want_looks`: called where what is known of the returns takes something from a pulse.
    `felt_ua`: by electrode, what is left of a current since the person said too strong (None: all
    of it); None: nothing was said.
    `net`: the net charge on each electrode, for each way in which returns may share; empty:
    nothing is known yet. `are_returns_known`: all of them were measured, or touch nothing.
    """

    __slots__ = (
        "are_returns_known",
        "ceiling_ua",
        "felt_ua",
        "is_touched",
        "net",
        "path",
        "recontacts_ua",
        "risen_after_ns",
        "want_looks",
    )

    def __init__(
        self,
        path: Callable[[Path], Path],
        ceiling_ua: int,
        recontacts_ua: dict[int, int],
        is_touched: Sequence[bool | None],
        risen_after_ns: RisenAfter = lambda *_: None,
        want_looks: Callable[[], None] = lambda: None,
        felt_ua: FeltUa | None = None,
        net: Sequence[NetState] = (),
        *,
        are_returns_known: bool = True,
    ) -> None:
        self.path: Final = path
        self.ceiling_ua: Final = ceiling_ua
        self.recontacts_ua: Final = recontacts_ua
        self.is_touched: Final = is_touched
        self.risen_after_ns: Final = risen_after_ns
        self.want_looks: Final = want_looks
        self.felt_ua: Final = felt_ua
        self.net: Final = net
        self.are_returns_known: Final = are_returns_known

    def with_time(self, clamp: Clamp, rate_hz: float) -> Clamp:
        """The clamp with when it would end, where it ends by pulses that are fired."""
        if clamp.reason not in ("soft_start", "recontact"):
            return clamp
        after_ns = self.risen_after_ns(clamp.electrode, clamp.wanted_ua, int(1e9 / rate_hz))
        ends_in_ms = None if after_ns is None else -(-after_ns // 1_000_000)
        return msgspec.structs.replace(clamp, ends_in_ms=ends_in_ms)
