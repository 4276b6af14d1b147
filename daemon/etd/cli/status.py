"""`etd status`: the daemon's state, its missing guards, its counters.

Owns: the printed answer. Must not know: what the state depends on.
"""

from __future__ import annotations

import argparse

import msgspec

from etd.cli import options
from etd.cli.running import display_of
from etd.cli.taken import said_of_taken
from etd.client import Display
from etd.protocol.errors import Refused
from etd.protocol.messages import HelloReply, StateReport
from etd.protocol.text import shown

HELP = "show the daemon's state, board, missing guards and counters"
EPILOG = """
example:
  etd status          state, holder of the lease, board, absent guards, counters
  etd status --json   the same as one JSON object: {"ok", "status", "facts"}
"""

#: A board's clock that is less behind than this is as good as the machine's.
_SHOWN_LAG_US = 1_000

add_arguments = options.add_daemon_and_json


def run(args: argparse.Namespace) -> int:
    """Exit status 3: no daemon answers, or no engine does. Raises: DaemonGone."""
    with display_of(args, "etd status") as display:
        report = display.status()
        facts = _facts(display)
    if args.json:
        print(msgspec.json.encode({"ok": True, "status": report, "facts": facts}).decode())
    else:
        name = args.name if facts is None else facts.name
        print("\n".join(lines_of(name, report, facts)))
    return 0 if report.engine == "there" else 3


def _facts(display: Display) -> HelloReply | None:
    try:
        return display.facts
    except Refused:
        return None


def lines_of(name: str, report: StateReport, facts: HelloReply | None) -> list[str]:
    """The answer as it is printed; without facts while the engine is gone."""
    rows = [("daemon", f"{name}: {_state(name, report)}")]
    if facts is not None:
        rows += _rows_of_facts(facts)
    rows += [
        ("lease", _lease(report)),
        ("session", _session(report)),
        ("ceiling", f"{report.ceiling_ua} uA"),
        ("supply", _supply(report)),
        ("absent guards", ", ".join(report.absent_guards) or "none"),
        *(("not granted", sentence) for sentence in report.not_granted),
        *(("machine", sentence) for sentence in report.machine),
        ("busy", f"{report.busy_percent:.0f} %; {report.busy_at_most}".removesuffix("; ")),
    ]
    if report.timeout_factor != 1:
        rows.append(("timeouts", f"{report.timeout_factor} times as long as on a real board"))
    if report.clock_lag_us >= _SHOWN_LAG_US:
        lag_ms = report.clock_lag_us // 1_000
        rows.append(("clock", f"{lag_ms} ms behind the machine's (a fake board on a busy machine)"))
    if report.arming_refused:
        rows.append(("arm is refused", report.arming_refused))
    if report.last_disarm:
        rows.append(("last silence", report.last_disarm))
    if report.counters:
        counts = ", ".join(f"{key} {count}" for key, count in sorted(report.counters.items()))
        rows.append(("counted", counts))
    return [f"{label:14} {shown(text)}" for label, text in rows]


def _state(name: str, report: StateReport) -> str:
    if report.engine == "gone":
        return (
            "there is no engine, or it is still starting, so nothing is driven (of a service:"
            f" systemctl status etd-engine@{name})"
        )
    if report.engine == "silent":
        return (
            f"the engine has reported nothing for seconds, it was {report.state}: it hangs, and"
            f" fires nothing; end it (systemctl restart etd-engine@{name}), then arm anew"
        )
    if report.halt is not None:
        halt = report.halt
        return (
            f"HALTED by {halt.cause} ({halt.source}: {halt.detail}); check the cause, then"
            " `etd clear`"
        )
    return report.state


def _lease(report: StateReport) -> str:
    if not report.holder:
        return "free"
    return f"held by {report.holder!r}, with {said_of_taken(report.calibrations)}"


def _session(report: StateReport) -> str:
    session = report.session
    if session is None:
        return "none (it begins when the board is armed)"
    whose = session.participant or "a lease without a calibration"
    if session.ends_in_s is None:
        return whose
    return f"{whose}; ends in {session.ends_in_s / 60:.0f} min unless it is armed again"


def _rows_of_facts(facts: HelloReply) -> list[tuple[str, str]]:
    board, array = facts.board, facts.array
    maxima = facts.maxima
    return [
        ("board", f"{board.name} on {board.machine} (backend: {board.backend})"),
        ("code", _code(board.code)),
        ("array", f"{array.name}, {array.electrodes} electrodes, {facts.body_site}"),
        (
            "maxima",
            f"{maxima.current_ua} uA ({maxima.uncalibrated_current_ua} uA uncalibrated),"
            f" {maxima.width_us} us, {maxima.charge_nc:g} nC a pulse, {maxima.rate_hz:g} Hz",
        ),
        ("calibrations", ", ".join(facts.calibrations) or "none"),
    ]


def _code(code: str) -> str:
    if code == "compiled":
        return code
    return f"{code}: a pulse takes three times the processor's time (docs/install.md)"


def _supply(report: StateReport) -> str:
    if "hv_enable" in report.absent_guards:
        return "on while the board has power (it has no hv_enable)"
    rail = "" if report.rail_v is None else f", rail {report.rail_v:.0f} V"
    return f"{'on' if report.supply_on else 'off'}{rail}"
