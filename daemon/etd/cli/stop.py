"""`etd stop`: stop stimulation at once and latch it, in all daemons of this machine or in one.

Owns: finding the daemons, trying each even if others fail, and the advice where a daemon does not
answer. Must not know: how a daemon stops.
"""

from __future__ import annotations

import argparse
import re
import shlex
import sys
from collections import Counter
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path

import msgspec

from etd.cli import NOT_THERE, options, status_of
from etd.client.stopping import stop_at
from etd.client.ways import host_asked_for
from etd.files.paths import (
    CONTROL,
    DEFAULT_NAME,
    SYSTEM_RUNTIME,
    OthersDaemons,
    RunningDaemon,
    address_of,
    control_address,
    find_daemons,
    find_daemons_of_others,
    why_unreachable,
)
from etd.protocol.errors import DaemonGone, EtdError
from etd.protocol.text import NAME_PATTERN, shown

HELP = "stop stimulation at once; it stays stopped until `etd clear`"
EPILOG = """
examples:
  etd stop               all daemons of the system and yours; with sudo, those of every user
  etd stop --name left   only this daemon
  etd stop --folder DIR  one that was started with `etd run --folder DIR`: no other stop finds it
  etd stop --host pi@display.local    the daemon on another computer (main, or --name)

No lease and no operate rights are needed, and other requests do not delay it. It does not replace
a hardware stop (docs/hardware.md).
"""
_TIMEOUT_S = 1.0
#: Each takes some file descriptors, of which a process has few.
_AT_ONCE = 16
_ELSEWHERE = (
    "is the daemon running? one that was started with `etd run --folder DIR` is found only by `etd"
    " stop --folder DIR`"
)
_LEFT_OVER = "no daemon listens any more"


class Stopped(msgspec.Struct, frozen=True, kw_only=True):
    """The result for a daemon; `error` None: it is silent and HALTED. `name` None: `folder` was
    named, which does not say it.
    """

    name: str | None
    address: str
    error: str | None = None
    is_there: bool = True
    folder: str | None = None

    @property
    def called(self) -> str:
        return self.name or self.folder or self.address


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--name", type=options.daemon_name, help="only this daemon (default: all)")
    options.add_host(parser)
    options.add_folder(parser)
    options.add_json(parser)


def run(args: argparse.Namespace) -> int:
    """The system's daemons and this user's first: what others have made cannot delay them.

    Exit status 3: a daemon did not answer or was not asked (or there is none). 1: one refused.
    Raises: DaemonGone if there is none.
    """
    there = options.address_named(args)
    host = args.host if there is not None else host_asked_for(args.host)
    others = OthersDaemons()
    is_all = host is None and there is None and args.name is None
    if host is not None:
        daemons = [RunningDaemon(args.name or args.folder or DEFAULT_NAME, host)]
    elif there is not None:
        daemons = [RunningDaemon(args.name or args.folder, there)]
    elif args.name is None:
        daemons = _all_own()
    else:
        daemons = [RunningDaemon(args.name, control_address(args.name))]
    answers = _stop_each(host, there, daemons)
    if args.folder is not None:
        answers = [_of_folder(stopped, args.name, args.folder) for stopped in answers]
    if is_all:
        others = find_daemons_of_others()
        answers += _stop_each(None, None, others.daemons)
    if not answers and not others.not_asked:
        raise DaemonGone("any socket that this user may reach", "no daemon answers", _ELSEWHERE)
    all_good = not others.not_asked and all(stopped.error is None for stopped in answers)
    if args.json:
        said = {"ok": all_good, "daemons": answers, "not_asked": others.not_asked}
        print(msgspec.json.encode(said).decode())
    else:
        for line in lines_of(answers):
            print(line)
        for sentence in others.not_asked:
            print(f"NOT STOPPED: {shown(sentence)}", file=sys.stderr)
    if all_good:
        return 0
    is_told = not others.not_asked and all(stopped.is_there for stopped in answers)
    return 1 if is_told else 3


def _stop_each(
    host: str | None, there: str | None, daemons: Sequence[RunningDaemon]
) -> list[Stopped]:
    with ThreadPoolExecutor(max_workers=_AT_ONCE) as pool:
        return list(pool.map(partial(_stop, host, there), daemons))


def _all_own() -> list[RunningDaemon]:
    """The system's and this user's that answer, or that this user may not reach."""
    found = find_daemons()
    addresses = {daemon.address for daemon in found}
    for control in sorted(SYSTEM_RUNTIME.glob(f"*/{CONTROL}")):
        address = address_of(control.parent)
        why = why_unreachable(control)
        if address not in addresses and why is not None and not why.startswith(_LEFT_OVER):
            found.append(RunningDaemon(control.parent.name, address))
    return found


def _stop(host: str | None, there: str | None, daemon: RunningDaemon) -> Stopped:
    """`host`: where it is, with its address `there` if its name does not say that; None: here."""
    address = daemon.address if host is None else there
    try:
        stop_at(daemon.name, host=host, address=address, client="etd stop", timeout_s=_TIMEOUT_S)
    except EtdError as error:
        is_there = status_of(error) != NOT_THERE
        return Stopped(
            name=daemon.name, address=daemon.address, error=str(error), is_there=is_there
        )
    return Stopped(name=daemon.name, address=daemon.address)


def _of_folder(stopped: Stopped, name: str | None, folder: str) -> Stopped:
    return msgspec.structs.replace(stopped, name=name, folder=folder)


def lines_of(answers: list[Stopped]) -> list[str]:
    """By name; by address too, where two users have daemons of one name."""
    names = Counter(stopped.called for stopped in answers)
    return [
        _line(
            stopped,
            shown(
                stopped.called
                if names[stopped.called] == 1
                else f"{stopped.called} ({stopped.address})"
            ),
        )
        for stopped in answers
    ]


def _line(stopped: Stopped, called: str) -> str:
    if stopped.error is None:
        return f"{called}: silent, HALTED until `etd clear`"
    then, name = "end\n  the `etd run` that runs it.", stopped.name
    if stopped.folder is not None:
        state = shown(shlex.quote(str(Path(stopped.folder) / "state")))
        then = (
            "end\n  the `etd run` that runs it and, on hardware, run `etd safe --config FILE"
            f" --state {state}`\n  with its FILE and its --state, if it was started with one."
        )
    elif name is not None and re.search(NAME_PATTERN, name):
        then = f"run\n  `systemctl stop etd-engine@{name}` and `etd safe --name {name}`."
    return (
        f"{called}: NOT STOPPED: {shown(stopped.error)}\n"
        "  If its gateway has ended, its engine stops within 250 ms by itself. Other daemons go\n"
        "  on: `etd stop` alone stops all but those with a --folder of their own.\n"
        f"  If anything is still felt: press the hardware stop or unplug the supply, then {then}"
    )
