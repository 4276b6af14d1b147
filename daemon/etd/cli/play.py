"""`etd play FILE`: plays a pattern file on the running daemon or on a fake board.

Owns: which daemon plays it, how it is armed, and what is printed while it plays and at its end.
Must not know: when the next frame is due (apps.player), what is sent (apps.steps).
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable
from pathlib import Path
from typing import get_args

import msgspec

from etd.apps.player import Player, Summary
from etd.apps.steps import Currents, PlayOptions, steps_of
from etd.cli import options
from etd.cli.private_daemon import private_daemon
from etd.cli.terminal import progress_of
from etd.client import Display
from etd.files.configuration import fake_config
from etd.files.pattern import Pattern, load_pattern
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.frame import Polarity

HELP = "play a pattern file of etd or of eTactileKit"
EPILOG = """
examples:
  etd play wave.json --board fake                  on a fake board, with a daemon of its own
  etd play wave.json --calibration P01             on the running daemon; the operator arms it
  etd play wave.json --calibration P01 --level 0.5
  etd play wave.json --current-ua 1500 --width-us 100 --max-rate 60

Levels are those of the calibration, at the rate and polarity it was made with. With --current-ua, a
level of 1 is that current, which is also the limit, at the file's rate and polarity.
"""
ARM_WITHIN_S = 20.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="the pattern")
    options.add_daemon(parser)
    options.add_fake(parser, "play on a fake board, with a daemon that ends with this command")
    options.add_machine(parser)
    parser.add_argument(
        "--trace", type=Path, metavar="FILE", help="with --board fake: record its buses"
    )
    parser.add_argument("--calibration", metavar="NAME", help="default: the daemon's default")
    parser.add_argument(
        "--level", type=_level, metavar="L", help="play level 1 of the file as level L"
    )
    parser.add_argument("--current-ua", type=int, metavar="I", help="level 1 of the file is I uA")
    parser.add_argument("--width-us", type=int, metavar="W", help="with --current-ua")
    parser.add_argument("--polarity", choices=get_args(Polarity), help="in place of the file's")
    options.add_returns(parser)
    parser.add_argument("--max-rate", type=options.positive, metavar="HZ", help="the highest rate")
    parser.add_argument(
        "--allow-slower", action="store_true", help="slow down frames that do not fit"
    )
    parser.add_argument(
        "--repeat", type=options.whole(1, 1_000_000), default=1, metavar="N", help="play it N times"
    )
    parser.add_argument("--arm", action="store_true", help="arm the board; needs operate rights")
    options.add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Raises: PatternError, FileError, Refused, DaemonGone, PartEnded."""
    _check_combinations(args)
    pattern, told = load_pattern(args.file)
    teller = _Teller(list(told), is_quiet=args.json)
    with _address(args, pattern) as address, _display(args, address) as display:
        backend = display.facts.board.backend
        steps = steps_of(
            pattern,
            _play_options(args, display),
            display.electrodes,
            _calibration(args, display),
            teller,
        )
        with progress_of(len(pattern.frames) * args.repeat, is_quiet=args.json) as on_frame:
            player = Player(display, steps, on_frame)
            _arm(args, display, player, teller)
            try:
                summary = player.play(args.repeat)
            except Refused as refusal:
                raise _on_modelled(args, refusal) from None
    _answer(args, backend, summary, teller)
    return 0


def _on_modelled(args: argparse.Namespace, refusal: Refused) -> Refused:
    """Of a modelled machine's processor it says where the figure is from."""
    if args.machine is None or refusal.bound_by != "processor":
        return refusal
    return Refused(
        refusal.code,
        f"{refusal.reason} (the processor of the modelled {args.machine} is reckoned from what"
        " computing takes on this computer: too much, while it is busy with something else)",
        refusal.electrode,
        refusal.achievable_hz,
        refusal.bound_by,
    )


class _Teller:
    """Sentences go to stderr at once, and into the JSON answer at the end."""

    def __init__(self, told: list[str], is_quiet: bool) -> None:
        self.told: list[str] = []
        self._is_quiet = is_quiet
        for sentence in told:
            self(sentence)

    def __call__(self, sentence: str) -> None:
        self.told.append(sentence)
        if not self._is_quiet:
            print(sentence, file=sys.stderr)


# --- which daemon ------------------------------------------------------------------------------


