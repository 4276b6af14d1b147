"""A process beside a scan that does not end when the scan's does.

Owns: not ending. Must not know: why.
"""

from __future__ import annotations

import signal

from etd_hal.linux.side_process import begin


def main(control: int) -> None:
    with begin(control, ("nothing was granted", None)):
        while True:
            signal.pause()
