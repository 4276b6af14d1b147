"""`etd record`: records of what was asked and fired, begun, ended, shown, exported and replayed.

Owns: the printed answers, and the files written. Must not know: what a record's line says.
"""

from __future__ import annotations

import argparse
import contextlib
import json
import sys
from collections.abc import Callable, Sequence
from pathlib import Path

import msgspec

from etd.cli import options
from etd.cli.extras import check_fake
from etd.cli.new_file import check_new_file, write_new_file
from etd.cli.record_source import WHICH, WHOSE, fetch, record_file
from etd.cli.running import display_of
from etd.client import Display
from etd.files.paths import check_name
from etd.protocol.text import shown
from etd.replay.compare import Comparison
from etd_hal.compose import open_replay

HELP = "write, show and export records of all that is asked and fired"
EPILOG = """
examples:
  etd record start p01-block1     from now on, whichever program stimulates
  etd note "changed the finger"   a remark in the record (etd note --help)
  etd record stop
  etd record show p01-block1      how long, what was fired where, what went wrong
  etd record csv p01-block1 --out sub-01_task-detect_events.tsv
                                  a table that follows BIDS, and its .json beside it
  etd record replay p01-block1    the same once more on a fake board that measures
                                  what was measured: are its pulses the same?
  etd record get p01-block1 p01-block1.jsonl
                                  the record itself, JSON Lines
  etd record show ./p01-block1.jsonl
                                  show, csv, pattern and replay take such a file too:
                                  what has a separator or a suffix is a file

The daemon writes records on its own disk, at most 512 MB each. NAME is a code, never a person's
name. What a line of a record says is in docs/records.md.
"""

_PULSES_A_LINE = 500


def add_arguments(parser: argparse.ArgumentParser) -> None:
    actions = parser.add_subparsers(
        title="what", metavar="start|stop|list|show|csv|pattern|replay|get|delete", required=True
    )
    start = options.add_action(actions, "start", _start, "begin a record")
    options.add_action(actions, "stop", _stop, "end the record that is being written")
    options.add_action(actions, "list", _list, "list the daemon's records")
    show = options.add_action(actions, "show", _show, "sum a record up")
    csv = options.add_action(actions, "csv", _csv, "write the events as a table that follows BIDS")
    pattern = options.add_action(actions, "pattern", _pattern, "write the frames as a pattern file")
    get = options.add_action(actions, "get", _get, "fetch a record from the daemon")
    replay = options.add_action(
        actions, "replay", _replay, "play a record on a fake board, and compare"
    )
    delete = options.add_action(
        actions, "delete", _delete, "delete a record from the daemon's disk"
    )
    for each in (start, get, delete):
        each.add_argument("which", metavar="NAME", help=WHOSE)
    replay.add_argument(
        "--config",
        type=Path,
        metavar="FILE",
        help="the configuration of that time (default: the shipped files that the record names)",
    )
    for each in (show, csv, pattern, replay):
        each.add_argument("which", metavar="NAME|FILE", help=WHICH)
    csv.add_argument(
        "--out",
        type=Path,
        metavar="FILE.tsv",
        help="a new file; what its columns say goes beside it, to FILE.json (default: standard"
        " output)",
    )
    pattern.add_argument(
        "--of",
        choices=("levels", "currents"),
        help="which of its stimuli, where a record has both: those asked for in levels, or those"
        " in currents",
    )
    for each in (pattern, get):
        each.add_argument("file", type=Path, metavar="FILE", help="a new file")


def run(args: argparse.Namespace) -> int:
    """Raises: Refused (`no_record`, `record_failed`, `not_found`, `wrong_state`, `not_permitted`),
    FileError, DaemonGone.
    """
    if args.act in (_start, _get, _delete):
        check_name(args.which, WHOSE)
    return int(args.act(args))


def _display(args: argparse.Namespace) -> Display:
    return display_of(args, "etd record")


# --- on the daemon -----------------------------------------------------------------------------


def _start(args: argparse.Namespace) -> int:
    with _display(args) as display:
        display.start_record(args.which)
    _say(args, f"the record {args.which} has begun; `etd record stop` ends it")
    return 0


def _stop(args: argparse.Namespace) -> int:
    with _display(args) as display:
        display.stop_record()
        records = display.records()
    _say(args, "the record has ended", records=records)
    return 0


def _list(args: argparse.Namespace) -> int:
    with _display(args) as display:
        records, problem = display.records(), display.status().record_problem
    if args.json:
        _say(args, "", records=records, problem=problem)
        return 0
    if not records:
        print("the daemon has no records: `etd record start NAME` begins one")
    for facts in records:
        running = "  is being written" if facts.is_running else ""
        print(f"{shown(facts.name):<32}  {facts.bytes / 1e6:8.2f} MB{running}")
    if problem is not None:
        print(f"the last record ended by itself: {shown(problem)}", file=sys.stderr)
    return 0


def _delete(args: argparse.Namespace) -> int:
    with _display(args) as display:
        display.delete_record(args.which)
    _say(args, f"the record {args.which} was deleted")
    return 0


