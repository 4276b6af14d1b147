"""`etd arm`: the operator arms; the application that holds the lease drives.

Owns: the printed answer. Must not know: what is checked before the supply is enabled.
"""

from __future__ import annotations

import argparse
import json

from etd.cli import options
from etd.client import Display

NAME = "arm"
HELP = "check the board, enable the supply, and let the holder of the lease drive"
EPILOG = """
example, in two terminals:
  etd play pattern.json --calibration P01     opens a lease, and waits
  etd arm                                     now it is felt

Without a lease there is nothing to arm: the application (or `etd play`) comes first.
"""
TIMEOUT_S = 20.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_name(parser)
    options.add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Raises: Refused (with the check that failed), DaemonGone."""
    with Display(args.name, client="etd arm") as display:
        display.arm_holder(TIMEOUT_S)
        holder = display.status().holder
    if args.json:
        print(json.dumps({"ok": True, "holder": holder}))
    else:
        print(f"armed; {holder or 'no client'} drives")
    return 0
