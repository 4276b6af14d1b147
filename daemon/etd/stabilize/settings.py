"""The `[stabilize]` table of a body-site file: which stabilizers there are, and in what order.

Owns: the table, its rules, and the pipeline that it makes. Must not know: what the laws do.

A stabilizer is there if its own table is there, and if `order` names it: each must have the other,
so that neither a forgotten word nor a forgotten table changes what is felt. Without the table
there is none.
"""

from __future__ import annotations

from typing import Literal, get_args

import msgspec

from etd.stabilize.bursts import Bursts
from etd.stabilize.contact import Contact
from etd.stabilize.energy import Energy
from etd.stabilize.law_settings import (
    ContactSettings,
    EnergySettings,
    LinearLawSettings,
    PowerLawSettings,
    PressureSettings,
)
from etd.stabilize.linear_law import LinearLaw
from etd.stabilize.pipeline import OnRejected, Stabilizer, ignore_rejection
from etd.stabilize.power_law import PowerLaw
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.pressure import Pressure
from etd.stabilize.shape import Shape
from etd.stabilize.strength_duration import StrengthDuration
from etd_hal.boardfile import Source
from etd_hal.errors import FileError

Name = Literal[
    "contact", "pressure", "energy", "power_law", "linear_law", "strength_duration", "prepulse"
]
#: They all make of the same resistance how strong a pulse shall be: one of them at a time.
BY_RESISTANCE = ("energy", "power_law", "linear_law")


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[stabilize]`, key by key."""

    order: tuple[Name, ...] = ()
    contact: ContactSettings | None = None
    pressure: PressureSettings | None = None
    energy: EnergySettings | None = None
    power_law: PowerLawSettings | None = None
    linear_law: LinearLawSettings | None = None
    strength_duration: StrengthDuration | None = None
    prepulse: Prepulse | None = None
    #: Not a stabilizer: when pulses come, not what they are.
    bursts: Bursts | None = None
    #: Whether a weak probe goes directly before every pulse, for the stabilizers to use: the
    #: board's `probe_current_ua` for its `probe_width_us`.
    probe_first: bool = False

    @property
    def before_contact(self) -> tuple[Name, ...]:
        """Laws placed before `contact` that should follow it: they use the current that `contact`
        leaves, and steadiness was measured in no other order. Limits hold in any order.
        """
        if "contact" not in self.order:
            return ()
        before = self.order[: self.order.index("contact")]
        return tuple(name for name in before if name in ("pressure", *BY_RESISTANCE))

    @property
    def prepulse_us(self) -> int:
        """What a prepulse adds to the width of every pulse."""
        return 0 if self.prepulse is None else self.prepulse.width_us

    @property
    def shape(self) -> Shape:
        """What all this makes of every pulse, whatever the skin does."""
        return Shape(
            strength_duration=self.strength_duration,
            prepulse=self.prepulse,
            bursts=self.bursts,
            probe_first=self.probe_first,
        )


NO_STABILIZERS = Settings()


def pipeline(
    settings: Settings, source: Source, on_rejected: OnRejected = ignore_rejection
) -> tuple[Stabilizer, ...]:
    """The stabilizers in their order, for one board's source, knowing nothing yet. `on_rejected` is
    called with what a stabilizer rejects, when that begins.
    """
    made = (_made(settings, name, source, on_rejected) for name in settings.order)
    return tuple(stabilizer for stabilizer in made if stabilizer is not None)


def _made(
    settings: Settings, name: Name, source: Source, on_rejected: OnRejected
) -> Stabilizer | None:
    law = getattr(settings, name)
    if isinstance(law, ContactSettings):
        is_alone = not set(settings.order) & set(BY_RESISTANCE)
        return Contact(law, source.leak_ohm, source.compliance_v, is_alone=is_alone)
    if isinstance(law, PressureSettings):
        return Pressure(law)
    if isinstance(law, EnergySettings):
        return Energy(law, source.leak_ohm, on_rejected)
    if isinstance(law, PowerLawSettings):
        return PowerLaw(law, on_rejected)
    if isinstance(law, LinearLawSettings):
        return LinearLaw(law, source.leak_ohm, on_rejected)
    if isinstance(law, StrengthDuration | Prepulse):
        return law
    return None


def check_settings(settings: Settings, file: str) -> None:
    """The rules between keys. Raises: FileError."""
    order = settings.order
    for name in get_args(Name):
        if (name in order) == (getattr(settings, name) is None):
            raise FileError(
                file,
                f"stabilize.{name}",
                "it is named in order and has no table, or has a table and is not in order",
                "give both, or neither",
            )
    if len(set(order)) != len(order):
        raise FileError(file, "stabilize.order", "it names one twice", "name each once")
    if "prepulse" in order and order[-1] != "prepulse":
        raise FileError(
            file,
            "stabilize.order",
            "prepulse is not the last",
            "put it last: it is so much below the pulse that the others have asked for",
        )
    named = [name for name in order if name in BY_RESISTANCE]
    if len(named) > 1:
        raise FileError(
            file,
            "stabilize.order",
            f"it names {' and '.join(named)}",
            "name one of them: both would answer the same change of resistance",
        )
    pressure = settings.pressure
    if pressure is not None and pressure.none_kpa >= pressure.full_kpa:
        raise FileError(
            file,
            "stabilize.pressure",
            f"none_kpa {pressure.none_kpa} is not below full_kpa {pressure.full_kpa}",
            "pressing harder must give more",
        )
