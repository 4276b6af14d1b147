"""The fingers that a fake board can have, beside its own.

Owns: their names, and what is said of one on a command line. A command that only offers them need
not load what models them. Must not know: what each of them is (etd_body.kinds).
"""

from __future__ import annotations

from typing import Final, NamedTuple

KINDS: Final = (
    "area",
    "indifferent",
    "sweat",
    "ducts",
    "capacitive",
    "bent",
    "adapting",
    "soaking",
    "tender",
    "summing",
)
MOST_SEED: Final = 2**31 - 1


class Finger(NamedTuple):
    """`kind` None: the fake's own one, always the same. `is_breathing`: it goes through the states
    of the skin that a fit asks in, one after each silence (etd_body.states).
    """

    kind: str | None = None
    seed: int = 1
    is_breathing: bool = False


#: The fake's own, as it lies there.
OWN: Final = Finger()


def finger_named(text: str) -> Finger:
    """`KIND` or `KIND:SEED`. Raises: ValueError, with the names."""
    kind, colon, seed = text.partition(":")
    if kind not in KINDS:
        raise ValueError(f"there is no finger {kind!r}: one of {', '.join(KINDS)}")
    if not colon:
        return Finger(kind)
    if not (seed.isascii() and seed.isdecimal() and int(seed) <= MOST_SEED):
        raise ValueError(f"{seed!r} is no seed: a whole number up to {MOST_SEED}")
    return Finger(kind, int(seed))
