"""`etd lsl`: what is fired, as streams of the Lab Streaming Layer.

Owns: the outlets with their descriptions, and how long they are offered. Must not know: what
becomes a sample (`etd.apps.lsl_streams`).
"""

from __future__ import annotations

import argparse
import contextlib
import json
from collections.abc import Sequence
from typing import Any

from etd.apps.lsl_streams import Streams
from etd.cli import extras, options
from etd.cli.running import display_of
from etd.client import Display, clock
from etd.client.telemetry import Telemetry
from etd.protocol.errors import HELD_UP, DaemonGone
from etd.protocol.messages import HelloReply

HELP = "offer frames, marks and contact as streams of the Lab Streaming Layer"
EPILOG = """
examples:
  etd lsl                            until Ctrl-C, beside any program
  etd lsl --host pi@display.local    the streams on this computer, the daemon on the Pi
  etd lsl --json --seconds 600       one JSON object with the streams' names, then ten minutes

Two streams. etd-events (type Markers, two strings): `frame/TAG` at its first pulse (`renewed/TAG`
where it goes on with the frame before), `mark/TAG`, `halt/SOURCE`, `state/STATE`; the second
string has seq and times in JSON. etd-contact (type Contact, a number for each electrode): 1
touched, 0 open, NaN not known.
Time stamps are the engine's own times of pulses. docs/lsl.md explains them, and where liblsl comes
from on a Raspberry Pi.

The command only reads telemetry: it needs no lease and changes nothing.
"""
_TURN_S = 0.05
#: `state` comes each second: after this long without it the daemon is gone.
_SILENT_S = 5.0
#: The daemon's clock is compared with the one here so often, and first so many times.
_COMPARED_S = 1.0
_FIRST_COMPARISONS = 10


class LslOutlet:
    """A stream that others on the network find and read."""

    def __init__(self, info: Any) -> None:
        import pylsl

        self._outlet = pylsl.StreamOutlet(info)

    def push(self, sample: Sequence[str | float], stamp_s: float) -> None:
        """See `lsl_streams.Outlet`."""
        self._outlet.push_sample(list(sample), stamp_s)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_daemon(parser)
    options.add_seconds(parser)
    options.add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Ends with `--seconds` or Ctrl-C, status 0. Raises: PackageMissing, LibraryMissing,
    DaemonGone, Refused (`engine_gone`).
    """
    extras.check_lsl()
    end_ns = None if args.seconds is None else clock.now_ns() + int(args.seconds * 1e9)
    with (
        contextlib.suppress(KeyboardInterrupt),
        display_of(args, "etd lsl") as display,
        display.telemetry("state", "scan", "contact", "mark", "halt") as reports,
    ):
        for _ in range(_FIRST_COMPARISONS):
            display.status()
        events, contact = infos(display.facts, display.daemon_clock.uncertainty_ns)
        streams = Streams(display.daemon_clock, LslOutlet(events), LslOutlet(contact))
        _say(args, display, [events.name(), contact.name()])
        _stream(display, reports, streams, end_ns)
        if not args.json:
            print(f"{streams.events} events")
    return 0


def _say(args: argparse.Namespace, display: Display, names: list[str]) -> None:
    within_us = display.daemon_clock.uncertainty_ns / 1_000
    if args.json:
        print(json.dumps({"ok": True, "streams": names, "within_us": within_us}), flush=True)
    else:
        print(f"streams {' and '.join(names)}; stamps within {within_us:.0f} us", flush=True)


def _stream(display: Display, reports: Telemetry, streams: Streams, end_ns: int | None) -> None:
    """Raises: DaemonGone, when no report comes."""
    heard_ns = compared_ns = clock.now_ns()
    while end_ns is None or clock.now_ns() < end_ns:
        item = reports.receive(_TURN_S)
        now_ns = clock.now_ns()
        if item is not None:
            heard_ns = now_ns
            streams.hear(item[1])
        elif now_ns - heard_ns > _SILENT_S * 1e9:
            raise DaemonGone(display.address, f"no telemetry for {_SILENT_S:g} s", HELD_UP)
        if now_ns - compared_ns > _COMPARED_S * 1e9:
            compared_ns = now_ns
            display.status()


def infos(facts: HelloReply, within_ns: int) -> tuple[Any, Any]:
    """What the streams say of themselves: events, and contact."""
    import pylsl

    source = f"etd-{facts.name}-{facts.board.name}"
    events = pylsl.StreamInfo(
        "etd-events",
        "Markers",
        2,
        pylsl.IRREGULAR_RATE,
        pylsl.cf_string,
        f"{source}-events",
    )
    contact = pylsl.StreamInfo(
        "etd-contact",
        "Contact",
        facts.array.electrodes,
        pylsl.IRREGULAR_RATE,
        pylsl.cf_float32,
        f"{source}-contact",
    )
    labels = (
        ["event", "facts"],
        [f"electrode {number}" for number in range(contact.channel_count())],
    )
    for info, channels in zip((events, contact), labels, strict=True):
        about = info.desc()
        about.append_child_value("manufacturer", "etd")
        about.append_child_value("version", facts.version)
        about.append_child_value("daemon", facts.name)
        about.append_child_value("board", facts.board.name)
        about.append_child_value("array", facts.array.name)
        stamps = about.append_child("stamps")
        stamps.append_child_value("clock", "CLOCK_MONOTONIC of the computer of this stream")
        stamps.append_child_value("within_ns", str(within_ns))
        listed = about.append_child("channels")
        for label in channels:
            listed.append_child("channel").append_child_value("label", label)
    return events, contact
