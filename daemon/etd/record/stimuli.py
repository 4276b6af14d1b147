"""The stimuli in a record: frames that showed the same without a gap, with what they fired.

Owns: which frames are one stimulus, its sums by electrode, and why pulses of it were withheld. Must
not know: files, formats.

A stimulus that lasts is renewed frame by frame, as no frame lives for long. Frames with the same
contents are one where each came while the one before it lived, or where their pulses are apart by
no more than the frame's rate explains, with no silent frame between them.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any

from etd.protocol.pulse_row import PulseRow
from etd.record.frames import LEAST_GAP_NS, AskedFrame, AskedFrames
from etd.record.lines import LeaseBegun, LeaseEnded, Line, Pulses, Scans


@dataclass(slots=True)
class Dose:
    """What one electrode was given. `delivered_ua` is the sum over its pulses. `withheld`: pulses
    that were due and not fired. `limited`: what lowered those that were fired.
    """

    pulses: int = 0
    withheld: int = 0
    least_ua: int = 0
    most_ua: int = 0
    charge_nc: float = 0.0
    delivered_ua: int = 0
    limited: set[str] = field(default_factory=set)

    @property
    def mean_ua(self) -> int:
        return round(self.delivered_ua / self.pulses) if self.pulses else 0

    def add(self, row: PulseRow) -> None:
        if row.limited is not None:
            self.limited.add(row.limited)
        if not row.current_ua:
            self.withheld += 1
            return
        self.least_ua = min(self.least_ua, row.current_ua) if self.pulses else row.current_ua
        self.most_ua = max(self.most_ua, row.current_ua)
        self.pulses += 1
        self.charge_nc += row.charge_nc
        self.delivered_ua += row.delivered_ua


@dataclass(slots=True)
class Stimulus:
    """`asked`: the fields of its frames, `begun_with` and `seq` the first and the last of them.
    From `first_ns` to `last_ns` it was fired; where all of it was withheld, it was due then.
    `told`: what limits did while it was shown, by electrode; None for whole scans.
    """

    asked: dict[str, Any]
    client: str
    begun_with: int
    seq: int
    first_ns: int
    last_ns: int
    by_electrode: dict[int, Dose] = field(default_factory=dict)
    told: dict[int | None, set[str]] = field(default_factory=dict)

    @property
    def limited(self) -> list[str]:
        """What lowered or withheld pulses of it, as far as it was told."""
        found = set(self.told.get(None, ()))
        for electrode, dose in self.by_electrode.items():
            found |= dose.limited
            if dose.withheld:
                found |= self.told.get(electrode, set())
        return sorted(found)

    @property
    def withheld(self) -> int:
        return sum(dose.withheld for dose in self.by_electrode.values())

    @property
    def tag(self) -> int | str | None:
        return self.asked.get("tag")

    @property
    def pulses(self) -> int:
        return sum(dose.pulses for dose in self.by_electrode.values())

    def add(self, row: PulseRow) -> None:
        if row.current_ua and not self.pulses:
            self.first_ns = row.t_ns
        if row.current_ua or not self.pulses:
            self.last_ns = row.t_ns
        self.by_electrode.setdefault(row.electrode, Dose()).add(row)

    def explain(self, scans: Scans) -> None:
        """Add what was told of the scans, if they are of its frames."""
        if not any(self.begun_with <= shown.seq <= self.seq for shown in scans.shown):
            return
        for clamp in scans.clamped:
            self.told.setdefault(clamp.electrode, set()).add(clamp.reason)
        for shortfall in scans.not_fired:
            if shortfall.pulses:
                self.told.setdefault(shortfall.electrode, set()).add(shortfall.reason)


class Stimuli:
    """Tell it each line; `take` returns those that are over."""

    def __init__(self) -> None:
        self._frames = AskedFrames()
        self._current: Stimulus | None = None
        #: The last frame of the current one, and when a pulse of it was due last.
        self._frame: AskedFrame | None = None
        self._due_ns = 0
        #: Over, but the scans of their last pulses are not told yet.
        self._waiting: list[Stimulus] = []
        self._over: list[Stimulus] = []
        #: The last that were told: their pulses may come later.
        self._scans: Scans | None = None

    def heed(self, line: Line) -> None:
        self._frames.heed(line)
        if isinstance(line, Pulses):
            for row in line.rows:
                if row.purpose == "stimulus" and row.seq is not None:
                    self._shown(row.seq, row.t_ns).add(row)
                    self._due_ns = row.t_ns
        elif isinstance(line, Scans):
            self._heed_scans(line)
        elif isinstance(line, LeaseEnded):
            self._end()
        elif isinstance(line, LeaseBegun):
            self._end()
            self._release()
            self._scans = None

    def take(self, *, all_of_them: bool = False) -> list[Stimulus]:
        if all_of_them:
            self._end()
            self._release()
        over, self._over = self._over, []
        return over

    def _shown(self, seq: int, t_ns: int) -> Stimulus:
        """A pulse of this frame was due at that time: the stimulus that it belongs to."""
        current = self._current
        if current is not None and current.seq == seq:
            return current
        is_more = current is not None and self._goes_on(current, seq, t_ns)
        frame = self._frames.take(seq)
        if current is not None and is_more:
            current.seq = seq
        else:
            self._end()
            # Without the frame (the record began after it did) nothing of what was asked is known.
            fields = {} if frame is None else frame.fields
            client = "" if frame is None else frame.client
            current = self._current = Stimulus(fields, client, seq, seq, t_ns, t_ns)
        self._frame = frame
        if self._scans is not None:
            current.explain(self._scans)
        return current

    def _goes_on(self, current: Stimulus, seq: int, t_ns: int) -> bool:
        came = list(self._frames.between(current.seq, seq))
        before = self._frame
        fields = came[-1].fields if came and came[-1].seq == seq else {}
        if fields != current.asked or any(frame.is_silent for frame in came):
            return False
        if t_ns - self._due_ns < (LEAST_GAP_NS if before is None else before.gap_ns):
            return True
        if before is None:
            return False
        chain = [before, *came]
        return all(later.goes_on_with(earlier) for earlier, later in zip(chain, came, strict=False))

    def _heed_scans(self, scans: Scans) -> None:
        self._scans = scans
        if self._current is not None:
            self._current.explain(scans)
        for stimulus in self._waiting:
            stimulus.explain(scans)
        self._release(scans.now_ns)

    def _end(self) -> None:
        if self._current is not None:
            self._waiting.append(self._current)
            self._current = self._frame = None

    def _release(self, told_until_ns: int | None = None) -> None:
        """Those of which all is told; all of them, where nothing more will be."""
        while self._waiting and (
            told_until_ns is None or self._waiting[0].last_ns <= told_until_ns
        ):
            self._over.append(self._waiting.pop(0))


def stimuli_of(record: Iterable[Line]) -> Iterator[Stimulus]:
    """All of a record."""
    stimuli = Stimuli()
    for line in record:
        stimuli.heed(line)
        yield from stimuli.take()
    yield from stimuli.take(all_of_them=True)
