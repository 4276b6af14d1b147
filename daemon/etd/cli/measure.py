"""`etd measure`: which electrodes touch the skin, and with what resistance.

Owns: the table and the picture. Must not know: how contact is measured.
"""

from __future__ import annotations

import argparse

import msgspec

from etd.apps.picture import Picture
from etd.cli import options
from etd.cli.running import display_of
from etd.protocol.messages import MeasureReply
from etd.protocol.outcome import Withheld

HELP = "measure the contact of every electrode with probe pulses that are not felt"
EPILOG = """
example:
  etd measure          a picture of the array, and a line for each electrode
  etd measure --json   {"ok", "contact", "resistance_ohm", ..., "withheld"}

The supply is enabled for the measurement, then switched off. A probe for which a limit leaves no
room, as soon after strong pulses, is not fired: its electrode is unknown, and why is said. Exit
status 1: no electrode touches.
"""
#: The smallest limits a lease can have: probes are bounded by the board, not by these.
_LIMIT_UA, _LIMIT_US = 50, 20
_TIMEOUT_S = 20.0
#: In place of the names in the protocol, where these do not speak for themselves.
_WORDS = {
    "interval": "the rest after its last pulse",
    "charge": "its charge of the last second",
    "pulses": "its pulses of the last second",
    "duty": "its time with current in the last second",
    "array charge": "the array's charge of the last second",
    "array duty": "the array's time with current in the last second",
    "return charge": "the charge of a return in the last second",
    "net charge": "its net charge, or that of a return",
    "cap": "its cap",
    "return_cap": "the cap of a return",
    "resolution": "less is allowed than the source can make",
}
_SIGNS = {True: "#", False: ".", None: "?"}

add_arguments = options.add_daemon_and_json


def run(args: argparse.Namespace) -> int:
    """Raises: Refused (another client's lease, a check before the supply), DaemonGone."""
    with display_of(args, "etd measure", _LIMIT_UA, _LIMIT_US) as display:
        found = display.measure(_TIMEOUT_S)
        array = display.facts.array
    if args.json:
        print(msgspec.json.encode(found).decode())
    else:
        picture = Picture(array.x_mm, array.y_mm)
        print("\n".join(picture.rows([_SIGNS[touches] for touches in found.contact])))
        print("\n".join(lines_of(found)))
    return 0 if any(found.contact) else 1


def lines_of(found: MeasureReply) -> list[str]:
    """The contacts as a picture, and a line for each electrode."""
    counts = ((True, "touched"), (False, "open"), (None, "unknown"))
    lines = [
        ", ".join(f"{_SIGNS[kind]} {found.contact.count(kind)} {what}" for kind, what in counts)
    ]
    why = {one.electrode: f"  no probe: {_words(one)}" for one in found.withheld}
    for electrode, contact in enumerate(found.contact):
        ohm, volt = found.resistance_ohm[electrode], found.voltage_v[electrode]
        resistance = "" if ohm is None else f"{ohm:>9} ohm"
        voltage = "" if volt is None else f"{volt:6.1f} V"
        pressure = _pressure(found, electrode)
        lines.append(f"{electrode:>4}  {_SIGNS[contact]} {resistance:>13} {voltage:>8}{pressure}")
        lines[-1] += why.get(electrode, "")
    waits_ms = [one.after_ms for one in found.withheld if one.after_ms is not None]
    if waits_ms:
        lines.append(
            f"{len(waits_ms)} were not measured, since limits of the last second left no room:"
            f" measure again in {max(waits_ms) / 1000:.1f} s"
        )
    return lines


def _words(withheld: Withheld) -> str:
    return _WORDS.get(withheld.reason, withheld.reason)


def _pressure(found: MeasureReply, electrode: int) -> str:
    """Only where there are sensors under the array."""
    if not found.pressure_kpa:
        return ""
    kpa = found.pressure_kpa[electrode]
    return "     ? kPa" if kpa is None else f" {kpa:5.0f} kPa"
