"""`etd calibrate`: a person's thresholds, comfortable levels and caps, electrode by electrode.

Owns: which daemon, under which conditions, who answers, and what becomes of the result. Must not
know: procedures (etd.calibrate), keys, the picture.
"""

from __future__ import annotations

import argparse
import datetime
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import get_args

import msgspec

from etd.calibrate.answers import Answerer
from etd.calibrate.conditions import (
    Conditions,
    check_baseline,
    check_conditions,
    check_laws,
    identity,
)
from etd.calibrate.course import Course, Presents
from etd.calibrate.modelled import FeltPresents, ModelledBody
from etd.calibrate.person import SimulatedPerson
from etd.calibrate.progress import Progress, finished, load_progress, save_progress
from etd.calibrate.quest_plus import ready_questplus
from etd.calibrate.stimulator import Stimulator
from etd.calibrate.trial import Stopped
from etd.calibration import Calibration, Method, to_toml
from etd.cli import options
from etd.cli.calibrate_screen import Screen
from etd.cli.keys import keyboard
from etd.cli.new_file import check_new_file
from etd.cli.private_daemon import private_daemon, termination_as_ctrl_c
from etd.client import Display, clock
from etd.config import fake_config
from etd.errors import FileError, Refused
from etd.frame import Polarity
from etd.places import calibrating_file, check_name
from etd.protocol import HelloReply
from etd.version import __version__
from etd.wholefile import write_whole
from etd_hal.compose import wall_time
from etd_hal.tomlfile import convert

