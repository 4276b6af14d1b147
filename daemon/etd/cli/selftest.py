"""`etd selftest`: test a board before it is connected to a person.

Owns: the instructions to the operator, the printed result, and where the report is stored. Must not
know: what is checked (etd.selftest).
"""

from __future__ import annotations

import argparse
import contextlib
from collections.abc import Iterator
from pathlib import Path

import msgspec

from etd.cli import options
from etd.cli.new_file import check_new_file
from etd.cli.run import kept_selftest, loaded_config
from etd.cli.selftest_ending import broken_off_once
from etd.cli.selftest_table import Quiet, Table, table_of
from etd.files.as_started import keep_as_started
from etd.files.configuration import LoadedConfig
from etd.files.exclusive import ENGINE, NameLock
from etd.files.lasting import why_forgotten
from etd.files.paths import board_as_started_file, make_own
from etd.protocol.errors import FileError
from etd.selftest.fixture import DummyLoad, Fixture, SelftestOptions
from etd.selftest.ladder import largest_ohm
from etd.selftest.report import Check, Report, arming_refusal, save
from etd.selftest.run import cut_short
from etd.selftest.run import run as run_stages
from etd.selftest.subject import strongest_ua
from etd_hal.backend import Bench
from etd_hal.bench import Operator, StopName
from etd_hal.compose import open_fake_bench, open_linux_bench, wall_time

HELP = "test the board in stages of growing risk, before it is connected to a person"
EPILOG = """
examples:
  etd selftest                                                the board of /etc/etd/main.toml
  etd selftest --dummy-load 47000 --second-load 10000 --load-electrodes 0,1
                                                              all checks, with two resistors
  etd selftest --board fake --dummy-load 47000 --second-load 10000 --load-electrodes 0,1

Without --dummy-load only imperceptible probe pulses are fired, and checks that need a load are
skipped. A source up to 24 times too strong is detected within the bound of a probe; if it is
stronger, or jumps between two pulses, one pulse exceeds the bound: keep fingers off the array.

With --dummy-load you confirm that NO PERSON is connected: the resistor is between the two
electrodes, and nothing else touches the array. The test then asks for the resistor at every
electrode in turn, and again with the second resistor. The daemon must not run. docs/bring-up.md
describes the procedure.

A board can be armed only after a self-test in which no check failed or was skipped. A fake board
can be armed without any, but not after one that did not pass: use the loads of the last example.

exit status: 0 all passed, 1 a check failed or was skipped, 2 wrong usage, or a file cannot be read
or written, 3 the hardware is missing or in use
"""

