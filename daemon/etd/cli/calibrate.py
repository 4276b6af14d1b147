"""`etd calibrate`: a person's thresholds, comfortable levels and caps, electrode by electrode.

Owns: the options, and the daemon and limit to use. Must not know: which of them exclude each other
(calibrate_combinations), the course of a calibration (calibrate_session), procedures, keys.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TypeAlias, get_args

import msgspec

from etd.calibrate.adaptation import QUESTIONS, USE_S
from etd.calibrate.quest_plus import ready_questplus
from etd.calibrate.trial import Stopped
from etd.cli import options
from etd.cli.adaptation_session import AdaptationSession
from etd.cli.borrowed import array_of, calibration_of, lend
from etd.cli.calibrate_added import added_by, calibrated_first
from etd.cli.calibrate_combinations import check_combinations
from etd.cli.calibrate_conditions import COMMAND_LINE
from etd.cli.calibrate_kept import alone
from etd.cli.calibrate_result import tell_trials, until_cleared
from etd.cli.calibrate_session import CalibrateSession
from etd.cli.extras import check_fake
from etd.cli.fit_session import FitSession
from etd.cli.keys import legend
from etd.cli.new_file import check_new_file
from etd.cli.private_daemon import answer_within_s, private_daemon, termination_as_ctrl_c
from etd.cli.taken_name import add_replace
from etd.client import Display
from etd.files.configuration import LoadedConfig, fake_config
from etd.files.paths import check_name
from etd.protocol.calibration import MOST_SEED, Calibration, Method, SkinCelsius
from etd.protocol.errors import DaemonGone, EtdError, FileError, Refused
from etd.protocol.frame import Polarity
from etd.protocol.messages import HelloReply
from etd.protocol.opening import LEAST_LIMIT_UA

#: As every client waits for an answer.
_ANSWERED_WITHIN_S = 2.0

#: An hour: touch has adapted after a quarter of one.
_MOST_USE_S = 3_600
_Session: TypeAlias = CalibrateSession | FitSession | AdaptationSession
_SESSIONS: Mapping[str | None, type[_Session]] = {
    None: CalibrateSession,
    "--fit": FitSession,
    "--adaptation": AdaptationSession,
}

HELP = "find a person's thresholds, comfortable levels and caps, one key per answer"
EPILOG = f"""
examples:
  etd calibrate P01 --max-current-ua 2500              by a staircase
  etd calibrate P01 --max-current-ua 2500 --rate-hz 100
  etd calibrate P01 --max-current-ua 2500 --method limits --baseline P01
  etd calibrate P01 --method equalize --baseline P01   equal strength everywhere
  etd calibrate P01 --fit --max-current-ua 2500        k of the law power_law
  etd calibrate P01 --adaptation                       whether use is felt less
  etd calibrate P01 --max-current-ua 2500 --board fake --answers simulated
  etd calibrate fake --fit --baseline fake-fingertip-pad-8 --as K01
      --max-current-ua 3000 --board fake --answers simulated

keys, without Enter:
  {legend("strength")}
  after t: t again, or what it was instead
with equalize:
  {legend("compare")}
  {legend("which")}
  (after t)
with --adaptation:
  {legend("in_use")}
with --ask-sensation:
{legend("quality")}
{legend("place")}

Electrodes come in random order, and one trial in eight is silent; how many of
those were felt is kept. Each presentation is at most 10 % above the strongest
accepted before, and never above --max-current-ua. SPACE stops at once (also
Esc and Ctrl-C). Results are saved, also what was too strong; the same command
(without --restart) continues from there, with a lower limit too. Every trial is
kept in a table, which is named at the end. Levels hold at every rate up to that
of the calibration: calibrate at the highest rate of the study.
docs/calibration.md describes each method, and how long it takes.

