"""A record in short: how long, who, what was fired at which electrode, what went wrong.

Owns: the sums over a whole record. Must not know: files, how a sum is printed.
"""

from __future__ import annotations

import msgspec

from etd.protocol.pulse_row import PulseRow
from etd.record.lines import (
    Clocks,
    Engine,
    EngineGone,
    Halted,
    LeaseBegun,
    Line,
    Lost,
    Note,
    Pulses,
)
from etd.record.reader import RecordReader
from etd.record.stimuli import Dose, Stimuli, Stimulus
from etd.record.wall import WallClock


class ElectrodeDose(msgspec.Struct, frozen=True, kw_only=True):
    """All pulses of frames; `mean_ua`: what passed the skin at their ends, on average."""

    electrode: int
    pulses: int
    charge_nc: float
    most_ua: int
    mean_ua: int


class HaltFacts(msgspec.Struct, frozen=True, kw_only=True):
    wall: str | None
    cause: str
    source: str
    detail: str


class Summary(msgspec.Struct, frozen=True, kw_only=True):
    """`seconds`: from the first line with a time to the last. `ended`: None for a record that was
    cut off. `unfired_stimuli`: those of `stimuli` that were withheld as a whole. `silent_pulses`:
    looks for contact, which are not in the dose; `withheld`: pulses that were due and not fired.
    `left_out_requests`: of users without the lease, who sent more than they may add. `missing`:
    what the record lacks, a sentence each.
    """

    name: str
    begun: str
    seconds: float
    etd: str
    board: str | None
    backend: str | None
    array: str | None
    body_site: str | None
    digests: dict[str, str]
    people: tuple[str, ...]
    stimuli: int
    unfired_stimuli: int
    pulses: int
    silent_pulses: int
    withheld: int
    dose: tuple[ElectrodeDose, ...]
    halts: tuple[HaltFacts, ...]
    notes: int
    engine_ends: int
    lost_pulses: int
    lost_lines: int
    left_out_requests: int
    ended: str | None
    missing: tuple[str, ...]


class _Sums:
    def __init__(self) -> None:
        self.engine: Engine | None = None
        self.first_ns: int | None = None
        self.last_ns = 0
        self.people: dict[str, None] = {}
        self.stimuli = self.unfired_stimuli = self.pulses = self.silent_pulses = self.withheld = (
            self.notes
        ) = self.engine_ends = 0
        self.lost_pulses = self.lost_lines = self.left_out_requests = 0
        self.doses: dict[int, Dose] = {}
        self.halts: list[HaltFacts] = []
        self.wall = WallClock()

    def heed(self, line: Line) -> None:
        t_ns = getattr(line, "t_ns", None)
        if t_ns is not None:
            self.first_ns = t_ns if self.first_ns is None else self.first_ns
            self.last_ns = max(self.last_ns, t_ns)
        if isinstance(line, Clocks):
            self.wall.heed(line)
        elif isinstance(line, Engine):
            self.engine = line
        elif isinstance(line, EngineGone):
            self.engine_ends += 1
        elif isinstance(line, LeaseBegun):
            self.people.setdefault(_person(line))
        elif isinstance(line, Note):
            self.notes += 1
        elif isinstance(line, Lost):
            self.lost_pulses += line.pulses
            self.lost_lines += line.lines
            self.left_out_requests += line.requests
        elif isinstance(line, Halted):
            halt = line.report
            wall = self.wall.iso(halt.t_ns)
            facts = HaltFacts(wall=wall, cause=halt.cause, source=halt.source, detail=halt.detail)
            self.halts.append(facts)
        elif isinstance(line, Pulses):
            for row in line.rows:
                self._fired(row)

    def take(self, stimuli: list[Stimulus]) -> None:
        self.stimuli += len(stimuli)
        self.unfired_stimuli += sum(not stimulus.pulses for stimulus in stimuli)

    def _fired(self, row: PulseRow) -> None:
        if not row.current_ua:
            self.withheld += 1
            return
        if row.purpose != "stimulus":
            self.silent_pulses += 1
            return
        self.pulses += 1
        self.doses.setdefault(row.electrode, Dose()).add(row)


def summary_of(reader: RecordReader) -> Summary:
    """Raises: FileError."""
    sums, stimuli = _Sums(), Stimuli()
    for line in reader:
        sums.heed(line)
        stimuli.heed(line)
        sums.take(stimuli.take())
    sums.take(stimuli.take(all_of_them=True))
    return _summary(reader, sums)


def _summary(reader: RecordReader, sums: _Sums) -> Summary:
    header = reader.header
    facts = None if sums.engine is None else sums.engine.facts
    first_ns = sums.last_ns if sums.first_ns is None else sums.first_ns
    return Summary(
        name=reader.path.stem if header is None else header.name,
        begun="" if header is None else header.begun,
        seconds=round((sums.last_ns - first_ns) / 1e9, 3),
        etd="" if header is None else header.etd,
        board=None if facts is None else facts.board.name,
        backend=None if facts is None else facts.board.backend,
        array=None if facts is None else facts.array.name,
        body_site=None if facts is None else facts.body_site,
        digests={} if facts is None else facts.digests,
        people=tuple(sums.people),
        stimuli=sums.stimuli,
        unfired_stimuli=sums.unfired_stimuli,
        pulses=sums.pulses,
        silent_pulses=sums.silent_pulses,
        withheld=sums.withheld,
        dose=_doses(sums.doses),
        halts=tuple(sums.halts),
        notes=sums.notes,
        engine_ends=sums.engine_ends,
        lost_pulses=sums.lost_pulses,
        lost_lines=sums.lost_lines,
        left_out_requests=sums.left_out_requests,
        ended=None if reader.end is None else reader.end.why,
        missing=reader.missing,
    )


def _doses(doses: dict[int, Dose]) -> tuple[ElectrodeDose, ...]:
    return tuple(
        ElectrodeDose(
            electrode=electrode,
            pulses=dose.pulses,
            charge_nc=round(dose.charge_nc, 3),
            most_ua=dose.most_ua,
            mean_ua=dose.mean_ua,
        )
        for electrode, dose in sorted(doses.items())
    )


def _person(line: LeaseBegun) -> str:
    """As the calibration names the participant, who is a code."""
    if line.calibration is None:
        return f"without a calibration ({line.client})"
    participant = line.calibration.participant
    if line.others:
        names = ", ".join((line.calibration_name or "", *(other.name for other in line.others)))
        return f"{participant} (calibrations {names})"
    return f"{participant} (calibration {line.calibration_name})"