#: Lower: the ADC resolves too little at a probe. Higher: the leakage is too large a part.
LOAD_OHM = (10_000, 100_000)
#: Loads nearer to each other than this could be confused.
LEAST_RATIO = 1.5
#: The largest value accepted; a working one-shot is far shorter.
LONGEST_ONE_SHOT_US = 1_000_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_name(parser)
    options.add_configuration(parser, "a fake board with a fake operator")
    # The fake on a bench has the times of a pi4.
    parser.set_defaults(machine=None)
    load_ohm = options.whole(*LOAD_OHM, "ohm")
    parser.add_argument(
        "--dummy-load", type=load_ohm, metavar="OHM", help="a resistor is connected, and no person"
    )
    parser.add_argument(
        "--second-load",
        type=load_ohm,
        metavar="OHM",
        help=f"a second resistor, at least {LEAST_RATIO} times larger or smaller: repeats the test"
        " of every electrode",
    )
    parser.add_argument(
        "--load-electrodes",
        type=_pair,
        metavar="A,B",
        help="the two electrodes that the resistor connects",
    )
    parser.add_argument(
        "--one-shot-us",
        type=options.whole(1, LONGEST_ONE_SHOT_US, "us"),
        metavar="US",
        help="the one-shot's time, measured with an oscilloscope: software cannot measure it",
    )
    parser.add_argument(
        "--no-operator", action="store_true", help="skip the checks that need a person at the board"
    )
    parser.add_argument(
        "--report",
        type=Path,
        metavar="FILE",
        help="also write the report to this new file, for your records",
    )
    options.add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Raises: HardwareMissing, BusError, AlreadyRunning. Files that cannot be read are wrong use:
    status 2.
    """
    with options.wrong_use(args):
        return _run(args)


def _run(args: argparse.Namespace) -> int:
    """Raises: FileError, HardwareMissing, BusError, AlreadyRunning."""
    loaded = loaded_config(args)
    asked = _asked(args, loaded)
    kept = kept_selftest(args.name, loaded)
    check_new_file(args.report)
    with broken_off_once():
        bench = _open(loaded, asked)
        try:
            with _kept_for_safe(args.name, loaded):
                report = _tested(args, loaded, bench, asked, kept)
        finally:
            bench.backend.close()
    for path in (kept, *_copies(args)):
        save(report, path)
    _print_report(args, report, kept)
    return 0 if report.passed else 1


def _pair(text: str) -> tuple[int, int]:
    parts = text.split(",")
    if len(parts) != 2 or not all(part.isdecimal() for part in parts):
        raise argparse.ArgumentTypeError(f"{text!r} is not two electrodes (A,B)")
    first, second = map(int, parts)
    if first == second:
        raise argparse.ArgumentTypeError(f"{text!r} is the same electrode twice")
    return first, second


def _asked(args: argparse.Namespace, loaded: LoadedConfig) -> SelftestOptions:
    ohm, pair, second_ohm = args.dummy_load, args.load_electrodes, args.second_load
    if args.one_shot_us is not None and loaded.board.guards.one_shot == "absent":
        args.misused(f"--one-shot-us: {loaded.board.name} has no one_shot")
    if (ohm is None) != (pair is None):
        args.misused("--dummy-load and --load-electrodes go together")
    if ohm is None:
        if second_ohm is not None:
            args.misused("--second-load goes with --dummy-load and --load-electrodes")
        return SelftestOptions(None, args.one_shot_us)
    _check_reach(args, loaded, ohm)
    if second_ohm is not None and max(ohm, second_ohm) < LEAST_RATIO * min(ohm, second_ohm):
        args.misused(
            f"--second-load: {second_ohm} ohm is too close to {ohm} ohm; use a resistor at least"
            f" {LEAST_RATIO} times larger or smaller"
        )
    count = loaded.array.count
    if max(pair) >= count:
        args.misused(f"--load-electrodes: {loaded.array.name} has electrodes 0 to {count - 1}")
    if count < 3:
        args.misused("--dummy-load needs an array with a third electrode, which stays open")
    second = None if second_ohm is None else DummyLoad(second_ohm, *pair)
    return SelftestOptions(DummyLoad(ohm, *pair), args.one_shot_us, second)


def _check_reach(args: argparse.Namespace, loaded: LoadedConfig, ohm: int) -> None:
    """The highest allowed current must be measurable with the load."""
    most_ua = strongest_ua(loaded)
    largest = largest_ohm(loaded.board.source, most_ua)
    if largest is not None and ohm > largest:
        args.misused(
            f"--dummy-load: {loaded.board.name} cannot drive {most_ua} uA into {ohm} ohm, and the"
            f" highest allowed current must be tested; use at most {largest} ohm"
        )


def _open(loaded: LoadedConfig, asked: SelftestOptions) -> Bench:
    """Raises: HardwareMissing, BusError."""
    if loaded.config.backend == "linux":
        return open_linux_bench(loaded.board, loaded.machine)
    load = asked.load
    bench = open_fake_bench(loaded.board, electrodes=loaded.array.outputs())
    if load is not None and bench.operator is not None:
        bench.operator.clip(load.resistance_ohm, load.first, load.second)
    return bench


@contextlib.contextmanager
def _kept_for_safe(name: str, loaded: LoadedConfig) -> Iterator[None]:
    """Once the lines are held: after a kill `etd safe` must find those that were moved, and not
    those of an engine before. One that runs, on other lines, has its own there.

    Raises: FileError, AlreadyRunning.
    """
    if loaded.config.backend == "fake":
        yield
        return
    copy = board_as_started_file(name, "linux", None)
    with contextlib.ExitStack() as held:
        try:
            make_own(copy.parent, 0o700)
            lock = NameLock(copy.parent, name, ENGINE["linux"])
            held.enter_context(contextlib.closing(lock))
            keep_as_started(copy, loaded.board_file)
        except OSError as error:
            why = f"the board's file cannot be kept there ({error.strerror})"
            raise FileError(str(copy), "", why, "let this user write there") from error
        yield


def _tested(
    args: argparse.Namespace, loaded: LoadedConfig, bench: Bench, asked: SelftestOptions, kept: Path
) -> Report:
    """Raises: FileError, before the test begins, if a report cannot be stored."""
    table = table_of(is_quiet=args.json)
    operator = None if args.no_operator else _Operator(table, bench.operator)
    fixture = Fixture(loaded, bench, operator, asked)
    # Until the end the stored report says that the test was cut short.
    for path in (*_copies(args), kept):
        save(cut_short(fixture, wall_time()), path)
    return run_stages(fixture, wall_time(), table.check, table.stage)


def _copies(args: argparse.Namespace) -> tuple[Path, ...]:
    return () if args.report is None else (args.report,)


class _Operator:
    """A person who gets instructions, or the fake's operator."""

    def __init__(self, table: Table | Quiet, operator: Operator | None) -> None:
        self._table = table
        self._fake = operator

    def press(self, stop: StopName) -> None:
        self._table.ask(f"press the {stop.replace('_', ' ')}, and release it")
        if self._fake is not None:
            self._fake.press(stop)

    def hold(self, stop: StopName) -> None:
        self._table.ask(f"press the {stop.replace('_', ' ')}, and HOLD it until asked to release")
        if self._fake is not None:
            self._fake.hold(stop)

    def let_go(self, stop: StopName) -> None:
        self._table.ask(f"release the {stop.replace('_', ' ')}")
        if self._fake is not None:
            self._fake.let_go(stop)

    def clip(self, load_ohm: int, first: int, second: int) -> None:
        self._table.ask(f"connect {load_ohm} ohm between electrodes {first} and {second}")
        if self._fake is not None:
            self._fake.clip(load_ohm, first, second)

    def ground(self, load_ohm: int, electrode: int) -> None:
        self._table.ask(
            f"connect {load_ohm} ohm between electrode {electrode} and the board's ground"
        )
        if self._fake is not None:
            self._fake.ground(load_ohm, electrode)

    def misplaced(self, asked: int, found: tuple[int, ...]) -> None:
        where = "electrode " + ", ".join(map(str, found[:8]))
        self._table.ask(
            f"the resistor was found at {where} instead of {asked}: move it, or check the wiring"
        )
        if self._fake is not None:
            self._fake.misplaced(asked, found)

    def stand_back(self) -> None:
        self._table.ask("HANDS OFF the board: strong pulses are fired into the load now")
        if self._fake is not None:
            self._fake.stand_back()