exit status: 0 the daemon has stored the calibration, 1 stopped, refused, or
some electrodes have no result, 2 wrong usage, 3 the daemon is missing
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("participant", metavar="CODE", help="a code for the person, never a name")
    options.add_daemon(parser)
    parser.add_argument(
        "--method",
        choices=get_args(Method),
        default="staircase",
        help="staircase (default): up and down around the threshold; limits: several ascents until"
        " it is felt; quest-plus: QUEST+ (needs 'etd[quest-plus]'); equalize: as strong as a"
        " reference electrode",
    )
    parser.add_argument(
        "--max-current-ua",
        type=int,
        metavar="I",
        help="the highest current that is presented; required, except with equalize and"
        " --adaptation, which use a calibration's caps",
    )
    _add_conditions(parser)
    parser.add_argument(
        "--baseline", metavar="NAME", help="an earlier calibration of this person to start from"
    )
    parser.add_argument(
        "--reference",
        type=int,
        metavar="E",
        help="with equalize: the electrode that the others are compared with (default: of those"
        " that are not left out, with the most room above their comfortable level, the nearest to"
        " the middle)",
    )
    parser.add_argument(
        "--fit",
        action="store_true",
        help="measure how far the thresholds of this calibration follow the skin's resistance, for"
        " the law power_law: six electrodes in five states of the skin, half an hour",
    )
    parser.add_argument(
        "--adaptation",
        action="store_true",
        help="ask whether the array in use is felt less after minutes, for what the person's word"
        " may raise: some 17 minutes, after five minutes of rest",
    )
    parser.add_argument(
        "--use-s",
        type=_use_s,
        metavar="S",
        help=f"with --adaptation: in use for so long ({QUESTIONS} to {_MOST_USE_S}; default:"
        f" {USE_S:g})",
    )
    parser.add_argument(
        "--electrodes",
        type=_electrodes,
        default=(),
        metavar="E,E",
        help="with --fit: those that are asked, four or more (default: six over the array)",
    )
    parser.add_argument(
        "--leave-out",
        type=_electrodes,
        default=(),
        metavar="E,E",
        help="electrodes that are not presented; their cap is the lowest threshold found",
    )
    parser.add_argument("--as", dest="which", metavar="NAME", help="store it as NAME, not as CODE")
    parser.add_argument(
        "--restart",
        action="store_true",
        help="discard the saved progress, but not what was too strong, and start again",
    )
    parser.add_argument(
        "--forget-too-strong",
        action="store_true",
        help="with --restart: discard that too, and what it was stopped at; it may come again",
    )
    add_replace(parser)
    parser.add_argument("--arm", action="store_true", help="arm the board; needs operate rights")
    options.add_fake(
        parser, "start a daemon with a fake board, instead of using the running daemon"
    )
    options.add_finger(parser)
    parser.add_argument(
        "--answers",
        choices=("keys", "simulated"),
        default="keys",
        help="simulated: with --board fake, a modelled person answers",
    )
    parser.add_argument(
        "--seed",
        type=_seed,
        help="of the random order of electrodes and silent trials, which the file keeps, and of"
        " simulated answers (default: drawn; 1 with simulated answers)",
    )
    parser.add_argument(
        "--ask-sensation",
        action="store_true",
        help="ask of each electrode what it feels like, and where",
    )
    parser.add_argument(
        "--skin-celsius",
        type=_skin_celsius,
        metavar="T",
        help="the temperature of the skin under the array, to be noted",
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write it to this new file")
    parser.add_argument(
        "--trials",
        type=Path,
        metavar="FILE",
        help="the new table of trials (default: a name with person, array and time, beside --out or"
        " in this folder)",
    )
    parser.add_argument(
        "--blind",
        action="store_true",
        help="do not show currents: for a person who sees the screen and answers",
    )
    options.add_json(parser)


def _add_conditions(parser: argparse.ArgumentParser) -> None:
    """The conditions of the calibration; levels hold for these only."""
    default = "default: the baseline's, else the body site's"
    parser.add_argument("--width-us", type=int, metavar="W", help=f"pulse width ({default})")
    parser.add_argument(
        "--rate-hz", type=options.positive, metavar="HZ", help=f"pulse rate ({default})"
    )
    polarities = get_args(Polarity)
    parser.add_argument(
        "--polarity",
        choices=polarities,
        metavar="POLARITY",
        help=f"{', '.join(polarities)} ({default})",
    )
    options.add_returns(parser)
    parser.add_argument(
        "--pulses", type=int, default=10, metavar="N", help="pulses a presentation (default: 10)"
    )


def run(args: argparse.Namespace) -> int:
    """Raises: Refused, FileError, HardwareMissing, DaemonGone, PartEnded, PythonTooOld (a fake)."""
    check_combinations(args)
    with options.wrong_use(args):
        check_new_file(args.out)
        check_new_file(args.trials)
        which = check_name(args.which or args.participant, "the code, or --as")
    if args.method == "quest-plus":
        ready_questplus()
    with (
        termination_as_ctrl_c(),
        _alone(args, which),
        _address(args) as address,
        _display(args, address) as display,
    ):
        display.check_may_store()
        with options.wrong_use(args):
            kind = _SESSIONS[added_by(args)]
            calibrating: _Session = kind(args, display, which)
        try:
            calibrating.run()
        except KeyboardInterrupt:
            # A terminal that goes away, among others: no key could be pressed any more.
            display.stop()
            with contextlib.suppress(OSError):
                ended = Stopped("stop")
                print(f"etd: {_said(args, ended, calibrating)}", file=sys.stderr, flush=True)
                tell_trials(args, calibrating.trials)
            raise
        except Stopped as stopped:
            code = "paused" if stopped.answer == "pause" else "stopped"
            said = _said(args, stopped, calibrating)
            options.answer_no(args, code, said, trials=calibrating.trials)
            tell_trials(args, calibrating.trials)
            return 1
        except EtdError as error:
            is_unsaved = isinstance(error, FileError) and error.file == calibrating.saved_in
            is_told = isinstance(error, Refused | DaemonGone | FileError) and not is_unsaved
            if is_told and calibrating.stage.has_begun:
                # The lease has lapsed, the daemon has ended, a disk is full: not what was answered.
                print(f"etd: {calibrating.kept}", file=sys.stderr, flush=True)
            tell_trials(args, calibrating.trials)
            raise
        return calibrating.settle()


def _said(args: argparse.Namespace, stopped: Stopped, calibrating: _Session) -> str:
    """What was kept is told once it has begun."""
    kept = f"; {calibrating.kept}" if calibrating.stage.has_begun else ""
    return f"{stopped}{until_cleared(args, stopped)}{kept}"


@contextlib.contextmanager
def _alone(args: argparse.Namespace, which: str) -> Iterator[None]:
    with contextlib.ExitStack() as stack:
        with options.wrong_use(args):
            stack.enter_context(alone(args, which))
        yield


def _address(args: argparse.Namespace) -> contextlib.AbstractContextManager[str | None]:
    if args.board is None:
        return contextlib.nullcontext(options.address_named(args))
    check_fake()
    lent = None if args.baseline is None else calibration_of(args.name, args.baseline)
    with options.wrong_use(args):
        loaded = fake_config(args.board.board, args.array or array_of(lent))
    return _private(args, loaded, lent)


@contextlib.contextmanager
def _private(
    args: argparse.Namespace, loaded: LoadedConfig, lent: Calibration | None
) -> Iterator[str]:
    own = private_daemon(
        "calibrate",
        loaded,
        timeout_factor=args.timeout_factor,
        finger=args.finger,
        is_breathing=args.fit,
    )
    with own as address:
        if args.baseline is not None:
            option = added_by(args)
            with calibrated_first(option) if option else contextlib.nullcontext():
                lend(address, args.name, args.baseline, lent, _answered_within_s(args))
        yield address


def _display(args: argparse.Namespace, address: str | None) -> Display:
    """A display whose lease has the operator's limit; with equalize, or in use, the baseline's
    caps.
    """
    opened = functools.partial(
        Display,
        args.name,
        host=args.host,
        address=address,
        client=f"etd calibrate {args.participant}",
        timeout_s=_answered_within_s(args),
    )
    if args.method == "equalize" or args.adaptation:
        return opened(calibration=args.baseline)
    with opened() as asking:
        with options.wrong_use(args):
            _check_limit(args.max_current_ua, asking.facts)
        width_us = args.width_us
        if width_us is None:
            width_us = asking.facts.default_width_us
        width_us += asking.facts.shape.prepulse_us
    return opened(max_current_ua=args.max_current_ua, width_us=width_us)


def _answered_within_s(args: argparse.Namespace) -> float:
    """By the daemon. Of its own one, on the fake, all time-outs are longer, and so is this."""
    if args.board is None:
        return _ANSWERED_WITHIN_S
    return answer_within_s(args.timeout_factor)


def _check_limit(max_current_ua: int, facts: HelloReply) -> None:
    """Raises: FileError, with the bounds that hold here; the daemon's own refusal would advise to
    calibrate, and knows of one too low only what holds anywhere.
    """
    most_ua = facts.maxima.uncalibrated_current_ua
    if not LEAST_LIMIT_UA <= max_current_ua <= most_ua:
        raise FileError(
            COMMAND_LINE,
            "--max-current-ua",
            f"{max_current_ua} uA is too {'high' if max_current_ua > most_ua else 'low'}",
            f"{LEAST_LIMIT_UA} to {most_ua} uA are allowed without a calibration (at most"
            f" uncalibrated_current_ua of body site {facts.body_site}, and the board's maxima)",
        )


def _use_s(text: str) -> float:
    """Raises: ArgumentTypeError."""
    seconds = options.positive(text)
    if not QUESTIONS <= seconds <= _MOST_USE_S:
        raise argparse.ArgumentTypeError(f"{text!r} is not from {QUESTIONS} to {_MOST_USE_S} s")
    return seconds


def _seed(text: str) -> int:
    """Raises: ArgumentTypeError."""
    if not text.isdecimal() or int(text) > MOST_SEED:
        raise argparse.ArgumentTypeError(f"{text!r} is not a whole number up to {MOST_SEED}")
    return int(text)


def _skin_celsius(text: str) -> float:
    """Raises: ArgumentTypeError."""
    try:
        return msgspec.convert(float(text), SkinCelsius)
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a temperature from 5 to 45") from None


def _electrodes(text: str) -> tuple[int, ...]:
    """`3,7`. Raises: ArgumentTypeError."""
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a list like 3,7") from None
