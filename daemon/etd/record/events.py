"""The events of a record as a table that follows BIDS: stimuli, marks, notes, halts.

Owns: the columns of `*_events.tsv`, and the side file that explains them. Must not know: where a
table is written.

Source: Brain Imaging Data Structure 1.10, "Task events": tab-separated, `onset` and `duration` in
seconds first, `n/a` for what is not there, and a JSON file of the same name that describes columns.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, TypeAlias

from etd.record.lines import Asked, Clocks, Halted, Header, Line, Note, Replied
from etd.record.stimuli import Stimuli, Stimulus
from etd.record.wall import WallClock

COLUMNS: dict[str, str] = {
    "onset": "first pulse, or mark: in seconds from the beginning of the record",
    "duration": "from the first pulse to the last, in seconds; 0 for what has no length",
    "trial_type": "stimulus, mark, note or halt",
    "wall_time": "UTC",
    "client": "the program that asked",
    "seq": "of the stimulus' last frame, in its lease",
    "tag": "as the program gave it",
    "electrodes": "those of which a pulse was due, separated by commas; the next columns are in"
    " their order",
    "wanted_ua": "the highest current asked for, in uA; n/a where levels were asked for",
    "level": "the level asked for; n/a where currents were asked for",
    "least_ua": "the lowest current fired, in uA; 0 where nothing was fired",
    "most_ua": "the highest current fired, in uA; 0 where nothing was fired",
    "delivered_ua": "what passed the skin at the ends of the pulses, on average, in uA",
    "pulses": "how many were fired; 0 for all: the stimulus was withheld as a whole",
    "withheld": "how many more were due, and were not fired",
    "charge_nc": "of all pulses together, in nC",
    "limited": "what lowered or withheld pulses, if anything: cap, return_cap, soft_start,"
    " recontact, contact_open, charge, frame; ledger, resolution, overrun, timing, processor;"
    " not_told: withheld, and no reason is in the record",
    "text": "of a note, or the cause of a halt",
}
_NOT_THERE = "n/a"
#: Its time, and its row.
_Event: TypeAlias = tuple[int, str]


def sidecar(missing: Sequence[str] = ()) -> dict[str, Any]:
    """What each column says, for the JSON file beside the table; and what the record lacks, in
    sentences, where it is not whole.
    """
    columns: dict[str, Any] = {name: {"Description": said} for name, said in COLUMNS.items()}
    return columns | ({"RecordIncomplete": list(missing)} if missing else {})


def table(record: Iterable[Line]) -> Iterator[str]:
    """The lines of the table, its header first, then the events by their onset."""
    events = _Events()
    found = [event for line in record for event in events.heed(line)]
    found.extend(events.rest())
    yield "\t".join(COLUMNS)
    yield from (row for _, row in sorted(found, key=lambda event: event[0]))


class _Events:
    def __init__(self) -> None:
        self._stimuli = Stimuli()
        self._wall = WallClock()
        self._zero_ns = 0
        self._is_zero_the_boards = False
        #: Marks that were asked for, by number.
        self._marks: dict[int, Asked] = {}

    def heed(self, line: Line) -> Iterator[_Event]:
        self._stimuli.heed(line)
        for stimulus in self._stimuli.take():
            yield self._of_stimulus(stimulus)
        if isinstance(line, Header):
            self._zero_ns = line.begun_ns
        elif isinstance(line, Clocks):
            self._wall.heed(line)
            if not self._is_zero_the_boards:
                # All events are in the board's time, and a fake's lags.
                self._zero_ns -= line.clock_lag_us * 1_000
                self._is_zero_the_boards = True
        elif isinstance(line, Asked) and line.request.get("op") == "mark":
            self._marks[line.number] = line
        elif isinstance(line, Replied) and line.number in self._marks:
            asked = self._marks.pop(line.number)
            if line.ok:
                tag, at_ns = asked.request.get("tag"), line.reply["marked_ns"]
                yield self._row(at_ns, "mark", client=asked.client, tag=tag)
        elif isinstance(line, Note):
            yield self._row(line.t_ns, "note", text=line.text)
        elif isinstance(line, Halted):
            halt = line.report
            text = f"{halt.cause} ({halt.source}): {halt.detail}"
            yield self._row(halt.t_ns, "halt", text=text)

    def rest(self) -> Iterator[_Event]:
        for stimulus in self._stimuli.take(all_of_them=True):
            yield self._of_stimulus(stimulus)

    def _of_stimulus(self, stimulus: Stimulus) -> _Event:
        doses = dict(sorted(stimulus.by_electrode.items()))
        return self._row(
            stimulus.first_ns,
            "stimulus",
            duration=_seconds(stimulus.last_ns - stimulus.first_ns),
            client=stimulus.client,
            seq=stimulus.seq,
            tag=stimulus.tag,
            electrodes=_listed(doses),
            wanted_ua=_asked_of(stimulus, "current_ua"),
            level=_asked_of(stimulus, "level"),
            least_ua=_listed(dose.least_ua for dose in doses.values()),
            most_ua=_listed(dose.most_ua for dose in doses.values()),
            delivered_ua=_listed(dose.mean_ua for dose in doses.values()),
            pulses=_listed(dose.pulses for dose in doses.values()),
            withheld=_listed(dose.withheld for dose in doses.values()),
            charge_nc=_listed(round(dose.charge_nc, 3) for dose in doses.values()),
            limited=_why(stimulus),
        )

    def _row(self, t_ns: int, kind: str, duration: str = "0", **said: object) -> _Event:
        values: dict[str, object] = {
            "onset": _seconds(t_ns - self._zero_ns),
            "duration": duration,
            "trial_type": kind,
            "wall_time": self._wall.iso(t_ns),
            **said,
        }
        return t_ns, "\t".join(_cell(values.get(name)) for name in COLUMNS)


def _asked_of(stimulus: Stimulus, key: str) -> str | None:
    values = stimulus.asked.get(key)
    if values is None:
        return None
    asked = dict(enumerate(values))
    return _listed(asked.get(it, _NOT_THERE) for it in sorted(stimulus.by_electrode))


def _why(stimulus: Stimulus) -> str | None:
    if stimulus.pulses:
        return ",".join(stimulus.limited) or None
    return ",".join(stimulus.limited) or "not_told"


def _listed(values: Iterable[object]) -> str:
    return ",".join(str(value) for value in values)


def _seconds(duration_ns: int) -> str:
    return f"{duration_ns / 1e9:.6f}"


def _cell(value: object) -> str:
    """A cell has no tab and no line feed: both would be a cell or a line more."""
    text = "" if value is None else " ".join(str(value).split())
    return text or _NOT_THERE
