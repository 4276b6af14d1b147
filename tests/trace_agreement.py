"""What a decoded trace must agree with: the body's records, the engine's reports, the frames sent.

Owns: the comparison, assertion by assertion. Must not know: how any of the three came about.
"""

from __future__ import annotations

import bisect
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass

from etd.protocol.messages import Scan
from trace_decoder import Facts, Phase, Record, by_frame, decode, visits

WIDTH_TOLERANCE_US = 1.0
#: Of the board files: what asks whether anything touches.
PROBE_UA, PROBE_US = 300, 50


@dataclass(frozen=True)
class Sent:
    """A frame as it was sent, by the seq it had."""

    seq: int
    current_ua: Sequence[int]
    width_us: int
    phases: tuple[bool, ...] = (True,)

    @property
    def active(self) -> set[int]:
        return {electrode for electrode, current in enumerate(self.current_ua) if current > 0}


def one_code_ua(facts: Facts) -> float:
    return facts.full_scale_ua / (facts.codes - 1)


def check_body(trace: Sequence[Record]) -> None:
    """Each phase of the wires is a record of the body, and the other way round."""
    phases = decode(trace)
    told = [
        (entry["electrode"], entry["from_ns"], entry["to_ns"], entry["asked_ua"])
        for entry in trace[1:]
        if entry["bus"] == "body"
    ]
    decoded = [
        (
            phase.electrode,
            phase.from_ns,
            phase.to_ns,
            round(phase.current_ua) * (1 if phase.is_anodic else -1),
        )
        for phase in phases
    ]
    assert decoded == told


def check_what_passes(trace: Sequence[Record]) -> None:
    """What passes the skin is part of what the source is told, and flows the same way."""
    for entry in trace[1:]:
        if entry["bus"] == "body":
            assert abs(entry["current_ua"]) <= abs(entry["asked_ua"]) + 1
            assert entry["current_ua"] * entry["asked_ua"] >= 0


def is_look(phase: Phase, active: Collection[int]) -> bool:
    """A probe of an electrode that the frame leaves silent: what it carries must be known."""
    is_weak = phase.current_ua <= PROBE_UA and phase.width_us <= PROBE_US
    return is_weak and phase.electrode not in active


def check_frame(sent: Sent, phases: Sequence[Phase], facts: Facts) -> None:
    """Exactly the active electrodes, each with its current, width and phases."""
    phases = [phase for phase in phases if not is_look(phase, sent.active)]
    assert {phase.electrode for phase in phases} == sent.active
    pulses = list(visits(phases))
    assert {tuple(phase.is_anodic for phase in pulse) for pulse in pulses} == {sent.phases}
    for phase in phases:
        assert phase.electrode is not None
        asked_ua = sent.current_ua[phase.electrode]
        assert asked_ua - one_code_ua(facts) < phase.current_ua <= asked_ua
        assert sent.width_us - WIDTH_TOLERANCE_US < phase.width_us <= sent.width_us


def check_frames(sent: Iterable[Sent], trace: Sequence[Record]) -> None:
    """Every frame that was sent, and no other from the first of them on."""
    facts, by_seq = Facts.of(trace[0]), {one.seq: one for one in sent}
    all_frames = by_frame(decode(trace)).items()
    found = {
        seq: phases
        for seq, phases in all_frames
        if seq >= min(by_seq)
        and not all(is_look(phase, by_seq[seq].active if seq in by_seq else ()) for phase in phases)
    }
    assert found.keys() == {seq for seq, sent in by_seq.items() if sent.active}
    for seq, phases in found.items():
        check_frame(by_seq[seq], phases, facts)


def check_returns(phases: Iterable[Phase], facts: Facts, returns: dict[int, set[int]]) -> None:
    """The electrodes opposite to each stimulated one are just its returns."""
    electrode_of = {output: electrode for electrode, output in enumerate(facts.electrodes)}
    for phase in phases:
        assert phase.electrode is not None
        opposite = phase.ground if phase.is_anodic else phase.source
        assert {electrode_of[output] for output in opposite} == returns[phase.electrode]


def check_reports(trace: Sequence[Record], scans: Iterable[Scan]) -> int:
    """What the reports say was fired last, the wires say too. Returns how many were compared."""
    facts, compared = Facts.of(trace[0]), 0
    last = _LastPulses(by_frame(decode(trace)))
    for scan in scans:
        for electrode, (current_ua, width_us) in enumerate(
            zip(scan.fired.current_ua, scan.fired.width_us, strict=True)
        ):
            phase = last.before(scan.seq, electrode, scan.now_ns)
            is_silent = scan.seq >= 0 and not scan.fired.wanted_ua[electrode]
            if phase is None or is_silent:
                assert current_ua == 0
                continue
            compared += 1
            assert abs(phase.current_ua - current_ua) <= one_code_ua(facts)
            assert abs(phase.width_us - width_us) <= WIDTH_TOLERANCE_US
    return compared


class _LastPulses:
    def __init__(self, frames: dict[int, list[Phase]]) -> None:
        self._phases: dict[tuple[int, int], list[Phase]] = {}
        for seq, phases in frames.items():
            for phase in phases:
                assert phase.electrode is not None
                self._phases.setdefault((seq, phase.electrode), []).append(phase)

    def before(self, seq: int, electrode: int, t_ns: int) -> Phase | None:
        phases = self._phases.get((seq, electrode), [])
        place = bisect.bisect_left(phases, t_ns, key=lambda phase: phase.to_ns)
        return phases[place - 1] if place else None
