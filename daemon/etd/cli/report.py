"""`etd report`: what a configuration can do to a person, for an ethics board and a methods section.

Owns: which configuration, and where the paper goes. Must not know: how a figure is calculated.
"""

from __future__ import annotations

import argparse
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import msgspec

from etd.cli import options
from etd.cli.new_file import check_new_file, write_new_file
from etd.cli.record_source import WHICH, record_file
from etd.cli.run import kept_selftest, loaded_config
from etd.client import Display
from etd.files.configuration import LoadedConfig
from etd.protocol.text import shown
from etd.selftest.report import load

if TYPE_CHECKING:
    from etd.record.summary import Summary

HELP = "what this configuration can do to a person: for an ethics board"
EPILOG = """
examples:
  etd report                          the installed configuration, /etc/etd/main.toml
  etd report --board fake             that of a fake board
  etd report --html report.html       a page to print
  etd report --record p01-block1      also the dose of each electrode, and all halts: of a
                                      record of the daemon, or of a file (./p01-block1.jsonl)
  etd report --methods                a paragraph for a methods section, to be completed

Charge, densities, energy and power are the most that the maxima of code, board and body site allow
on one electrode. A person's own caps are lower. What each guard lets through is explained in
docs/hardware.md.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_name(parser)
    options.add_configuration(parser, "the configuration of a fake board")
    parser.add_argument(
        "--record", metavar="NAME|FILE", help=f"also what a record has: dose and halts; {WHICH}"
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--html", type=Path, metavar="FILE", help="write a page to this new file")
    what.add_argument("--methods", action="store_true", help="a paragraph, and nothing else")
    what.add_argument("--json", action="store_true", help="print one JSON object, also for errors")
    parser.set_defaults(machine=None)


def run(args: argparse.Namespace) -> int:
    """Raises: FileError; Refused (`not_found`) and DaemonGone, for a record's name."""
    # Imported here: `--help` needs none of it.
    from etd.report.figures import figures_of
    from etd.report.recorded import differences, recorded_sections, recorded_sentence
    from etd.report.text import html, lines, methods

    check_new_file(args.html)
    summary = None if args.record is None else _summary(args.record, args.name)
    loaded = loaded_config(args)
    found = figures_of(loaded, _selftest(args.name, loaded))
    more = () if summary is None else recorded_sections(summary, found)
    differs = () if summary is None else differences(summary, found)
    if args.json:
        recorded = {} if summary is None else {"record": summary, "record_differs": differs}
        said = {"ok": True, **msgspec.structs.asdict(found), **recorded}
        print(msgspec.json.encode(said).decode())
    elif args.methods:
        print(methods(found))
        if summary is not None:
            print(recorded_sentence(summary, found))
    elif args.html is not None:
        write_new_file(args.html, html(found, more))
        print(f"wrote {args.html}")
        for sentence in (*(() if summary is None else summary.missing), *differs):
            print(f"as it says: {shown(sentence)}", file=sys.stderr)
    else:
        print("\n".join(lines(found, more)).lstrip("\n"))
    return 0


def _summary(which: str, name: str) -> Summary:
    from etd.record.reader import RecordReader
    from etd.record.summary import summary_of

    with record_file(which, lambda: Display(name, client="etd report")) as path:
        return summary_of(RecordReader(path))


def _selftest(name: str, loaded: LoadedConfig) -> str:
    """The last self-test of this board, in a sentence."""
    report = load(kept_selftest(name, loaded))
    if report is None:
        return "none is stored for this board"
    verdict = "passed" if report.is_pass else "NOT PASSED"
    return f"{verdict} on {report.date:%Y-%m-%d} (etd {report.versions.get('etd', '?')})"
