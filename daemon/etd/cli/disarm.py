"""`etd disarm`: switch the supply off, for the holder of the lease.

Owns: the refusal without a lease, and its advice. Must not know: other requests of the protocol.
"""

from __future__ import annotations

import argparse
import json

import zmq

from etd.cli import options
from etd.client.exchange import Exchange
from etd.client.session import Session
from etd.client.way import Way
from etd.client.ways import way_to
from etd.protocol.errors import Refused

HELP = "switch the supply off; the lease stays with its holder"
EPILOG = """
examples:
  etd disarm --lease TOKEN    for the program that holds the lease (TOKEN: the reply to its `open`)
  etd stop                    for all others: needs no lease; HALTED until `etd clear`
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_daemon(parser)
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
    _disarm(way_to(args.name, args.host, options.address_named(args)), args.lease)
    print(json.dumps({"ok": True}) if args.json else "disarmed: the supply is off")
    return 0


def _disarm(way: Way, lease: str) -> None:
    session = Session("etd disarm")
    session.lease = lease
    try:
        way.check_there()
        with zmq.Context() as context:
            exchange = Exchange(context, way, session)
            try:
                exchange.run(session.disarm())
            finally:
                exchange.hang_up()
    finally:
        way.close()
