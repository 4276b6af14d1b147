"""`etd report`: what a configuration can do to a person, for an ethics board and a methods section.

Owns: which configuration, and where the paper goes. Must not know: how a figure is calculated.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import msgspec

from etd.cli import options
from etd.cli.new_file import check_new_file
from etd.cli.run import kept_selftest, loaded_config
from etd.files.configuration import LoadedConfig
from etd.selftest.report import load

HELP = "what this configuration can do to a person: for an ethics board"
EPILOG = """
examples:
  etd report                          the installed configuration, /etc/etd/main.toml
  etd report --board fake             that of a fake board
  etd report --html report.html       a page to print
  etd report --methods                a paragraph for a methods section, to be completed

Charge, densities, energy and power are the most that the maxima of code, board and body site allow
on one electrode. A person's own caps are lower. What each guard lets through is explained in
docs/hardware.md.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_name(parser)
    options.add_configuration(parser, "the configuration of a fake board")
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--html", type=Path, metavar="FILE", help="write a page to this new file")
    what.add_argument("--methods", action="store_true", help="a paragraph, and nothing else")
    what.add_argument("--json", action="store_true", help="print one JSON object, also for errors")
    parser.set_defaults(machine=None)


def run(args: argparse.Namespace) -> int:
    """Raises: FileError."""
    # Imported here: `--help` needs none of it.
    from etd.report.figures import figures_of
    from etd.report.text import html, lines, methods

    check_new_file(args.html)
    loaded = loaded_config(args)
    found = figures_of(loaded, _selftest(args.name, loaded))
    if args.json:
        print(msgspec.json.encode({"ok": True, **msgspec.structs.asdict(found)}).decode())
    elif args.methods:
        print(methods(found))
    elif args.html is not None:
        args.html.write_text(html(found), encoding="utf-8")
        print(f"wrote {args.html}")
    else:
        print("\n".join(lines(found)).lstrip("\n"))
    return 0


def _selftest(name: str, loaded: LoadedConfig) -> str:
    """The last self-test of this board, in a sentence."""
    report = load(kept_selftest(name, loaded))
    if report is None:
        return "none is stored for this board"
    verdict = "passed" if report.is_pass else "NOT PASSED"
    return f"{verdict} on {report.date:%Y-%m-%d} (etd {report.versions.get('etd', '?')})"
