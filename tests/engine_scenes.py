"""What tests of the engine ask of a rig: what was felt, what the lines did, other configurations.

Owns: questions to the trace, answered by the decoder of the tests; changed configurations.
Must not know: what a test expects.
"""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import msgspec

from engine_rig import EngineRig
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.exponent import FittedExponent
from etd.protocol.link import Answer, LeaseEnded
from etd.protocol.messages import Halt, Scan, Shown, StateReport
from etd.protocol.outcome import Clamp, Shortfall
from etd_hal.boardfile import Guards
from trace_decoder import Phase

MS = 1_000_000


def phases(rig: EngineRig, since_ns: int = 0) -> list[Phase]:
    """What flowed, decoded from the SPI and GPIO events."""
    return [phase for phase in rig.followed.phases() if phase.from_ns >= since_ns]


def felt_ua(rig: EngineRig, since_ns: int = 0) -> dict[int, float]:
    """The largest current of each electrode."""
    found: dict[int, float] = {}
    for phase in phases(rig, since_ns):
        assert phase.electrode is not None
        found[phase.electrode] = max(found.get(phase.electrode, 0.0), phase.current_ua)
    return found


def moves(rig: EngineRig, name: str, since_ns: int = 0) -> list[tuple[int, int]]:
    """(time, level) of one line, by its name in the trace's header."""
    lines = rig.engine.components.loaded.board.used_lines()
    return [
        (entry["t_ns"], entry["value"])
        for entry in rig.records
        if entry["bus"] == "gpio" and entry["line"] == lines[name] and entry["t_ns"] >= since_ns
    ]


def longest_gap_ns(rig: EngineRig, from_ns: int, to_ns: int) -> int:
    """Between two edges of the heartbeat, or one and the beginning or the end."""
    edges_ns = [t_ns for t_ns, _ in moves(rig, "HEARTBEAT", from_ns) if t_ns < to_ns]
    return max(after - before for before, after in pairwise([from_ns, *edges_ns, to_ns]))


def dac_codes(rig: EngineRig, since_ns: int = 0) -> list[tuple[int, int]]:
    """(time, code) of each word sent to the DAC."""
    return [
        (entry["t_ns"], int(entry["tx"], 16) >> 2)
        for entry in rig.records
        if entry.get("event") == "transfer" and entry["tx"] and entry["t_ns"] >= since_ns
    ]


def only(count: int, **wanted_ua: int) -> tuple[int, ...]:
    """0 everywhere but at the named electrodes: only(16, e3=1000)."""
    wanted = {int(name[1:]): value for name, value in wanted_ua.items()}
    return tuple(wanted.get(electrode, 0) for electrode in range(count))


# --- reports --------------------------------------------------------------------------------------


def scans(rig: EngineRig) -> list[Scan]:
    return [report.scan for report in rig.reports if report.scan is not None]


def states(rig: EngineRig) -> list[StateReport]:
    return [report.state for report in rig.reports if report.state is not None]


def halts(rig: EngineRig) -> list[Halt]:
    return [report.halt for report in rig.reports if report.halt is not None]


def shown(rig: EngineRig) -> list[Shown]:
    return [shown for scan in scans(rig) for shown in scan.shown]


def clamps(rig: EngineRig) -> list[Clamp]:
    return [clamp for scan in scans(rig) for clamp in scan.clamped]


def shortfalls(rig: EngineRig) -> list[Shortfall]:
    return [shortfall for scan in scans(rig) for shortfall in scan.not_fired]


def ended_leases(rig: EngineRig) -> list[LeaseEnded]:
    return [message for message in rig.others if isinstance(message, LeaseEnded)]


def first_fault(rig: EngineRig) -> str:
    """Who, of the first halt; there must have been one."""
    assert rig.state == "HALTED"
    assert rig.engine.supervisor.lease is None
    halt = rig.engine.supervisor.states.halt
    assert halt is not None
    assert halts(rig)[0] == halt
    assert halt.cause == "fault"
    return halt.source


# --- ways into it ---------------------------------------------------------------------------------


def armed(rig: EngineRig, max_current_ua: int = 3_000) -> EngineRig:
    rig.open(max_current_ua)
    rig.arm()
    return rig


def balancing(loaded: LoadedConfig, net_charge_nc: int) -> LoadedConfig:
    """At a site that has both phases fired of what would leave more than this."""
    maxima = msgspec.structs.replace(loaded.body_site.maxima, net_charge_nc=net_charge_nc)
    site = msgspec.structs.replace(loaded.body_site, balance="biphasic", maxima=maxima)
    return dataclasses.replace(loaded, body_site=site)


