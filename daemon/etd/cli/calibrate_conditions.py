"""The conditions of a calibration, from the command line and the defaults.

Owns: where each condition comes from (command line, else baseline, else body site), and errors that
name the option. Must not know: the course of a calibration.
"""

from __future__ import annotations

import argparse

import msgspec

from etd.calibrate.conditions import Conditions, identity
from etd.calibrate.equal_strength import default_reference
from etd.protocol.calibration import Calibration
from etd.protocol.errors import FileError
from etd.protocol.facts import ArrayFacts
from etd.protocol.messages import HelloReply
from etd_hal.tomlfile import convert

COMMAND_LINE = "the command line"
#: Conditions with another name on the command line.
_OPTIONS = {
    "participant": "CODE",
    "cap_ua": "--max-current-ua",
    "width_us": "--width-us",
    "rate_hz": "--rate-hz",
    "pulses": "--pulses",
}


def requested_conditions(
    args: argparse.Namespace, facts: HelloReply, base: Calibration | None
) -> Conditions:
    """`args`: of `etd calibrate`. Raises: FileError, naming the option."""
    _check_electrodes(args, facts.array)
    returns = args.returns or (base.returns if base else "all")
    _check_returns(args, facts)
    most_ua = args.max_current_ua
    if most_ua is None and base is not None:
        most_ua = max(limits.cap_ua for limits in base.electrode)
    width_us = args.width_us
    if width_us is None:
        width_us = base.width_us if base else facts.default_width_us
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
        "reference": _reference(args, facts.array, base),
    }
    try:
        return convert(asked, Conditions, COMMAND_LINE)
    except FileError as error:
        key = _OPTIONS.get(error.key, error.key)
        raise FileError(error.file, key, error.value, error.allowed) from error


def _check_electrodes(args: argparse.Namespace, array: ArrayFacts) -> None:
    """Raises: FileError, for an electrode that the array does not have, and where none is left."""
    named = {"--leave-out": args.leave_out, "--reference": (args.reference,)}
    for option, electrodes in named.items():
        for electrode in electrodes:
            if electrode is not None and not 0 <= electrode < array.electrodes:
                raise FileError(
                    COMMAND_LINE,
                    option,
                    f"there is no electrode {electrode}",
                    f"0 to {array.electrodes - 1}",
                )
    if set(args.leave_out) >= set(range(array.electrodes)):
        raise FileError(
            COMMAND_LINE,
            "--leave-out",
            f"all {array.electrodes} electrodes of the array are left out",
            "leave one to be asked, at least",
        )
    if args.reference in args.leave_out:
        raise FileError(
            COMMAND_LINE,
            "--leave-out",
            f"electrode {args.reference} is the --reference, which is presented in every"
            " comparison",
            "name another --reference, or none",
        )


def _check_returns(args: argparse.Namespace, facts: HelloReply) -> None:
    """Raises: FileError, before the operator is asked to arm a board that cannot do it."""
    if args.returns not in (None, "all") and "open" not in facts.board.states:
        raise FileError(
            COMMAND_LINE,
            "--returns",
            f"{facts.board.name} connects every electrode to the source or to ground",
            'only "all" is possible: omit the option (other returns need a board with relays)',
        )


def _reference(args: argparse.Namespace, array: ArrayFacts, base: Calibration | None) -> int | None:
    if args.method != "equalize" or args.reference is not None:
        return args.reference if args.method == "equalize" else None
    return default_reference(base, array.x_mm, array.y_mm, args.leave_out)
