"""`etd calibrate`: a person's thresholds, comfortable levels and caps, electrode by electrode.

Owns: the options, which of them exclude each other, and the daemon and limit to use. Must not know:
the course of a calibration (calibrate_session), procedures, keys.
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Iterator
from contextlib import contextmanager
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

NAME = "calibrate"
HELP = "find a person's thresholds, comfortable levels and caps, one key per answer"
EPILOG = f"""
examples:
  etd calibrate P01 --max-current-ua 2500                  by the method of limits
  etd calibrate P01 --max-current-ua 2500 --method staircase --baseline P01
  etd calibrate P01 --method equalize --baseline P01       equal strength everywhere
  etd calibrate P01 --max-current-ua 2500 --board fake --array pad-8 --answers simulated

keys, without Enter:
  {legend("strength")}
  {legend("compare")}   (equalize)
  {legend("which")}   (equalize, after t)

Every presentation is at most a tenth above what was accepted before, and never above
--max-current-ua. SPACE stops at once (Esc and Ctrl-C too). What was found and what was
too strong is kept, and the same command (without --restart) goes on with it.
docs/calibration.md tells what each method asks, and how long it takes.

exit status: 0 the daemon keeps it, 1 stopped, refused, or not all electrodes settled, 2 used
wrongly, 3 the daemon is not there
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("participant", metavar="CODE", help="a code for the person, never a name")
    options.add_name(parser)
    parser.add_argument(
        "--method",
        choices=get_args(Method),
        default="limits",
        help="up until it is felt, several times (limits, the default); up and down (staircase);"
        " where the answer tells most (quest-plus, needs 'etd[quest-plus]'); as strong as a"
        " reference electrode (equalize)",
    )
    parser.add_argument(
        "--max-current-ua",
        type=int,
        metavar="I",
        help="nothing above it, ever; needed, but with equalize, which goes by the baseline's caps",
    )
    _add_conditions(parser)
    parser.add_argument(
        "--baseline", metavar="NAME", help="an earlier calibration of this person to begin from"
    )
    parser.add_argument(
        "--reference",
        type=int,
        metavar="E",
        help="with equalize: what the others are compared with (default: of those that were felt,"
        " the nearest to the middle)",
    )
    parser.add_argument(
        "--leave-out",
        type=_electrodes,
        default=(),
        metavar="E,E",
        help="not presented; the least threshold found becomes their cap",
    )
    parser.add_argument("--as", dest="which", metavar="NAME", help="keep it as NAME, not as CODE")
    parser.add_argument(
        "--restart",
        action="store_true",
        help="forget what was begun, what was too strong too, and begin anew",
    )
    parser.add_argument(
        "--arm", action="store_true", help="arm it too, where you are the operator as well"
    )
    parser.add_argument(
        "--board",
        type=options.fake_board,
        metavar="fake[:BOARD]",
        help="a fake of its own, in place of the running daemon",
    )
    parser.add_argument("--array", help="with --board fake: a shipped array, or a file")
    parser.add_argument(
        "--answers",
        choices=("keys", "simulated"),
        default="keys",
        help="simulated: with --board fake, whose body says what it felt",
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="of the simulated person (default: %(default)s)"
    )
    parser.add_argument(
        "--out", type=Path, metavar="FILE", help="write it into this new file as well"
    )
    options.add_json(parser)


def _add_conditions(parser: argparse.ArgumentParser) -> None:
    """The conditions of the calibration; levels hold for these only."""
    default = "default: the baseline's, else the body site's"
    parser.add_argument("--width-us", type=int, metavar="W", help=f"of each pulse ({default})")
    parser.add_argument(
        "--rate-hz", type=options.positive, metavar="HZ", help=f"of the pulses ({default})"
    )
    parser.add_argument("--polarity", choices=get_args(Polarity), help=default)
    options.add_returns(parser)
    parser.add_argument(
        "--pulses", type=int, default=10, metavar="N", help="of one presentation (default: 10)"
    )


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
            calibrating = CalibrateSession(args, display, which)
        try:
            calibrating.run()
        except KeyboardInterrupt:
            # A terminal that goes away, among others: no key could be pressed any more.
            display.stop()
            with contextlib.suppress(OSError):
                said = _sentence(Stopped("stop"), calibrating)
                print(f"etd: {said}", file=sys.stderr, flush=True)
            raise
        except Stopped as stopped:
            code = "paused" if stopped.answer == "pause" else "stopped"
            options.answer_no(args, code, _sentence(stopped, calibrating))
            return 1
        return calibrating.settle()


def _sentence(stopped: Stopped, calibrating: CalibrateSession) -> str:
    if calibrating.has_found:
        return f"{stopped}; what was found is kept; {calibrating.same_command} goes on with it"
    if calibrating.has_lowered:
        return (
            f"{stopped}; nothing was found yet, but what was too strong is kept:"
            f" {calibrating.same_command} stays below it"
        )
    return f"{stopped}; nothing was found yet; the same command begins anew"


def _check_combinations(args: argparse.Namespace) -> None:
    if args.method == "equalize":
        if args.baseline is None:
            args.misused("--method equalize needs --baseline: its thresholds and caps hold")
        if args.max_current_ua is not None:
            args.misused("--method equalize goes by the caps of its --baseline: no other limit")
    elif args.max_current_ua is None:
        args.misused("--max-current-ua is needed: there is no stimulation without a limit")
    if args.board is None and (args.array or args.answers == "simulated"):
        args.misused("--array and --answers simulated go with --board fake")


@contextmanager
def _wrong_use(args: argparse.Namespace) -> Iterator[None]:
    """A wrong value on the command line, or in a file that it names: status 2."""
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
    """A display whose lease has the operator's limit; with equalize, the baseline's caps."""
    client = f"etd calibrate {args.participant}"
    if args.method == "equalize":
        return Display(args.name, address=address, client=client, calibration=args.baseline)
    with Display(args.name, address=address, client=client) as asking:
        with _wrong_use(args):
            _check_limit(args.max_current_ua, asking.facts)
        width_us = args.width_us
        if width_us is None:
            width_us = asking.facts.default_width_us
        width_us += asking.facts.shape.prepulse_us
    return Display(
        args.name,
        address=address,
        client=client,
        max_current_ua=args.max_current_ua,
        width_us=width_us,
    )


def _check_limit(max_current_ua: int, facts: HelloReply) -> None:
    """Raises: FileError, naming the bound; the daemon's own refusal would say to calibrate."""
    most_ua = facts.maxima.uncalibrated_current_ua
    if max_current_ua > most_ua:
        raise FileError(
            COMMAND_LINE,
            "--max-current-ua",
            f"it says {max_current_ua}",
            f"at most {most_ua} uA is allowed without a calibration"
            f" (uncalibrated_current_ua of body site {facts.body_site}, and the board's maxima)",
        )


def _electrodes(text: str) -> tuple[int, ...]:
    """`3,7`. Raises: ArgumentTypeError."""
    try:
        return tuple(int(word) for word in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r} is not a list like 3,7") from None
