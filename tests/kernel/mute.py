"""A process beside a scan that never says that it is up.

Owns: silence. Must not know: why.
"""

from __future__ import annotations

import signal


def main(control: int) -> None:
    while True:
        signal.pause()