def _check_combinations(args: argparse.Namespace) -> None:
    """Options that do not go together end with status 2."""
    if args.board is None and (args.array or args.machine or args.trace):
        args.misused(
            "--array, --machine and --trace go with --board fake: a running daemon has its own"
        )
    if args.board is not None and args.host is not None:
        args.misused("--board fake is played here, --host is another computer: one of the two")
    if (args.current_ua is None) != (args.width_us is None):
        args.misused("--current-ua and --width-us go together: a current needs a width")
    if args.current_ua is not None and (args.level or args.calibration):
        args.misused("--level and --calibration, or --current-ua and --width-us: one of the two")


def _address(
    args: argparse.Namespace, pattern: Pattern
) -> contextlib.AbstractContextManager[str | None]:
    """The control address of the fake's own daemon; None for the running one."""
    if args.board is None:
        return contextlib.nullcontext()
    loaded = fake_config(args.board.board, args.array, pattern.electrodes)
    return private_daemon("play", loaded, args.trace, args.machine)


def _display(args: argparse.Namespace, address: str | None) -> Display:
    return Display(
        args.name,
        host=args.host,
        address=address,
        client=f"etd play {args.file.name}",
        calibration=args.calibration,
        max_current_ua=args.current_ua,
        width_us=args.width_us,
    )


def _play_options(args: argparse.Namespace, display: Display) -> PlayOptions:
    currents = None
    if args.current_ua is not None:
        currents = Currents(args.current_ua, args.width_us, display.facts.default_rate_hz)
    return PlayOptions(
        level=1.0 if args.level is None else args.level,
        currents=currents,
        polarity=args.polarity,
        returns=args.returns,
        max_rate_hz=args.max_rate,
        allows_slower=args.allow_slower,
    )


def _calibration(args: argparse.Namespace, display: Display) -> Calibration | None:
    """What levels refer to; None with --current-ua. Raises: Refused (`limits_missing`)."""
    if args.current_ua is not None:
        return None
    name = args.calibration or display.facts.default_calibration
    if name is None:
        raise Refused(
            "limits_missing",
            "levels need a calibration: give --calibration"
            f" ({', '.join(display.facts.calibrations) or 'the daemon has none'}), or"
            " --current-ua and --width-us",
        )
    return display.calibration(name)


def _arm(
    args: argparse.Namespace, display: Display, player: Player, tell: Callable[[str], None]
) -> None:
    """Arm a fake board at once; for a real board wait for the operator."""
    if args.board is not None or args.arm:
        display.arm(ARM_WITHIN_S)
    else:
        player.wait_until_armed(tell)


# --- the answer --------------------------------------------------------------------------------


def _answer(args: argparse.Namespace, backend: str, summary: Summary, teller: _Teller) -> None:
    if args.json:
        played = {
            "ok": True,
            "file": str(args.file),
            "backend": backend,
            "frames": summary.frames,
            "clamped_frames": len(summary.clamped_frames),
            "clamped": list(summary.clamped.values()),
            "not_fired": dict(summary.not_fired),
            "slowed_to_hz": summary.slowed_to_hz,
            "soft_start_s": round(summary.soft_start_s, 3),
            "played_s": round(summary.played_s, 3),
            "told": teller.told,
        }
        print(msgspec.json.encode(played).decode())
        return
    for clamp in summary.clamped.values():
        print(
            f"clamped: electrode {clamp.electrode} got {clamp.allowed_ua} uA instead of"
            f" {clamp.wanted_ua} uA ({clamp.reason} of electrode {clamp.limited_by})"
        )
    print(_last_line(args, backend, summary))


#: What a count of the summary counts.
_NOT_FIRED = {
    "ledger": "pulses that the ledger did not allow",
    "overrun": "scans that started late",
    "processor": "pauses for the processor",
    "resolution": "pulses below one step of the source",
}


def _last_line(args: argparse.Namespace, backend: str, summary: Summary) -> str:
    slowed = "" if summary.slowed_to_hz is None else f", slowed to {summary.slowed_to_hz:.1f} Hz"
    shortfalls = ", ".join(
        f"{count} {_NOT_FIRED.get(reason, reason)}" for reason, count in summary.not_fired.items()
    )
    return (
        f"{args.file.name}: {summary.frames} frames in {summary.played_s:.1f} s on {backend},"
        f" after {summary.soft_start_s:.1f} s of soft start; {len(summary.clamped_frames)} frames"
        " clamped"
        f"{slowed}; not fired: {shortfalls or 'nothing'}"
    )


def _level(text: str) -> float:
    with contextlib.suppress(ValueError):
        if 0 < float(text) <= 1:
            return float(text)
    raise argparse.ArgumentTypeError(f"{text!r} is not above 0 and at most 1")
