"""`etd arm`: the operator arms the board for the application that holds the lease.

Owns: the printed answer. Must not know: what is checked before the supply is enabled.
"""

from __future__ import annotations

import argparse

import msgspec

from etd.cli import options
from etd.cli.running import display_of
from etd.cli.taken import said_of_taken
from etd.protocol.text import shown

HELP = "check the board, and enable the supply for the application that holds the lease"
EPILOG = """
example, in two terminals:
  etd play pattern.json --calibration P01     opens a lease, and waits for the operator
  etd arm                                     checks the board; then the pattern plays

Start the application (or `etd play`) first: arming is refused while no lease is open.
"""
TIMEOUT_S = 20.0

add_arguments = options.add_daemon_and_json


def run(args: argparse.Namespace) -> int:
    """Raises: Refused (with the check that failed), DaemonGone."""
    with display_of(args, "etd arm") as display:
        taken = display.arm_holder(TIMEOUT_S)
        holder = display.status().holder
    if args.json:
        told = {"ok": True, "holder": holder, "calibrations": taken}
        print(msgspec.json.encode(told).decode())
    else:
        print(f"armed; {shown(holder or 'no client')} drives, with {said_of_taken(taken)}")
    return 0
