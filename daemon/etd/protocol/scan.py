"""Telemetry of what is fired: frames that were begun, and the last pulse of each electrode.

Owns: these structs. Must not know: sockets, requests, who hears them. Clients find them among the
other messages (`messages.py`).
"""

from __future__ import annotations

import msgspec

from etd.protocol.outcome import Clamp, Shortfall
from etd.pulse.measured import ContactState


class Shown(msgspec.Struct, frozen=True, kw_only=True):
    """A frame that was begun. Its first and last pulse are on CLOCK_MONOTONIC; None: no pulse.
    `trigger_ns`: the edge that began it. `replaces`: the frame that was shown until it began.
    `ended_ns`: when it was over.
    """

    seq: int
    tag: int | None
    begun_ns: int
    first_ns: int | None
    last_ns: int | None
    ended: bool
    trigger_ns: int | None = None
    replaces: int | None = None
    ended_ns: int | None = None


class Fired(msgspec.Struct, frozen=True, kw_only=True):
    """The last scan, electrode by electrode; 0 or None where nothing was fired.

    `wanted_ua` is the frame's current, `current_ua` the current commanded to the source, an upper
    bound of that through the skin (0 where a stabilizer requested nothing). `delivered_ua` passed
    the skin at the end of the pulse, the leak taken out. `contact` is that of the pulse.
    `prepulse_ua` and `probe_ua` were commanded for a prepulse and a probe directly before the
    pulse; 0: none. Their widths follow from the body-site file.

    `resistance_ohm` is of the last sample of the last pulse alone, `skin_ohm` the skin's resistance
    to a long pulse, from all pulses above the probe's current, and `capacitance_nf` the capacitance
    beside it, where pulses were wide enough to measure it; None where they are rejected.

    `gain` is the charge that the stabilizers requested, and what the person's words raised, in
    times of the frame's, before any limit; None where the body site has no stabilizer.
    """

    wanted_ua: tuple[int, ...]
    current_ua: tuple[int, ...]
    delivered_ua: tuple[int, ...]
    width_us: tuple[float, ...]
    voltage_v: tuple[float | None, ...]
    resistance_ohm: tuple[int | None, ...]
    contact: tuple[ContactState | None, ...]
    prepulse_ua: tuple[int, ...] = ()
    probe_ua: tuple[int, ...] = ()
    skin_ohm: tuple[int | None, ...] = ()
    capacitance_nf: tuple[float | None, ...] = ()
    gain: tuple[float | None, ...] = ()


class Scan(msgspec.Struct, frozen=True, kw_only=True):
    """Telemetry `scan`: every frame begun since the last report, every electrode fired, and why
    less. `pressure_kpa` is of now, by the nearest sensor: None if it has no reading; empty without
    sensors.
    """

    now_ns: int
    shown: tuple[Shown, ...]
    seq: int
    tag: int | None
    scans: int
    fired: Fired
    clamped: tuple[Clamp, ...]
    not_fired: tuple[Shortfall, ...]
    ceiling_ua: int
    dropped_reports: int
    pressure_kpa: tuple[float | None, ...] = ()
