"""`etd disarm`: switch the supply off, for the holder of the lease.

Owns: the refusal without a lease, and its advice. Must not know: other requests of the protocol.
"""

from __future__ import annotations

import argparse
import json

import zmq

from etd.cli import options
from etd.client import wire
from etd.client.session import Ask, Session
from etd.protocol.errors import DaemonGone, Refused

HELP = "switch the supply off; the lease stays with its holder"
EPILOG = """
examples:
  etd disarm --lease TOKEN    for the program that holds the lease (TOKEN: the reply to its `open`)
  etd stop                    for all others: needs no lease; HALTED until `etd clear`
"""
_TIMEOUT_MS = 2_000


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_name(parser)
    options.add_json(parser)
    parser.add_argument("--lease", metavar="TOKEN", help="the lease to disarm")


def run(args: argparse.Namespace) -> int:
    """Raises: Refused (`no_lease` without one, `other_lease` for a wrong one), DaemonGone."""
    if args.lease is None:
        raise Refused(
            "no_lease",
            "only the holder of the lease may disarm: give its token with --lease TOKEN, or use"
            " `etd stop`, which needs no lease",
        )
    _disarm(wire.resolve(args.name, None), args.lease)
    print(json.dumps({"ok": True}) if args.json else "disarmed: the supply is off")
    return 0


def _disarm(address: str, lease: str) -> None:
    session = Session("etd disarm")
    session.lease = lease
    wire.check_there(address)
    with zmq.Context() as context, context.socket(zmq.DEALER) as control:
        wire.configure(control, address)
        ask = next(session.disarm())
        control.send(ask.data)
        _settle(session, ask, control, address)


def _settle(session: Session, ask: Ask, control: zmq.Socket[bytes], address: str) -> None:
    while control.poll(_TIMEOUT_MS):
        if session.settle(ask, control.recv_multipart()[-1]) is not None:
            return
    raise DaemonGone(address, f"no answer to disarm within {_TIMEOUT_MS / 1000:g} s")
