"""`etd note`: a remark in the record that is being written.

Owns: the printed answer. Must not know: records.
"""

from __future__ import annotations

import argparse

from etd.cli import options
from etd.cli.running import display_of

HELP = "write a remark into the record that is being written"
EPILOG = """
example:
  etd record start p01-block1
  etd note "the participant changed the finger"

Never a person's name: a record goes to others. `etd record --help` says what becomes of a record.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("text", metavar="TEXT", help="up to 1 000 characters, in one line")
    options.add_daemon_and_json(parser)


def run(args: argparse.Namespace) -> int:
    """Raises: Refused (`no_record`, `not_permitted`, `busy`, `bad_message`), DaemonGone."""
    with display_of(args, "etd note") as display:
        display.note(args.text)
    print('{"ok":true}' if args.json else "noted")
    return 0
