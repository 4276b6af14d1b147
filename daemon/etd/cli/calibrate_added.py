"""What `etd calibrate` adds to a calibration that there is.

Owns: by which options, to which one, and what is said where there is none. Must not know: how any
of it is measured, daemons.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import contextmanager

from etd.protocol.errors import Refused

#: By the option, with what it adds.
_ADDS = {"--fit": "k", "--adaptation": "what use does"}


def added_by(args: argparse.Namespace) -> str | None:
    """The option that adds something; None where a calibration is made."""
    if args.fit:
        return "--fit"
    return "--adaptation" if args.adaptation else None


def name_baseline(args: argparse.Namespace, option: str) -> None:
    """Of the calibration that something is added to: the person's, unless another one is named."""
    if args.skin_celsius is not None or args.ask_sensation:
        args.misused(
            f"{option} adds {_ADDS[option]} to a calibration and nothing else: omit --skin-celsius"
            " and --ask-sensation, which a calibration takes"
        )
    if args.baseline is None:
        args.baseline = args.which or args.participant
    elif args.baseline != args.participant and args.which is None:
        args.misused(
            f"{option} adds {_ADDS[option]} to {args.baseline} and stores it as"
            f" {args.participant}: say with --as what it is stored as"
        )


def otherwise(option: str) -> str:
    """What to do where conditions are not those of that calibration."""
    return (
        f"{option} adds {_ADDS[option]} to a calibration of this person, array and conditions:"
        " calibrate first, or name that one (CODE, --baseline) and leave its conditions as they are"
    )


@contextmanager
def calibrated_first(option: str) -> Iterator[None]:
    """Raises: Refused, where there is no calibration, with what to do first; and others."""
    try:
        yield
    except Refused as error:
        if error.code != "not_found":
            raise
        raise Refused(
            error.code,
            f"{error.reason}; {option} adds {_ADDS[option]} to a calibration: calibrate first (the"
            f" same command without {option}), or name another one with --baseline",
        ) from error
