"""The calibrations of one lease: one of a person, or several, each made with a polarity of its own.

Owns: what several must have in common, which of them holds for a polarity, and their digests.
Must not know: where they are kept, boards, time.

Nothing is borrowed from another polarity's calibration: neither a threshold nor a cap. The first
one of a lease is that of frames that name no polarity.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence

import msgspec

from etd.protocol.calibration import Calibration, current_of_felt
from etd.protocol.errors import Refused
from etd.protocol.frame import POLARITIES, Polarity

#: One for each polarity.
MOST_CALIBRATIONS = len(POLARITIES)
#: What they must have in common, in words, and what to do about a difference.
_IN_COMMON = (
    ("participant", "the participant", "a lease is for one person"),
    ("body_site", "the body site", "calibrate both at one"),
    ("array", "the array", "calibrate both on one"),
    ("width_us", "width_us", "calibrate one of them anew, at the other's width"),
    ("rate_hz", "rate_hz", "calibrate one of them anew, at the other's rate"),
    ("returns", "returns", "calibrate one of them anew, with the other's returns"),
    ("shape", "the shape of a pulse", "calibrate one of them anew, with the body site as it is"),
)


def digest_of(calibration: Calibration) -> str:
    """SHA-256 of its content: not of its file, which may be written otherwise."""
    return hashlib.sha256(msgspec.json.encode(calibration, order="sorted")).hexdigest()


def check_digest(name: str, found: str, wanted: str | None) -> None:
    """`wanted` None: any. Raises: Refused (`bad_calibration`)."""
    if wanted not in (None, found):
        raise Refused(
            "bad_calibration",
            f"the calibration {name!r} is not the one that was meant: its digest begins with"
            f" {found[:12]}, that of the one meant with {str(wanted)[:12]}. It may have been stored"
            " anew: see `etd calibration show`, then open again",
        )


def check_together(calibrations: Sequence[Calibration]) -> None:
    """Whether a lease can be opened with all of these. Raises: Refused (`bad_calibration`)."""
    if not 1 <= len(calibrations) <= MOST_CALIBRATIONS:
        raise Refused(
            "bad_calibration",
            f"{len(calibrations)} calibrations: a lease has from one to {MOST_CALIBRATIONS}, one"
            " for each polarity",
        )
    first = calibrations[0]
    for number, other in enumerate(calibrations[1:], 2):
        for key, in_words, what_to_do in _IN_COMMON:
            one, another = getattr(first, key), getattr(other, key)
            if one != another:
                raise Refused(
                    "bad_calibration",
                    f"calibrations of one lease have {in_words} in common: the first one's is"
                    f" {_shown(one)}, that of number {number} is {_shown(another)}: {what_to_do},"
                    " or open with one of the two",
                )
        if len(other.electrode) != len(first.electrode):
            raise Refused(
                "bad_calibration",
                f"calibrations of one lease have as many electrodes: the first one has"
                f" {len(first.electrode)}, number {number} has {len(other.electrode)}",
            )
    polarities = [calibration.polarity for calibration in calibrations]
    for polarity in polarities:
        if polarities.count(polarity) > 1:
            raise Refused(
                "bad_calibration",
                f"two calibrations of one lease were made with {polarity} pulses, and nothing says"
                " which of them holds: name one for each polarity",
            )


def polarities_in_words(calibrations: Sequence[Calibration]) -> str:
    """Those that they were made with, in their order."""
    return " or ".join(calibration.polarity for calibration in calibrations)


def check_covered(
    calibrations: Sequence[Calibration],
    currents_ua: Sequence[int],
    polarities: Sequence[Polarity],
) -> None:
    """Of several calibrations, no cap holds for a polarity that none was made with.

    Raises: Refused (`bad_frame`), for the first electrode with a current in another polarity.
    """
    known = {calibration.polarity for calibration in calibrations}
    if known.issuperset(polarities):
        return
    for electrode, (current_ua, polarity) in enumerate(zip(currents_ua, polarities, strict=True)):
        if current_ua > 0 and polarity not in known:
            raise Refused(
                "bad_frame",
                f"electrode {electrode}: the frame asks for {polarity} pulses, and the calibrations"
                f" of this lease were made with {polarities_in_words(calibrations)} ones, whose"
                f" caps hold for nothing else: calibrate with {polarity} pulses and name that"
                " calibration too, or open with limits",
                electrode,
            )


def currents_of_mixed_levels(
    calibrations: Sequence[Calibration],
    levels: Sequence[float],
    polarities: Sequence[Polarity],
) -> tuple[int, ...]:
    """The currents of all electrodes, each by the calibration of its polarity. 0 for level 0.

    Raises: Refused (`level_needs_calibration`, `bad_frame`).
    """
    by_polarity = {calibration.polarity: calibration for calibration in calibrations}
    check_covered(calibrations, [1 if level > 0.0 else 0 for level in levels], polarities)
    return tuple(
        current_of_felt(by_polarity[polarity], electrode, level) if level > 0.0 else 0
        for electrode, (level, polarity) in enumerate(zip(levels, polarities, strict=True))
    )


def _shown(value: object) -> str:
    """Lists of returns are long."""
    return f"{len(value)} lists" if isinstance(value, tuple) else str(value)
