"""A scan of 64 electrodes on the fake: its bus calls, and its time on the modelled Raspberry Pi 4.

Owns: what is counted and timed, from the bus trace alone. Must not know: bounds, tables.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from itertools import pairwise

import msgspec

import engine_rig
from etd.files.configuration import LoadedConfig, fake_config
from etd.files.resources import find
from etd.stabilize.law_settings import ContactSettings, LinearLawSettings, PressureSettings
from etd.stabilize.settings import NO_STABILIZERS, Settings
from etd_hal.boardfile import load_machine
from trace_decoder import Record

ELECTRODES = 64
WIDTH_US = 100
CURRENT_UA = 400
#: Far enough apart that each scan stands alone, whatever it takes.
RATE_HZ = 10.0
#: In the first ones contacts are still soft, and too weak for probes to go before them.
SCANS = 8
#: What the modelled Pi 4 takes for an SPI message besides the pulse.
MESSAGE_US = 13.0
#: The lines of one call change 50 ns apart; calls are microseconds apart.
_SAME_CALL_NS = 1_000


@dataclass(frozen=True)
class ScanFigures:
    """One scan, from its start until the last electrode has rested; the rewrite of the chain apart.

    `rewrite_us` is what of it does not fit into the last rest.
    """

    rest_us: int
    scan_us: float
    rewrite_us: float
    limit_us: float
    calls_per_pulse: float
    rewrite_calls: int

    @property
    def ratio(self) -> float:
        return self.scan_us / self.limit_us

    @property
    def ratio_with_rewrite(self) -> float:
        return (self.scan_us + self.rewrite_us) / self.limit_us


#: One law of each kind, with their default figures; of those by resistance the costliest.
STABILIZED = Settings(
    order=("pressure", "linear_law", "contact"),
    pressure=PressureSettings(),
    linear_law=LinearLawSettings(),
    contact=ContactSettings(),
)
#: The same, with a probe before every pulse.
AHEAD = msgspec.structs.replace(STABILIZED, probe_first=True)


def loaded_with(
    rest_us: int, machine: str = "pi4", stabilize: Settings = NO_STABILIZERS
) -> LoadedConfig:
    """The fake's own configuration, with another rest, and perhaps on another machine."""
    loaded = fake_config(electrodes=ELECTRODES)
    return replace(
        loaded,
        body_site=msgspec.structs.replace(loaded.body_site, stabilize=stabilize),
        board=msgspec.structs.replace(loaded.board, rest_us=rest_us),
        machine=load_machine(find("machines", machine)),
    )


def messages_of(stabilize: Settings) -> int:
    """How many a pulse."""
    return 2 if stabilize.probe_first else 1


def limit_us(loaded: LoadedConfig) -> float:
    """What no program can go below: the sum of widths and rests; and where probes go first, of
    their widths, and of what the kernel takes for the message that each of them is.
    """
    each_us = float(WIDTH_US + loaded.board.rest_us)
    if loaded.body_site.stabilize.probe_first:
        each_us += loaded.board.maxima.probe_width_us + MESSAGE_US
    return ELECTRODES * each_us


def engine_scan(rest_us: int, stabilize: Settings = NO_STABILIZERS) -> ScanFigures:
    """All electrodes active, in scan order; the slowest of the second half of some scans. In the
    first half messages are laid out in memory, once for each current and width.
    """
    loaded = loaded_with(rest_us, stabilize=stabilize)
    rig = engine_rig.make(loaded=loaded)
    rig.open()
    rig.arm()
    rig.hold(
        1_000 * SCANS / RATE_HZ,
        current_ua=(CURRENT_UA,) * ELECTRODES,
        width_us=WIDTH_US,
        rate_hz=RATE_HZ,
        ttl_ms=1_000,
    )
    problems = rig.close()
    assert problems == ()
    messages = ELECTRODES * messages_of(stabilize)
    scans = [_figures(scan, loaded) for scan in _whole_scans(rig.trace(), messages)]
    return max(scans[len(scans) // 2 :], key=lambda scan: scan.scan_us)


def _whole_scans(trace: list[Record], messages: int) -> list[list[Record]]:
    """The bus events from one scan's remark to the next one's, where all electrodes had a pulse."""
    starts = [place for place, entry in enumerate(trace) if entry.get("event") == "frame"]
    scans = [trace[begin:end] for begin, end in pairwise(starts)]
    return [scan for scan in scans if _messages(scan) == messages]


def _messages(scan: list[Record]) -> int:
    return sum(entry.get("event") == "message" for entry in scan)


def _figures(scan: list[Record], loaded: LoadedConfig) -> ScanFigures:
    rest_us = loaded.board.rest_us
    calls = _calls(scan)
    messages = [place for place, (_, kind) in enumerate(calls) if kind == "message"]
    # The first electrode's connecting, and the last one's discharge, enclose the pulses.
    enclosed = messages[-1] + 1 - (messages[0] - 1) + 1
    discharged_ns = calls[messages[-1] + 1][0]
    rested_ns = discharged_ns + rest_us * 1_000
    return ScanFigures(
        rest_us,
        (rested_ns - scan[0]["t_ns"]) / 1_000,
        max(0, calls[-1][0] - rested_ns) / 1_000,
        limit_us(loaded),
        enclosed / ELECTRODES,
        len(calls) - enclosed,
    )


def _calls(scan: list[Record]) -> list[tuple[int, str]]:
    """Port calls: messages, and groups of line changes that no two calls could be."""
    calls: list[tuple[int, str]] = []
    changed_ns = 0
    for record in scan:
        if record.get("event") == "message":
            calls.append((record["t_ns"], "message"))
        elif record["bus"] == "gpio":
            if record["t_ns"] - changed_ns > _SAME_CALL_NS:
                calls.append((record["t_ns"], "gpio"))
            changed_ns = record["t_ns"]
    return calls