NAME = "calibrate"
HELP = "find a person's thresholds, comfortable levels and caps, one key per answer"
EPILOG = """
examples:
  etd calibrate P01 --max-current-ua 2500                  by the method of limits
  etd calibrate P01 --max-current-ua 2500 --method staircase --baseline P01
  etd calibrate P01 --method equalize --baseline P01       equal strength everywhere
  etd calibrate P01 --max-current-ua 2500 --board fake --array pad-8 --answers simulated

Every presentation is at most a tenth above what was accepted before, and never above
--max-current-ua. SPACE stops at once; what was found is kept, and the same command goes on with
it. docs/calibration.md tells what each method asks, and how long it takes.
"""
ARM_WITHIN_S = 20.0
_SAFE_WITHIN_S = 5.0
_LOOK_S = 0.3
_SILENT_MS = 300
#: What is called otherwise on the command line.
_OPTIONS = {
    "participant": "CODE",
    "cap_ua": "--max-current-ua",
    "width_us": "--width-us",
    "rate_hz": "--rate-hz",
    "pulses": "--pulses",
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("participant", metavar="CODE", help="a code for the person, never a name")
    options.add_name(parser)
    parser.add_argument(
        "--method", choices=get_args(Method), default="limits", help="default: limits"
    )
    parser.add_argument("--max-current-ua", type=int, metavar="I", help="nothing above it, ever")
    parser.add_argument("--width-us", type=int, metavar="W", help="default: the body site's")
    parser.add_argument("--rate-hz", type=options.positive, metavar="HZ", help="default: as well")
    parser.add_argument("--polarity", choices=get_args(Polarity), help="default: as well")
    options.add_returns(parser)
    parser.add_argument(
        "--pulses", type=int, default=10, metavar="N", help="of one presentation (default: 10)"
    )
    parser.add_argument("--baseline", metavar="NAME", help="an earlier calibration to begin from")
    parser.add_argument(
        "--reference", type=int, metavar="E", help="with equalize (default: the middle electrode)"
    )
    parser.add_argument(
        "--leave-out",
        type=_electrodes,
        default=(),
        metavar="E,E",
        help="not presented; the least threshold found becomes their cap",
    )
    parser.add_argument("--as", dest="which", metavar="NAME", help="keep it as NAME, not as CODE")
    parser.add_argument("--restart", action="store_true", help="forget what was begun")
    parser.add_argument("--arm", action="store_true", help="arm it, as an operator may")
    parser.add_argument(
        "--board", type=options.fake_board, metavar="fake[:BOARD]", help="a fake of its own"
    )
    parser.add_argument("--array", help="with --board fake: a shipped array, or a file")
    parser.add_argument(
        "--answers",
        choices=("keys", "simulated"),
        default="keys",
        help="simulated: with --board fake, whose body says what it felt",
    )
    parser.add_argument("--seed", type=int, default=1, help="of the simulated person")
    parser.add_argument("--out", type=Path, metavar="FILE", help="write the file, besides")
    options.add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Exit status 1: not all electrodes were settled, or it was stopped.

    Raises: Refused, FileError, HardwareMissing, DaemonGone, PartEnded.
    """
    _check_combinations(args)
    with _wrong_use(args):
        check_new_file(args.out)
        which = check_name(args.which or args.participant, "the code, or --as")
    if args.method == "quest-plus":
        ready_questplus()
    with (
        termination_as_ctrl_c(),
        _address(args) as address,
        _display(args, address) as display,
    ):
        with _wrong_use(args):
            calibrating = _Calibrating(args, display, which)
        try:
            calibrating.run()
        except KeyboardInterrupt:
            # A terminal that goes away, among others: nobody could press a key any more.
            display.stop()
            raise
        except Stopped as stopped:
            print(f"etd: {stopped}; the same command goes on with it", file=sys.stderr)
            return 1
        return calibrating.settle()


def _check_combinations(args: argparse.Namespace) -> None:
    if args.method == "equalize":
        if args.baseline is None:
            args.misused("--method equalize needs --baseline: its thresholds and caps hold")
        if args.max_current_ua is not None:
            args.misused("--method equalize goes by the caps of its --baseline: no other limit")
    elif args.max_current_ua is None:
        args.misused("--max-current-ua is needed: nobody is stimulated without a limit")
    if args.board is None and (args.array or args.answers == "simulated"):
        args.misused("--array and --answers simulated go with --board fake")


@contextmanager
def _wrong_use(args: argparse.Namespace) -> Iterator[None]:
    """What the command line says, or a file that it names, cannot be: status 2."""
    try:
        yield
    except FileError as error:
        args.misused(str(error))
        raise


@contextmanager
def _address(args: argparse.Namespace) -> Iterator[str | None]:
    if args.board is None:
        yield None
        return
    with _wrong_use(args):
        loaded = fake_config(args.board.board, args.array)
    with private_daemon("calibrate", loaded) as address:
        yield address


def _display(args: argparse.Namespace, address: str | None) -> Display:
    """Its lease has the operator's limit; with equalize, the baseline's caps."""
    client = f"etd calibrate {args.participant}"
    if args.method == "equalize":
        return Display(args.name, address=address, client=client, calibration=args.baseline)
    with Display(args.name, address=address, client=client) as asking:
        with _wrong_use(args):
            _check_limit(args.max_current_ua, asking.facts)
        width_us = args.width_us or asking.facts.default_width_us
        width_us += asking.facts.shape.prepulse_us
    return Display(
        args.name,
        address=address,
        client=client,
        max_current_ua=args.max_current_ua,
        width_us=width_us,
    )


def _check_limit(max_current_ua: int, facts: HelloReply) -> None:
    """Raises: FileError, naming the bound: the daemon would say to calibrate."""
    most_ua = facts.maxima.uncalibrated_current_ua
    if max_current_ua > most_ua:
        raise FileError(
            "the command line",
            "--max-current-ua",
            f"it says {max_current_ua}",
            f"at most {most_ua} uA: nobody gets more before being calibrated"
            f" (uncalibrated_current_ua of body site {facts.body_site}, and the board's maxima)",
        )


class _Calibrating:
    """One run of the command."""

    def __init__(self, args: argparse.Namespace, display: Display, which: str) -> None:
        self._args = args
        self._display = display
        self._which = which
        self._file = calibrating_file(args.name if args.board is None else "fake", which)
        self._baseline = display.calibration(args.baseline) if args.baseline else None
        self._check_electrodes()
        conditions = check_conditions(self._conditions())
        check_laws(conditions, display.facts.stabilizers)
        if self._baseline is not None:
            check_baseline(conditions, self._baseline)
        self._progress = self._begun(conditions)
        self._screen = Screen(display.facts.array, self._progress, is_quiet=args.json)
        self._left: dict[int, str] = {}

    def run(self) -> None:
        """Raises: Stopped, Refused, DaemonGone."""
        if not self._wanted():
            return
        self._arm()
        body = ModelledBody()
        with ExitStack() as stack:
            reports = stack.enter_context(
                self._display.telemetry("scan", "halt", "modelled", "state")
            )
            answerer: Answerer
            if self._args.answers == "simulated":
                answerer = SimulatedPerson(body.sense, self._args.seed)
            else:
                answerer = stack.enter_context(keyboard(self._screen.ask, self._screen.heard))
            stimulator = Stimulator(
                self._display,
                reports,
                clock.ClientClock(),
                self._progress.conditions,
                answerer.wants_stop,
                body.hear,
            )
            is_simulated = self._args.answers == "simulated"
            presents: Presents = FeltPresents(stimulator, body) if is_simulated else stimulator
            self._go_through(stimulator, presents, answerer)

    def _go_through(self, stimulator: Stimulator, presents: Presents, answerer: Answerer) -> None:
        course = Course(
            self._progress,
            presents,
            answerer,
            _today,
            baseline=self._baseline,
            on_progress=self._keep,
        )
        self._screen.begin()
        stimulator.open()
        course.run(self._wanted())
        self._left = course.left

    def settle(self) -> int:
        """Have the daemon keep what is complete; say what is missing otherwise."""
        missing = [one for one in self._progress.missing if one not in self._args.leave_out]
        if missing:
            for electrode in missing:
                print(f"electrode {electrode}: {self._left.get(electrode)}", file=sys.stderr)
            print(
                f"etd: {len(missing)} electrodes are not settled, and nothing is stored: the same"
                " command tries them again, --leave-out goes without them",
                file=sys.stderr,
            )
            return 1
        made = self._made()
        self._display.disarm()
        self._wait_for_safe()
        self._display.set_calibration(self._which, made)
        if self._args.out is not None:
            write_whole(self._args.out, to_toml(made).encode(), mode=0o640)
        self._file.unlink(missing_ok=True)
        self._answer(made)
        return 0

    # --- conditions --------------------------------------------------------------------------

    def _conditions(self) -> Conditions:
        """As asked, or the baseline's, or the body site's. Raises: FileError."""
        args, facts, base = self._args, self._display.facts, self._baseline
        returns = args.returns or (base.returns if base else "all")
        most_ua = args.max_current_ua
        if most_ua is None and base is not None:
            most_ua = max(one.cap_ua for one in base.electrode)
        width_us = args.width_us or (base.width_us if base else facts.default_width_us)
        asked = {
            "participant": args.participant,
            "method": args.method,
            "body_site": facts.body_site,
            "array": facts.array.name,
            "electrodes": facts.array.electrodes,
            "polarity": args.polarity or (base.polarity if base else facts.default_polarity),
            "width_us": width_us,
            "rate_hz": args.rate_hz or (base.rate_hz if base else facts.default_rate_hz),
            "returns": msgspec.to_builtins(returns),
            "pulses": args.pulses,
            "shape": msgspec.to_builtins(facts.shape.at(width_us)),
            "cap_ua": most_ua,
            "baseline": None if base is None else identity(args.baseline, base),
            "reference": self._reference() if args.method == "equalize" else None,
        }
        try:
            return convert(asked, Conditions, "the command line")
        except FileError as error:
            key = _OPTIONS.get(error.key, error.key)
            raise FileError(error.file, key, error.value, error.allowed) from error

    def _check_electrodes(self) -> None:
        """Raises: FileError, for one that the array does not have."""
        count = self._display.facts.array.electrodes
        named = {"--leave-out": self._args.leave_out, "--reference": (self._args.reference,)}
        for option, electrodes in named.items():
            for one in electrodes:
                if one is not None and not 0 <= one < count:
                    raise FileError(
                        "the command line",
                        option,
                        f"there is no electrode {one}",
                        f"0 to {count - 1}",
                    )

    def _begun(self, conditions: Conditions) -> Progress:
        """What there is of it. Raises: FileError, where that is under other conditions."""
        if self._args.restart or not self._file.exists():
            return Progress(conditions=conditions)
        progress = load_progress(self._file, conditions)
        print(f"going on: {len(progress.found)} electrodes are done", file=sys.stderr)
        return progress

    def _wanted(self) -> list[int]:
        return [one for one in self._progress.missing if one not in self._args.leave_out]

    def _reference(self) -> int:
        """The one that is named; else the nearest to the middle of those that the baseline felt."""
        if self._args.reference is not None:
            return int(self._args.reference)
        array, base = self._display.facts.array, self._baseline
        each = () if base is None else base.electrode[: array.electrodes]
        felt = [index for index, one in enumerate(each) if one.felt]
        middle_x = sum(array.x_mm) / array.electrodes
        middle_y = sum(array.y_mm) / array.electrodes
        return min(
            felt or range(array.electrodes),
            key=lambda one: (array.x_mm[one] - middle_x) ** 2 + (array.y_mm[one] - middle_y) ** 2,
        )

    # --- the daemon --------------------------------------------------------------------------

    def _arm(self) -> None:
        """The fake's skin is nobody's; everybody else's waits for the operator."""
        if self._args.board is not None or self._args.arm:
            self._display.arm(ARM_WITHIN_S)
            return
        is_told = False
        while not self._is_armed():
            if not is_told:
                print("waiting for the operator: `etd arm`", file=sys.stderr)
                is_told = True
            self._display.keep()
            clock.sleep_s(_LOOK_S)

    def _is_armed(self) -> bool:
        """A silent frame is the question, and opens the lease."""
        try:
            self._display.show_current([0] * self._display.electrodes, ttl_ms=_SILENT_MS)
        except Refused as refusal:
            if refusal.code != "not_armed":
                raise
            return False
        return True

    def _wait_for_safe(self) -> None:
        until_ns = clock.now_ns() + int(_SAFE_WITHIN_S * 1e9)
        while self._display.status().state != "SAFE" and clock.now_ns() < until_ns:
            clock.sleep_s(_LOOK_S / 10)

    # --- what is kept and told ---------------------------------------------------------------

    def _keep(self, progress: Progress) -> None:
        save_progress(self._file, progress)
        self._screen.found()

    def _made(self) -> Calibration:
        gamma = 1.0 if self._baseline is None else self._baseline.gamma
        return finished(self._progress, _today(), f"etd {__version__}", gamma)

    def _answer(self, made: Calibration) -> None:
        count = self._progress.presentations
        if self._args.json:
            answer = {
                "ok": True,
                "name": self._which,
                "presentations": count,
                "calibration": made,
            }
            print(msgspec.json.encode(answer).decode())
            return
        felt = [one for one in made.electrode if one.felt]
        print(
            f"{self._which}: {len(felt)} of {len(made.electrode)} electrodes are felt, thresholds"
            f" {min(one.threshold_ua for one in felt)} to {max(one.threshold_ua for one in felt)}"
            f" uA, {count} presentations; {self._where()}"
        )

    def _where(self) -> str:
        """It can be looked at again; a fake of one's own ends, and its calibrations with it."""
        if self._args.board is None:
            return f"`etd calibration show {self._which}`"
        if self._args.out is None:
            return "the fake ends here, and this with it: --out FILE keeps one"
        return f"kept in {self._args.out}"


def _today() -> datetime.date:
    return wall_time().date()


def _electrodes(text: str) -> tuple[int, ...]:
    """`3,7`. Raises: ArgumentTypeError."""
    try:
        return tuple(int(one) for one in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a list like 3,7") from None
