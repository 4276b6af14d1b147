"""`etd clear`: leave HALTED for SAFE.

Owns: the printed answer. Must not know: what latches a halt.
"""

from __future__ import annotations

import argparse
import json

from etd.cli import options
from etd.cli.running import display_of
from etd.protocol.text import shown

HELP = "leave HALTED for SAFE, after the cause has been checked"
EPILOG = """
example:
  etd status     shows the cause of the halt
  etd clear      back to SAFE; next, an application opens a lease, and `etd arm` arms it
"""

add_arguments = options.add_daemon_and_json


def run(args: argparse.Namespace) -> int:
    """Raises: Refused (nothing to clear, a stop line still open), DaemonGone."""
    with display_of(args, "etd clear") as display:
        halt = display.status().halt
        display.clear()
    cause = "" if halt is None else f"{halt.cause} ({halt.source})"
    if args.json:
        print(json.dumps({"ok": True, "was_halted_by": cause}))
    else:
        print(f"cleared: it was halted by {shown(cause)}; the state is SAFE")
    return 0
