"""`etd play FILE`: plays a pattern file on the running daemon or on a fake board.

Owns: which daemon plays it, how it is armed, and what is printed while it plays and at its end.
Must not know: how a pattern is played (`Display.play`).
"""

from __future__ import annotations

import argparse
import contextlib
import sys
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import cast, get_args

import msgspec

from etd.cli import options
from etd.cli.arming import is_armed
from etd.cli.borrowed import array_of, calibration_of, lend
from etd.cli.extras import check_fake
from etd.cli.private_daemon import answer_within_s, private_daemon
from etd.cli.terminal import progress_of
from etd.client import Display
from etd.client.patterns import PatternOptions
from etd.client.playing import Played
from etd.files.configuration import LoadedConfig, fake_config
from etd.files.pattern import Pattern, load_pattern
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.frame import Polarity
from etd.protocol.text import shown

HELP = "play a pattern file of etd or of eTactileKit"
EPILOG = """
examples:
  etd play wave.json --board fake                  on a fake board, with a daemon of its own
  etd play wave.json --calibration P01             on the running daemon; the operator arms it
  etd play wave.json --calibration P01 --level 0.5
  etd play wave.json --calibration P01-anodic,P01-cathodic    a frame's polarity says which holds
  etd play wave.json --current-ua 1500 --width-us 100 --max-rate 60

Levels are those of the calibration, at its polarity, and at the file's rate up to the
calibration's. With --current-ua, a level of 1 is that current, which is also the
limit, at the file's rate and polarity. In Python: display.play("wave.json").
"""
ARM_WITHIN_S = 20.0
_LOOK_S = 0.3


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("file", type=Path, metavar="FILE", help="the pattern")
    options.add_daemon(parser)
    options.add_fake(parser, "play on a fake board, with a daemon that ends with this command")
    options.add_machine(parser)
    parser.add_argument(
        "--trace", type=Path, metavar="FILE", help="with --board fake: record its buses"
    )
    parser.add_argument(
        "--calibration",
        type=_names,
        metavar="NAME",
        help="default: the daemon's default; NAME,NAME for one made with each polarity",
    )
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
    """Raises: PatternError, FileError, Refused, DaemonGone, PartEnded, PythonTooOld (a fake)."""
    _check_combinations(args)
    pattern, told = load_pattern(args.file)
    teller = _Teller(list(told), is_quiet=args.json)
    with _address(args, pattern) as address, _display(args, address) as display:
        backend = display.facts.board.backend
        _check_limits(args, display)
        asked = _options(args)
        display.check_pattern(pattern, **asked)
        with progress_of(len(pattern.frames) * args.repeat, is_quiet=args.json) as on_frame:
            asked["tell"], asked["on_frame"] = teller, on_frame
            _arm(args, display, teller)
            try:
                played = display.play(pattern, **asked)
            except Refused as refusal:
                raise _advised(args, refusal) from None
    _answer(args, backend, played, teller)
    return 0


def _check_limits(args: argparse.Namespace, display: Display) -> None:
    """Raises: Refused (`limits_missing`), with the options that help."""
    facts = display.facts
    if (args.current_ua, args.calibration, facts.default_calibration) == (None, None, None):
        raise Refused(
            "limits_missing",
            "levels need a calibration: give --calibration"
            f" ({', '.join(facts.calibrations) or 'the daemon has none'}), or"
            " --current-ua and --width-us",
        )


def _options(args: argparse.Namespace) -> PatternOptions:
    """Of `Display.play`."""
    given = {
        "level": args.level,
        "current_ua": args.current_ua,
        "width_us": args.width_us,
        "polarity": args.polarity,
        "returns": args.returns,
        "max_rate_hz": args.max_rate,
        "allow_slower": args.allow_slower,
        "repeat": args.repeat,
    }
    asked = {key: value for key, value in given.items() if value is not None}
    return cast("PatternOptions", asked)


def _advised(args: argparse.Namespace, refusal: Refused) -> Refused:
    """With the options that help, and where the figures of a modelled processor are from."""
    reason = refusal.reason
    if refusal.code == "too_fast":
        lower = "" if refusal.achievable_hz is None else f" {int(refusal.achievable_hz)}"
        reason += f"; play it with --max-rate{lower} or --allow-slower"
    if args.machine is not None and refusal.bound_by == "processor":
        reason += (
            f" (the processor of the modelled {args.machine} is reckoned from what computing takes"
            " on this computer: too much, while it is busy with something else)"
        )
    return Refused(refusal.code, reason, refusal.electrode, refusal.achievable_hz, refusal.bound_by)


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
            print(shown(sentence), file=sys.stderr)


# --- which daemon ------------------------------------------------------------------------------