def _get(args: argparse.Namespace) -> int:
    check_new_file(args.file)
    with _display(args) as display:
        size = fetch(display, args.which, args.file)
    _say(args, f"wrote {args.file} ({size / 1e6:.2f} MB)", bytes=size, file=str(args.file))
    return 0


# --- what is in it -----------------------------------------------------------------------------


def _show(args: argparse.Namespace) -> int:
    from etd.record.reader import RecordReader
    from etd.record.summary import summary_of

    with record_file(args.which, lambda: _display(args)) as path:
        summary = summary_of(RecordReader(path))
    if args.json:
        _say(args, "", summary=summary)
        return 0
    from etd.record.text import lines_of

    print("\n".join(map(shown, lines_of(summary))))
    return 0


def _csv(args: argparse.Namespace) -> int:
    from etd.record.events import sidecar, table
    from etd.record.reader import RecordReader

    if args.out is not None and args.out.suffix != ".tsv":
        args.misused(f"--out {args.out}: a table of events that follows BIDS ends in .tsv")
    beside = None if args.out is None else args.out.with_suffix(".json")
    check_new_file(args.out)
    check_new_file(beside)
    with record_file(args.which, lambda: _display(args)) as path:
        reader = RecordReader(path)
        lines = list(table(reader))
    if args.out is None or beside is None:
        print("\n".join(lines))
        _warn("missing", reader.missing)
        return 0
    write_new_file(args.out, "\n".join(lines) + "\n")
    said_beside = json.dumps(sidecar(reader.missing), indent=2)
    write_new_file(beside, said_beside + "\n")
    said = f"wrote {len(lines) - 1} events to {args.out}, and what its columns say to {beside}"
    files = [str(args.out), str(beside)]
    _say(args, said, events=len(lines) - 1, files=files, missing=reader.missing)
    if not args.json:
        _warn("missing", reader.missing)
    return 0


def _pattern(args: argparse.Namespace) -> int:
    from etd.record.pattern import FramesToPattern
    from etd.record.reader import RecordReader

    check_new_file(args.file)
    with record_file(args.which, lambda: _display(args)) as path:
        reader = RecordReader(path)
        made = FramesToPattern(reader, str(path), args.of)
    write_new_file(args.file, json.dumps(made.pattern, indent=1) + "\n")
    frames = len(made.pattern["frames"])
    what = "as in the record" if made.full_ua is None else f"1.0 was {made.full_ua} uA"
    said = f"wrote {frames} frames to {args.file}; levels: {what}"
    more = {"left_out": made.left_out, "missing": reader.missing}
    _say(args, said, frames=frames, file=str(args.file), full_ua=made.full_ua, **more)
    if not args.json:
        _warn("left out", made.left_out)
        _warn("missing", reader.missing)
    return 0


def _replay(args: argparse.Namespace) -> int:
    """1: not the same."""
    check_fake()
    from etd.replay.configuration import loaded_of
    from etd.replay.replay import caveats_of, check_same_files, replayed

    with record_file(args.which, lambda: _display(args)) as path:
        loaded = loaded_of(path, args.config)
        check_same_files(path, loaded)
        caveats = caveats_of(path)
        for sentence in () if args.json else caveats:
            # Before it is played, which may take long.
            print(shown(sentence), file=sys.stderr, flush=True)
        stage = open_replay(loaded.board, electrodes=loaded.array.outputs())
        with contextlib.closing(stage.backend):
            found = replayed(path, loaded, stage, _told_progress(args.json))
    _say_replay(args, found, caveats)
    return 0 if found.is_same else 1


def _told_progress(is_quiet: bool) -> Callable[[int], None]:
    if is_quiet or not sys.stderr.isatty():
        return lambda _: None

    def tell(pulses: int) -> None:
        if pulses % _PULSES_A_LINE == 0:
            print(f"\r{pulses} pulses", end="\r", file=sys.stderr, flush=True)

    return tell


def _say_replay(args: argparse.Namespace, found: Comparison, caveats: tuple[str, ...]) -> None:
    if args.json:
        said = {**msgspec.structs.asdict(found), "is_same": found.is_same, "caveats": caveats}
        print(msgspec.json.encode({"ok": True, **said}).decode())
        return
    for sentence in found.refused:
        print(f"refused in the replay: {shown(sentence)}")
    for difference in found.differences:
        print(difference)
    if found.lost:
        print(f"{found.lost} pulses were lost when the record was written: they cannot be compared")
    print(
        f"{found.same} pulses are the same; {found.other} differ, {found.missing} are in the record"
        f" only, {found.more} in the replay only; at most {found.latest_us:.0f} us apart\n"
        f"contact polls between them: {found.polls} in both, {found.polls_alone} in one only"
        " (not compared)"
    )


def _warn(what: str, sentences: Sequence[str]) -> None:
    for sentence in sentences:
        print(f"{what}: {shown(sentence)}", file=sys.stderr)


def _say(args: argparse.Namespace, sentence: str, **said: object) -> None:
    if args.json:
        print(msgspec.json.encode({"ok": True, **said}).decode())
    else:
        print(sentence)
