"""`etd calibrate`: a person's thresholds, comfortable levels and caps, electrode by electrode.

Owns: the options, which of them exclude each other, and the daemon and limit to use. Must not know:
the course of a calibration (calibrate_session), procedures, keys.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import sys
from pathlib import Path
from typing import get_args

from etd.calibrate.quest_plus import ready_questplus
from etd.calibrate.trial import Stopped
from etd.cli import options
from etd.cli.calibrate_conditions import COMMAND_LINE
from etd.cli.calibrate_session import CalibrateSession
from etd.cli.keys import legend
from etd.cli.new_file import check_new_file
from etd.cli.private_daemon import private_daemon, termination_as_ctrl_c
from etd.client import Display
from etd.files.configuration import fake_config
from etd.files.paths import check_name
from etd.protocol.calibration import Method
from etd.protocol.errors import FileError
from etd.protocol.frame import Polarity
from etd.protocol.messages import HelloReply

HELP = "find a person's thresholds, comfortable levels and caps, one key per answer"
EPILOG = f"""
examples:
  etd calibrate P01 --max-current-ua 2500                  method of limits
  etd calibrate P01 --max-current-ua 2500 --method staircase --baseline P01
  etd calibrate P01 --method equalize --baseline P01       equal strength on all electrodes
  etd calibrate P01 --max-current-ua 2500 --board fake --array pad-8 --answers simulated

keys, without Enter:
  {legend("strength")}
  {legend("compare")}   (equalize)
  {legend("which")}   (equalize, after t)

Each presentation is at most 10 % above the strongest accepted before, and never above
--max-current-ua. SPACE stops at once (also Esc and Ctrl-C). Results are saved, also what was
too strong; the same command (without --restart) continues from there.
docs/calibration.md describes each method, and how long it takes.

exit status: 0 the daemon has stored the calibration, 1 stopped, refused, or some electrodes have
no result, 2 wrong usage, 3 the daemon is missing
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("participant", metavar="CODE", help="a code for the person, never a name")
    options.add_daemon(parser)
    parser.add_argument(
        "--method",
        choices=get_args(Method),
        default="limits",
        help="limits (default): several ascents until it is felt; staircase: up and down around"
        " the threshold; quest-plus: QUEST+ (needs 'etd[quest-plus]'); equalize: as strong as a"
        " reference electrode",
    )
    parser.add_argument(
        "--max-current-ua",
        type=int,
        metavar="I",
        help="the highest current that is presented; required, except with equalize, which uses the"
        " baseline's caps",
    )
    _add_conditions(parser)
    parser.add_argument(
        "--baseline", metavar="NAME", help="an earlier calibration of this person to start from"
    )
    parser.add_argument(
        "--reference",
        type=int,
        metavar="E",
        help="with equalize: the electrode that the others are compared with (default: the felt"
        " electrode nearest to the middle)",
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
        help="discard the saved progress, also what was too strong, and start again",
    )
    parser.add_argument("--arm", action="store_true", help="arm the board; needs operate rights")
    options.add_fake(
        parser, "start a daemon with a fake board, instead of using the running daemon"
    )
    parser.add_argument(
        "--answers",
        choices=("keys", "simulated"),
        default="keys",
        help="simulated: with --board fake, a modelled person answers",
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="random seed of simulated answers (default: 1)"
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="also write it to this new file")
    options.add_json(parser)


def _add_conditions(parser: argparse.ArgumentParser) -> None:
    """The conditions of the calibration; levels hold for these only."""
    default = "default: the baseline's, else the body site's"
    parser.add_argument("--width-us", type=int, metavar="W", help=f"pulse width ({default})")
    parser.add_argument(
        "--rate-hz", type=options.positive, metavar="HZ", help=f"pulse rate ({default})"
    )
    parser.add_argument("--polarity", choices=get_args(Polarity), help=default)
    options.add_returns(parser)
    parser.add_argument(
        "--pulses", type=int, default=10, metavar="N", help="pulses a presentation (default: 10)"
    )


def run(args: argparse.Namespace) -> int:
    """Raises: Refused, FileError, HardwareMissing, DaemonGone, PartEnded."""
    _check_combinations(args)
    with options.wrong_use(args):
        check_new_file(args.out)
        which = check_name(args.which or args.participant, "the code, or --as")
    if args.method == "quest-plus":
        ready_questplus()
    with (
        termination_as_ctrl_c(),
        _address(args) as address,
        _display(args, address) as display,
    ):
        with options.wrong_use(args):
            calibrating = CalibrateSession(args, display, which)
        try:
            calibrating.run()
        except KeyboardInterrupt:
            # A terminal that goes away, among others: no key could be pressed any more.
            display.stop()
            with contextlib.suppress(OSError):
                said = calibrating.after(Stopped("stop"))
                print(f"etd: {said}", file=sys.stderr, flush=True)
            raise
        except Stopped as stopped:
            code = "paused" if stopped.answer == "pause" else "stopped"
            options.answer_no(args, code, calibrating.after(stopped))
            return 1
        return calibrating.settle()


def _check_combinations(args: argparse.Namespace) -> None:
    if args.method == "equalize":
        if args.baseline is None:
            args.misused("--method equalize needs --baseline: it uses its thresholds and caps")
        if args.max_current_ua is not None:
            args.misused("--method equalize uses the caps of --baseline: omit --max-current-ua")
    elif args.max_current_ua is None:
        args.misused("--max-current-ua is required: without a limit nothing is stimulated")
    if args.board is not None and args.host is not None:
        args.misused("--board fake is calibrated here, --host is another computer: one of the two")
    if args.board is None and (args.array or args.answers == "simulated"):
        args.misused("--array and --answers simulated go with --board fake")


def _address(args: argparse.Namespace) -> contextlib.AbstractContextManager[str | None]:
    if args.board is None:
        return contextlib.nullcontext()
    with options.wrong_use(args):
        loaded = fake_config(args.board.board, args.array)
    return private_daemon("calibrate", loaded)


def _display(args: argparse.Namespace, address: str | None) -> Display:
    """A display whose lease has the operator's limit; with equalize, the baseline's caps."""
    opened = functools.partial(
        Display,
        args.name,
        host=args.host,
        address=address,
        client=f"etd calibrate {args.participant}",
    )
    if args.method == "equalize":
        return opened(calibration=args.baseline)
    with opened() as asking:
        with options.wrong_use(args):
            _check_limit(args.max_current_ua, asking.facts)
        width_us = args.width_us
        if width_us is None:
            width_us = asking.facts.default_width_us
        width_us += asking.facts.shape.prepulse_us
    return opened(max_current_ua=args.max_current_ua, width_us=width_us)


def _check_limit(max_current_ua: int, facts: HelloReply) -> None:
    """Raises: FileError, with the bound; the daemon's own refusal would advise to calibrate."""
    most_ua = facts.maxima.uncalibrated_current_ua
    if max_current_ua > most_ua:
        raise FileError(
            COMMAND_LINE,
            "--max-current-ua",
            f"{max_current_ua} uA is too high",
            f"at most {most_ua} uA is allowed without a calibration"
            f" (uncalibrated_current_ua of body site {facts.body_site}, and the board's maxima)",
        )


def _electrodes(text: str) -> tuple[int, ...]:
    """`3,7`. Raises: ArgumentTypeError."""
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a list like 3,7") from None
