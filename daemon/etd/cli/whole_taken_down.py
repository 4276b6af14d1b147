"""What all electrodes at once have taken of the levels that each had alone, in words.

Owns: that sentence. Must not know: how they are presented, what is stored.
"""

from __future__ import annotations

from etd.calibrate.progress import Progress
from etd.cli.doubts import said_of_caps


def said_of_whole(before_ua: dict[int, int], progress: Progress) -> str | None:
    """None: nothing. `before_ua`: level 1 of each before."""
    after_ua = progress.level_1_ua
    left = [after_ua.get(electrode, 0) / ua for electrode, ua in before_ua.items()]
    if all(part >= 1.0 for part in left):
        return None
    kept = [part for part in left if part > 0.0]
    levels = f"their levels and caps are {min(kept):.0%}" if kept else "no level is left"
    below = said_of_caps(progress.below_threshold)
    return (
        f"all electrodes at once were too strong: {levels} of what each was alone"
        f"{f'; {below}' if below else ''}"
    )
