"""What was too strong is taken from the calibrations that a person may be using, at once: whatever
is being measured may never be finished.

Owns: storing those, giving back what a slipped key took, and the sentence about it. Must not know:
what is asked, what was too strong of it, keys.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable, Mapping

from etd.calibrate.lowered import lowered
from etd.cli.calibrate_result import marked, stored_of_same
from etd.client import Display
from etd.protocol.calibration import Calibration


class StoredLowered:
    """Those of `names` that are stored, of `made`'s person and pulses. Raises: Refused."""

    def __init__(self, display: Display, names: Iterable[str], made: Calibration) -> None:
        self._display = display
        each = {name: stored_of_same(display, name, made) for name in names}
        self._was = {name: stored for name, stored in each.items() if stored is not None}
        self._stored = dict(self._was)

    def lower(self, left_ua: Mapping[int, int]) -> None:
        """`left_ua`: all that was too strong so far, or may have been. Raises: Refused."""
        for name, was in self._was.items():
            made = lowered(was, left_ua)
            if made is not was:
                made = marked(self._display, made)
            if made != self._stored[name]:
                self._display.set_calibration(name, made)
                self._stored[name] = made

    def __getitem__(self, name: str) -> Calibration:
        """As it is stored now."""
        return self._stored[name]

    def tell(self) -> None:
        """On standard error, what is lower than it was."""
        for name, was in self._was.items():
            tell_lowered(name, was, self._stored[name])


def tell_lowered(name: str, was: Calibration, now: Calibration) -> None:
    """Nothing, where no cap is lower."""
    caps = [
        f"{electrode} ({after.cap_ua} uA instead of {before.cap_ua})"
        for electrode, (before, after) in enumerate(zip(was.electrode, now.electrode, strict=True))
        if after != before
    ]
    if caps:
        said = f"too strong, so the cap is lower: electrode {', '.join(caps)}"
        print(f"{said}: {name} is stored so", file=sys.stderr, flush=True)
