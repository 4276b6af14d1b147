"""The `[stabilize]` table of a body-site file: which stabilizers there are, and in what order.

Owns: the table, its rules, and the pipeline that it makes. Must not know: what the laws do.

A stabilizer is there if its own table is there, and if `order` names it: each must have the other,
so that neither a forgotten word nor a forgotten table changes what is felt. Without the table
there is none.
"""

from __future__ import annotations

from typing import Literal

import msgspec

from etd.stabilize.bursts import Bursts
from etd.stabilize.narrow import Narrow
from etd.stabilize.pipeline import Stabilizer
from etd.stabilize.prepulse import Prepulse
from etd_hal.errors import FileError

Name = Literal["narrow", "prepulse"]


class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """`[stabilize]`, key by key."""

    order: tuple[Name, ...] = ()
    narrow: Narrow | None = None
    prepulse: Prepulse | None = None
    #: Not a stabilizer: when pulses come, not what they are.
    bursts: Bursts | None = None

    @property
    def prepulse_us(self) -> int:
        """What a prepulse adds to the width of every pulse."""
        return 0 if self.prepulse is None else self.prepulse.width_us


def pipeline(settings: Settings) -> tuple[Stabilizer, ...]:
    """The stabilizers in their order."""
    made: dict[Name, Stabilizer | None] = {
        "narrow": settings.narrow,
        "prepulse": settings.prepulse,
    }
    return tuple(one for name in settings.order if (one := made[name]) is not None)


def check_settings(settings: Settings, file: str) -> None:
    """The rules between keys. Raises: FileError."""
    order = settings.order
    for name in ("narrow", "prepulse"):
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