def opened_to(rig: EngineRig, current_ua: int) -> None:
    """As if so much had been fired: how the opening rises by itself is tested at the wire, and
    what was fired for it would be in the ledgers and the maps of everything else.
    """
    soft_start, fired_ns = rig.engine.components.soft_start, rig.clock.now_ns() - 100 * MS
    soft_start.due(fired_ns)
    soft_start.fired(0, current_ua, current_ua, fired_ns)


def begun(rig: EngineRig, width_us: int = 200, k: float = 0.7) -> EngineRig:
    """Armed, with a client's limits; where the site has `power_law`, for a person with this k."""
    loaded = rig.engine.components.loaded
    stabilize = loaded.body_site.stabilize
    if stabilize.power_law is None:
        rig.open(3_000, width_us)
    else:
        caps_ua = (3_000,) * loaded.array.count
        of_person: dict[str, Any] = {"exponent": exponent(k), "shape": stabilize.shape}
        made = calibration(rig, caps_ua, width_us=width_us, **of_person)
        answer = open_calibrated(rig, made)
        assert answer.error is None, answer.reason
    rig.arm()
    return rig


def fully_open(rig: EngineRig, current_ua: int = 3_000, k: float = 0.7) -> EngineRig:
    """Armed, with weak frames held, and the opening as high as `current_ua`; `k`: see `begun`."""
    begun(rig, k=k)
    opened_to(rig, current_ua)
    count = rig.engine.components.loaded.array.count
    hold_ms = current_ua // 5 + 30
    rig.hold(hold_ms, current_ua=only(count, e0=20), rate_hz=20.0)
    return rig


def calibration(rig: EngineRig, caps_ua: Sequence[int], **changes: Any) -> Calibration:
    """For the rig's array, with these caps; threshold and comfortable are half of each."""
    loaded = rig.engine.components.loaded
    made = Calibration(
        participant="P01",
        body_site=loaded.body_site.name,
        array=loaded.array.name,
        polarity="anodic",
        width_us=100,
        rate_hz=60.0,
        returns="all",
        date=datetime.date(2025, 1, 15),
        program="test",
        electrode=tuple(
            ElectrodeLimits(threshold_ua=cap // 2, comfortable_ua=cap // 2, cap_ua=cap)
            for cap in caps_ua
        ),
    )
    return msgspec.structs.replace(made, **changes)


def exponent(k: float, board: str = "kajimoto-hv507", leak_ohm: int = 66_000) -> FittedExponent:
    """One that may be used, on this board."""
    return FittedExponent(
        k=k,
        low=k - 0.2 * abs(k),
        high=k + 0.2 * abs(k),
        explained=0.9,
        explained_of_all=0.8,
        electrodes=(0, 1, 2, 3),
        states=4,
        fold=3.0,
        date=datetime.date(2025, 1, 15),
        board=board,
        leak_ohm=leak_ohm,
    )


def open_calibrated(rig: EngineRig, made: Calibration) -> Answer:
    return rig.open_with(made)


# --- configurations -------------------------------------------------------------------------------


def config(
    board: str = "kajimoto-hv507",
    electrodes: int | None = 16,
    *,
    accepted: tuple[str, ...] | None = None,
    guards: Guards | None = None,
    machine: dict[str, Any] | None = None,
    maxima: dict[str, int] | None = None,
    **board_keys: Any,
) -> LoadedConfig:
    """The fake's configuration with some keys changed."""
    loaded = fake_config(board=board, electrodes=electrodes)
    changed = msgspec.structs.replace(loaded.board, **board_keys)
    if guards is not None:
        changed = msgspec.structs.replace(changed, guards=guards)
    site = loaded.body_site
    if maxima is not None:
        site = msgspec.structs.replace(site, maxima=msgspec.structs.replace(site.maxima, **maxima))
    accept = changed.absent_guards if accepted is None else accepted
    return dataclasses.replace(
        loaded,
        config=msgspec.structs.replace(loaded.config, accept_absent_guards=accept),
        board=changed,
        body_site=site,
        machine=msgspec.structs.replace(loaded.machine, **(machine or {})),
    )


def unchecked(loaded: LoadedConfig) -> LoadedConfig:
    """With probes too weak to check source and ADC with, which the board's state then says: what
    laws make of a wrong reading is asked here. On other boards it halts within a second.
    """
    weak = msgspec.structs.replace(loaded.board.maxima, probe_current_ua=100)
    board = msgspec.structs.replace(loaded.board, maxima=weak)
    return dataclasses.replace(loaded, board=board)
