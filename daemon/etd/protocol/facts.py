"""What the daemon says of itself in `hello`: board, array, maxima and endpoints; and its records.

Owns: these structs. Must not know: sockets, requests, how a fact came to be known.
"""

from __future__ import annotations

import msgspec


class BoardFacts(msgspec.Struct, frozen=True, kw_only=True):
    name: str
    backend: str
    machine: str
    code: str = "interpreted"
    full_scale_ua: int
    resolution_ua: float
    leak_ohm: int
    compliance_v: int
    rest_us: int
    states: tuple[str, ...]
    present_guards: tuple[str, ...]
    absent_guards: tuple[str, ...]


class ArrayFacts(msgspec.Struct, frozen=True, kw_only=True):
    """Positions in mm, x right, y towards the fingertip, through the finger onto the electrodes."""

    name: str
    electrodes: int
    x_mm: tuple[float, ...]
    y_mm: tuple[float, ...]
    diameter_mm: float


class MaximaFacts(msgspec.Struct, frozen=True, kw_only=True):
    """The maxima: the smallest of code, board and body site."""

    current_ua: int
    uncalibrated_current_ua: int
    width_us: int
    charge_nc: float
    rate_hz: float
    mean_current_ua: int
    array_mean_current_ua: int
    probe_current_ua: int
    #: What pulses of one polarity may leave on an electrode, with a leak of one second; None: an
    #: older daemon, which does not count it.
    net_charge_nc: float | None = None


class Endpoints(msgspec.Struct, frozen=True, kw_only=True):
    frames: str
    telemetry: str


class RecordFacts(msgspec.Struct, frozen=True, kw_only=True):
    """A record on the daemon's disk."""

    name: str
    bytes: int
    is_running: bool = False
