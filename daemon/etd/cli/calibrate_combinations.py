"""Which options of `etd calibrate` exclude each other, and which need another one.

Owns: these rules, and the sentences about them. Must not know: what any of them does, daemons.
"""

from __future__ import annotations

import argparse

from etd.calibrate.adaptation import USE_S
from etd.cli.calibrate_added import name_baseline


def check_combinations(args: argparse.Namespace) -> None:
    if args.fit and args.adaptation:
        args.misused("--fit and --adaptation are measured one after the other: one of the two")
    if args.fit:
        _check_fit(args)
    elif args.electrodes:
        args.misused("--electrodes goes with --fit: --leave-out omits electrodes")
    if args.adaptation:
        _check_adaptation(args)
    elif args.use_s is not None:
        args.misused("--use-s goes with --adaptation")
    if args.forget_too_strong and not args.restart:
        args.misused("--forget-too-strong goes with --restart")
    if args.reference is not None and args.method != "equalize":
        args.misused("--reference goes with --method equalize")
    if args.method == "equalize":
        if args.baseline is None:
            args.misused("--method equalize needs --baseline: it uses its thresholds and caps")
        if args.max_current_ua is not None:
            args.misused("--method equalize uses the caps of --baseline: omit --max-current-ua")
    elif args.max_current_ua is None and not args.adaptation:
        args.misused("--max-current-ua is required: without a limit nothing is stimulated")
    if args.board is not None and args.host is not None:
        args.misused("--board fake is calibrated here, --host is another computer: one of the two")
    if args.board is not None and args.folder is not None:
        args.misused(
            "--board fake has a daemon of its own, --folder is a running one: one of the two"
        )
    fakes = args.array, args.timeout_factor, args.finger, args.answers == "simulated"
    if args.board is None and any(fakes):
        args.misused(
            "--array, --finger, --timeout-factor and --answers simulated go with --board fake"
        )


def _check_fit(args: argparse.Namespace) -> None:
    """It asks for the thresholds of one calibration again, which it adds k to."""
    if args.leave_out or args.reference is not None:
        args.misused(
            "--fit asks a few electrodes: omit --leave-out and --reference, and name them"
            " with --electrodes"
        )
    if args.method == "equalize":
        args.misused("--fit asks for thresholds: choose another --method")
    name_baseline(args, "--fit")


def _check_adaptation(args: argparse.Namespace) -> None:
    """It shows what a calibration has, and asks for no threshold."""
    if args.leave_out or args.reference is not None or args.method != "staircase":
        args.misused(
            "--adaptation shows all electrodes, and asks for no threshold: omit --leave-out,"
            " --reference and --method"
        )
    if args.max_current_ua is not None:
        args.misused("--adaptation uses the caps of the calibration: omit --max-current-ua")
    if args.restart:
        args.misused("--adaptation keeps nothing on the way, and begins anew: omit --restart")
    if args.use_s is None:
        args.use_s = USE_S
    name_baseline(args, "--adaptation")
