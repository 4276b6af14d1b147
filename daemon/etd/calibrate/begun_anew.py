"""What a calibration, or a fit, that is begun anew keeps of the one before: what was too strong,
and what it was stopped at.

Owns: reading that from the saved progress of either, and the sentence about it. Must not know:
options, what else is saved.
"""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import msgspec

from etd.calibrate.conditions import Conditions, other_use
from etd.calibrate.in_doubt import InDoubt
from etd.protocol.calibration import Ua


class Kept(NamedTuple):
    """As in `Progress`; and what is to be said of it: empty, where there was nothing."""

    lowered_ua: dict[int, int]
    together_ua: dict[int, tuple[int, int]]
    in_doubt: InDoubt | None
    said: str


class _Saved(msgspec.Struct, kw_only=True):
    """What is read of either file, whatever else it has."""

    conditions: Conditions
    lowered_ua: dict[int, Ua] = {}
    lowering_ua: dict[int, Ua] = {}
    together_ua: dict[int, tuple[Ua, Ua]] = {}
    in_doubt: InDoubt | None = None


def kept_anew(path: Path, conditions: Conditions) -> Kept:
    """Of what is saved there, for the person, array and pulses of `conditions`."""
    try:
        saved = msgspec.json.decode(path.read_bytes(), type=_Saved)
    except FileNotFoundError:
        return _nothing("")
    except (OSError, msgspec.DecodeError) as error:
        return _nothing(f"what was too strong before is not known: {path} cannot be read ({error})")
    what = _named(saved)
    if not what:
        return _nothing("")
    if (why := other_use(saved.conditions, conditions)) is not None:
        return _nothing(f"not kept of the saved progress: {what}; {why}")
    lowered_ua = dict(saved.lowered_ua)
    for electrode, ua in saved.lowering_ua.items():
        lowered_ua[electrode] = min(ua, lowered_ua.get(electrode, ua))
    said = f"kept of the saved progress: {what} (--forget-too-strong discards that too)"
    return Kept(lowered_ua, saved.together_ua, saved.in_doubt, said)


def _named(saved: _Saved) -> str:
    """Empty, where there is nothing."""
    alone = sorted({*saved.lowered_ua, *saved.lowering_ua})
    parts = []
    if alone:
        parts.append(f"what was too strong on electrodes {', '.join(map(str, alone))}")
    if saved.together_ua:
        parts.append("what was too strong of all at once")
    if saved.in_doubt is not None:
        parts.append("the question about what it was stopped at")
    return ", and ".join(parts)


def _nothing(said: str) -> Kept:
    return Kept({}, {}, None, said)
