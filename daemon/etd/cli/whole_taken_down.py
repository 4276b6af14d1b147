"""What all electrodes at once have taken of the levels that each had alone, in words.

Owns: that sentence. Must not know: how they are presented, what is stored.
"""

from __future__ import annotations

from collections.abc import Mapping

from etd.calibrate.progress import Progress
from etd.cli.doubts import said_of_caps
from etd.protocol.calibration import ElectrodeLimits


def said_of_whole(before: Mapping[int, ElectrodeLimits], progress: Progress) -> str | None:
    """None: nothing. `before`: what each was alone."""
    if progress.found == before:
        return None
    felt = {electrode: one for electrode, one in before.items() if one.felt and one.comfortable_ua}
    after_ua = progress.level_1_ua
    left = [after_ua.get(electrode, 0) / one.comfortable_ua for electrode, one in felt.items()]
    caps = [progress.found[electrode].cap_ua / one.cap_ua for electrode, one in felt.items()]
    kept = [part for part in left if part > 0.0]
    levels = f"their levels and caps are {min(kept):.0%}" if kept else "no level is left"
    if kept and min(left) >= 1.0:
        levels = f"their caps are {min(caps):.0%}, and their levels stay at the thresholds,"
    below = said_of_caps(progress.below_threshold)
    return (
        f"all electrodes at once were too strong: {levels} of what each was alone"
        f"{f'; {below}' if below else ''}"
    )
