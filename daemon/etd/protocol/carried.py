"""What an engine carries over from before a record begins, and that decides over pulses to come.

Owns: these types. Must not know: how a ramp rises, what a record's line is.

Times are of the board's clock, in ns.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from etd.protocol.calibration import Calibration
from etd.protocol.messages import State


class RampState(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """See `etd.safety.soft_start.Ramp`; currents in uA. `rises`: (when, how high)."""

    reached_ua: int = 0
    fired_ua: int = 0
    settled_ua: int = 0
    rises: tuple[tuple[int, int], ...] = ()
    counted_ns: int | None = None
    due_ns: int = 0
    last_ns: int = 0
    ceiling_ua: int = 0


class SoftStartState(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """`recontacts`: by electrode, of those that have a ramp of their own. `were_open`: known to be
    open when the supply went off.
    """

    array: RampState
    recontacts: dict[int, RampState] = {}
    were_open: tuple[int, ...] = ()


class ContactsState(msgspec.Struct, frozen=True, kw_only=True):
    """See `etd.sensing.contact.ContactMap`; each by electrode."""

    is_touched: tuple[bool | None, ...]
    resistance_ohm: tuple[int | None, ...]
    voltage_v: tuple[float | None, ...]
    undelivered_ua: tuple[int | None, ...]
    is_shorted: tuple[bool, ...]
    soft_since_ns: tuple[int | None, ...]
    commanded_ua: tuple[int, ...]
    was_at_end: tuple[bool, ...]
    measured_ns: tuple[int | None, ...]


class CarriedOver(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """At `t_ns`; pulses from then on are in the record.

    `contacts`: of an armed board. `power_up`: what is under way in PROBE. `has_session`: a person's
    session stands, with this calibration and the `others` of its lease, or with limits.
    `shown_seq`: the frame that is shown; its next scan begins at `next_scan_ns`. `recent_pulses`:
    those of the last second, in the ledger. `source_checked_ns`: when the source was checked last,
    which holds up a scan each second.
    """

    t_ns: int
    state: State
    soft_start: SoftStartState
    contacts: ContactsState | None = None
    power_up: Literal["arm", "measure"] | None = None
    has_session: bool = False
    calibration: Calibration | None = None
    others: tuple[Calibration, ...] = ()
    shown_seq: int | None = None
    next_scan_ns: int | None = None
    recent_pulses: int = 0
    source_checked_ns: int = 0