def _print_report(args: argparse.Namespace, report: Report, kept: Path) -> None:
    refused = arming_refusal(kept, report.subject)
    if args.json:
        answer = {
            "ok": report.passed,
            "kept": str(kept),
            "arming_refused": refused,
            "report": report,
        }
        print(msgspec.json.encode(answer).decode())
        return
    bad = [check for check in report.checks if not check.is_good]
    for check in bad:
        if check.result == "fail":
            print(f"FAIL {check.title}: {check.measured}\n     {check.advice}")
    for advice, names in _skipped(bad).items():
        print(f"SKIP {', '.join(names)}\n     {advice}")
    if report.absent_guards:
        print(f"absent guards: {', '.join(report.absent_guards)}")
    for sentence in report.not_seen:
        print(f"not covered by any check: {sentence}")
    subject = report.subject
    passed = "passed" if report.passed else f"NOT PASSED: {len(bad)} failed or were skipped"
    print(
        f"{subject.board} on {subject.machine} (backend: {subject.backend}): {passed};"
        f" report in {kept}"
    )
    forgotten = why_forgotten(kept)
    if forgotten is not None and subject.backend == "linux":
        print(
            f"after the next boot this report may be gone, and the board not armed: {kept}"
            f" {forgotten}; switch the overlay off for the test, or mount a partition there"
        )
    if refused is not None:
        print(f"this board is not armed until it passes: {refused}")


def _skipped(checks: list[Check]) -> dict[str, list[str]]:
    """For each advice, the checks that were skipped for lack of it."""
    found: dict[str, list[str]] = {}
    for check in checks:
        if check.result == "skip":
            found.setdefault(check.advice, []).append(check.title)
    return found