def _check_combinations(args: argparse.Namespace) -> None:
    """Options that do not go together end with status 2."""
    fakes = args.array, args.machine, args.trace, args.timeout_factor
    if args.board is None and any(fakes):
        args.misused(
            "--array, --machine, --trace and --timeout-factor go with --board fake: a running"
            " daemon has its own"
        )
    if args.board is not None and args.host is not None:
        args.misused("--board fake is played here, --host is another computer: one of the two")
    if args.board is not None and args.folder is not None:
        args.misused(
            "--board fake has a daemon of its own, --folder is a running one: one of the two"
        )
    if (args.current_ua is None) != (args.width_us is None):
        args.misused("--current-ua and --width-us go together: a current needs a width")
    if args.current_ua is not None and (args.level or args.calibration):
        args.misused("--level and --calibration, or --current-ua and --width-us: one of the two")


def _address(
    args: argparse.Namespace, pattern: Pattern
) -> contextlib.AbstractContextManager[str | None]:
    """The control address of the fake's own daemon; None for the running one."""
    if args.board is None:
        return contextlib.nullcontext(options.address_named(args))
    check_fake()
    lent = [calibration_of(args.name, name) for name in args.calibration or ()]
    array = args.array or next((array_of(one) for one in lent if one is not None), None)
    loaded = fake_config(args.board.board, array, pattern.electrodes)
    return _private(args, loaded, lent)


@contextlib.contextmanager
def _private(
    args: argparse.Namespace, loaded: LoadedConfig, lent: Sequence[Calibration | None]
) -> Iterator[str]:
    own = private_daemon("play", loaded, args.trace, args.machine, args.timeout_factor)
    with own as address:
        for name, one in zip(args.calibration or (), lent, strict=True):
            lend(address, args.name, name, one)
        yield address


def _display(args: argparse.Namespace, address: str | None) -> Display:
    return Display(
        args.name,
        host=args.host,
        address=address,
        client=f"etd play {args.file.name}",
        calibration=args.calibration,
        max_current_ua=args.current_ua,
        width_us=args.width_us,
        timeout_s=2.0 if args.board is None else answer_within_s(args.timeout_factor),
    )


def _arm(args: argparse.Namespace, display: Display, tell: Callable[[str], None]) -> None:
    """Arm a fake board at once; for a real board wait for the operator, keeping the lease."""
    if args.board is not None or args.arm:
        display.arm(ARM_WITHIN_S)
        return
    if is_armed(display):
        return
    tell("waiting for the operator: `etd arm`")
    with display.telemetry("state") as reports:
        while not is_armed(display):
            display.keep()
            reports.receive(_LOOK_S)


# --- the answer --------------------------------------------------------------------------------


def _answer(args: argparse.Namespace, backend: str, played: Played, teller: _Teller) -> None:
    if args.json:
        answer = {
            "ok": True,
            "file": str(args.file),
            "backend": backend,
            "frames": played.frames,
            "clamped_frames": played.clamped_frames,
            "clamped": list(played.clamped),
            "not_fired": played.not_fired,
            "slowed_to_hz": played.slowed_to_hz,
            "soft_start_s": round(played.soft_start_s, 3),
            "played_s": round(played.played_s, 3),
            "told": teller.told,
        }
        print(msgspec.json.encode(answer).decode())
        return
    for clamp in played.clamped:
        print(
            f"clamped: electrode {clamp.electrode} got {clamp.allowed_ua} uA instead of"
            f" {clamp.wanted_ua} uA ({shown(clamp.reason)} of electrode {clamp.limited_by})"
        )
    print(_last_line(args, backend, played))


#: What a count of the summary counts.
_NOT_FIRED = {
    "ledger": "pulses that the ledger did not allow",
    "overrun": "scans that started late",
    "processor": "pauses for the processor",
    "resolution": "pulses below one step of the source",
}


def _last_line(args: argparse.Namespace, backend: str, played: Played) -> str:
    slowed = "" if played.slowed_to_hz is None else f", slowed to {played.slowed_to_hz:.1f} Hz"
    shortfalls = ", ".join(
        f"{count} {_NOT_FIRED.get(reason, reason)}" for reason, count in played.not_fired.items()
    )
    return (
        f"{shown(args.file.name)}: {played.frames} frames in {played.played_s:.1f} s on {backend},"
        f" after {played.soft_start_s:.1f} s of soft start; {played.clamped_frames} frames"
        " clamped"
        f"{slowed}; not fired: {shortfalls or 'nothing'}"
    )


def _names(text: str) -> tuple[str, ...]:
    return tuple(name.strip() for name in text.split(","))


def _level(text: str) -> float:
    with contextlib.suppress(ValueError):
        if 0 < float(text) <= 1:
            return float(text)
    raise argparse.ArgumentTypeError(f"{text!r} is not above 0 and at most 1")
