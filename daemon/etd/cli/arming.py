"""Arming for a command with keys: at once, or when the operator has; and SAFE again after it.

Owns: how it is asked and waited for. Must not know: what is done with the board.
"""

from __future__ import annotations

import sys

from etd.calibrate.trial import Stopped
from etd.cli.keys import Keyboard
from etd.client import Display, clock
from etd.protocol.errors import Refused

ARM_WITHIN_S = 20.0
_SAFE_WITHIN_S = 5.0
_LOOK_S = 0.3
_SILENT_MS = 300


def is_armed(display: Display) -> bool:
    """Sends a silent frame, which also opens the lease. Raises: Refused, except `not_armed`."""
    try:
        display.show_current([0] * display.electrodes, ttl_ms=_SILENT_MS)
    except Refused as refusal:
        if refusal.code != "not_armed":
            raise
        return False
    return True


def armed_for(display: Display, keys: Keyboard, *, at_once: bool) -> None:
    """Arm it, or wait until the operator has. Raises: Stopped; Refused; FileError, if there is no
    keyboard.
    """
    _heed(display, keys)
    if at_once:
        display.arm(ARM_WITHIN_S)
        return
    if is_armed(display):
        return
    print("waiting for the operator: `etd arm`   (SPACE STOP   q pause)", file=sys.stderr)
    while not is_armed(display):
        _heed(display, keys)
        display.keep()
        clock.sleep_s(_LOOK_S)


def _heed(display: Display, keys: Keyboard) -> None:
    """Before anything is presented. Raises: Stopped; FileError."""
    if (ending := keys.asked_to_end(is_before_all=True)) is not None:
        if ending == "stop":
            display.stop()
        raise Stopped(ending)


def safe_again(display: Display) -> None:
    """Disarm, and wait for it: a calibration is stored while no electrode is live."""
    display.disarm()
    until_ns = clock.now_ns() + int(_SAFE_WITHIN_S * 1e9)
    while display.status().state != "SAFE" and clock.now_ns() < until_ns:
        clock.sleep_s(_LOOK_S / 10)
