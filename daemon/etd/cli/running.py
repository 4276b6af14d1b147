"""The running daemon that the options of a verb name, as a client of it.

Owns: how `--name`, `--host` and `--folder` become a display. Must not know: verbs.
"""

from __future__ import annotations

import argparse

from etd.cli import options
from etd.client import Display


def display_of(
    args: argparse.Namespace,
    client: str,
    max_current_ua: int | None = None,
    width_us: int | None = None,
) -> Display:
    """Of the options that `options.add_daemon` adds. Raises: DaemonGone, Refused, FileError."""
    return Display(
        args.name,
        host=args.host,
        address=options.address_named(args),
        client=client,
        max_current_ua=max_current_ua,
        width_us=width_us,
    )
