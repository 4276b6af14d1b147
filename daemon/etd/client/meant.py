"""What a program means to open a lease with: calibrations by name and digest, or limits.

Owns: the checks of what was given, and the comparison with what the engine took. Must not know:
sockets, files, when a lease is opened.
"""

from __future__ import annotations

import re
from collections.abc import Sequence

from etd.protocol.calibration_set import check_digest
from etd.protocol.errors import Refused
from etd.protocol.opening import DIGEST_PATTERN, LeaseCalibration


class Meant:
    """None given: any calibration of the name will do. Raises: Refused (`bad_message`)."""

    def __init__(self, digest: str | Sequence[str] | None) -> None:
        given = (digest,) if isinstance(digest, str) else tuple(digest or ())
        for each in given:
            if not isinstance(each, str) or not re.search(DIGEST_PATTERN, each):
                raise Refused(
                    "bad_message",
                    f"digest={each!r}: a digest has 64 digits from 0 to f, as `etd calibration"
                    " show` prints it",
                )
        self._digests = given

    @property
    def fields(self) -> dict[str, object]:
        """Of the request that opens a lease."""
        return {"digests": self._digests} if self._digests else {}

    def check(self, taken: Sequence[LeaseCalibration]) -> None:
        """Raises: Refused (`bad_calibration`) for another one."""
        if self._digests and len(taken) != len(self._digests):
            raise Refused(
                "bad_calibration",
                f"{len(self._digests)} calibrations were meant, and the daemon took {len(taken)}",
            )
        for meant, found in zip(self._digests, taken, strict=False):
            check_digest(found.name, found.digest, meant)


def names_of(calibration: str | Sequence[str] | None) -> tuple[str, ...]:
    """Of one calibration, or of several. Raises: Refused (`bad_message`)."""
    if calibration is None:
        return ()
    if isinstance(calibration, str):
        return (calibration,)
    names = tuple(calibration) if isinstance(calibration, Sequence) else ()
    if not names or not all(isinstance(name, str) for name in names):
        raise Refused(
            "bad_message",
            f"calibration={calibration!r}: a name is needed, or several names of one person's"
            " calibrations, each made with another polarity",
        )
    return names


def check_limits(
    calibrations: tuple[str, ...], max_current_ua: int | None, width_us: int | None
) -> None:
    """Raises: Refused (`limits_missing`, `bad_message`)."""
    if (max_current_ua is None) != (width_us is None):
        missing = "width_us" if width_us is None else "max_current_ua"
        raise Refused("limits_missing", f"{missing} is missing: limits are a current and a width")
    if calibrations and max_current_ua is not None:
        raise Refused("bad_message", "give either calibration, or max_current_ua and width_us")
