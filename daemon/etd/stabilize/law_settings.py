"""What a body-site file says of the laws that remember something between pulses, law by law.

Owns: the keys of their tables in `[stabilize]`, with bounds and defaults. Must not know: what the
laws do with them.
"""

from __future__ import annotations

from typing import Annotated

import msgspec
from msgspec import Meta


class ContactSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[stabilize.contact]`."""

    #: Of the threshold: where a new contact begins.
    start_fraction: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.5
    #: Of a current that could not be delivered: what is asked for next.
    back_off: Annotated[float, Meta(ge=0.1, le=0.95)] = 0.8
    #: How fast the current comes back after that, in parts of what is wanted.
    rise_per_s: Annotated[float, Meta(ge=0.01, le=10.0)] = 0.2


class ResistanceLawSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Of all laws by resistance."""

    max_widening: Annotated[float, Meta(ge=1.0, le=4.0)] = 1.5
    min_width_us: Annotated[int, Meta(ge=20, le=200)] = 35
    rise_per_s: Annotated[float, Meta(ge=0.01, le=20.0)] = 1.0


class EnergySettings(ResistanceLawSettings, frozen=True):
    """`[stabilize.energy]`: those of all laws by resistance."""


class LinearLawSettings(ResistanceLawSettings, frozen=True, kw_only=True):
    """`[stabilize.linear_law]`."""

    charge_slope: Annotated[float, Meta(ge=-1.0, le=1.0)] = 0.0
    energy_slope: Annotated[float, Meta(ge=-1.0, le=2.0)] = 1.0


class PowerLawSettings(ResistanceLawSettings, frozen=True, kw_only=True):
    """`[stabilize.power_law]`: those of all laws by resistance. k is the person's, and stands in
    the calibration.
    """


class PressureSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[stabilize.pressure]`."""

    #: p0: below, there is no contact.
    none_kpa: Annotated[float, Meta(ge=0.0, le=1_000.0)] = 10.0
    #: p1: from here on, all that is wanted. Must be above none_kpa.
    full_kpa: Annotated[float, Meta(gt=0.0, le=1_000.0)] = 100.0
    #: Of the way from threshold to what is wanted, in a second.
    rise_per_s: Annotated[float, Meta(ge=0.01, le=20.0)] = 2.0
