"""The laws that a body-site file may name, and what they are made into.

Owns: the list of them, in one place. Must not know: what a law does, how one is asked.

In the file, in the order in which they ask; none is the default:

    [[stabilize]]
    law = "contact"

    [[stabilize]]
    law = "energy"
    most_wider = 1.5
"""

from __future__ import annotations

from collections.abc import Sequence

from etd.stabilize.contact import Contact, ContactLaw
from etd.stabilize.energy import Energy, EnergyLaw
from etd.stabilize.pipeline import Stabilizer
from etd.stabilize.pressure import Pressure, PressureLaw
from etd_hal.boardfile import Source

Law = ContactLaw | PressureLaw | EnergyLaw


def name_of(law: Law) -> str:
    """As in the file."""
    return str(law.__struct_config__.tag)


def why_wrong(laws: Sequence[Law]) -> tuple[int, str, str] | None:
    """(which, what is wrong, what to do), for what no type expresses."""
    seen: set[str] = set()
    for index, law in enumerate(laws):
        if name_of(law) in seen:
            return index, f"{name_of(law)} stands here a second time", "name each law once"
        seen.add(name_of(law))
        if isinstance(law, PressureLaw) and law.none_kpa >= law.full_kpa:
            return index, "none_kpa is not below full_kpa", "pressing harder must give more"
    return None


def make(laws: Sequence[Law], source: Source) -> tuple[Stabilizer, ...]:
    """One of each, for one board's source, knowing nothing yet."""
    return tuple(_made(law, source) for law in laws)


def _made(law: Law, source: Source) -> Stabilizer:
    if isinstance(law, ContactLaw):
        return Contact(law, source.leak_ohm, source.compliance_v)
    if isinstance(law, PressureLaw):
        return Pressure(law)
    return Energy(law, source.leak_ohm)
