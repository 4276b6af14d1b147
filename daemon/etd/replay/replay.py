"""Plays a record on a fake board, and compares the pulses.

Owns: the order of what is told and what is expected, and what the outcome is. Must not know: how an
engine is driven (`engine.py`), printing.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

from etd.files.configuration import LoadedConfig
from etd.protocol.errors import FileError
from etd.protocol.pulse_row import PulseRow
from etd.record.lines import Carried, Engine, EngineGone, Lost, Pulses
from etd.record.reader import RecordReader
from etd.replay.compare import Comparer, Comparison
from etd.replay.engine import ReplayEngine
from etd.replay.timeline import Timeline
from etd_hal.backend import ReplayStage

#: A pulse that the engine has not fired so long after its time is not waited for any more.
_SLACK_NS = 3_000_000
#: After the last that was told.
_AFTER_NS = 50_000_000
#: No pulse begins in it.
_BEFORE_NS = 100_000


def engine_of(path: Path) -> Engine:
    """The engine's facts in a record. Raises: FileError."""
    for line in RecordReader(path):
        if isinstance(line, Engine):
            return line
    raise FileError(str(path), "", "no engine was there", "a record with pulses in it")


def check_same_files(path: Path, loaded: LoadedConfig) -> None:
    """Raises: FileError, where a file is not the one that the record was made with."""
    recorded = engine_of(path).facts.digests
    for what in ("board", "array", "body_site"):
        if recorded.get(what) != loaded.digests.get(what):
            raise FileError(
                str(path),
                what,
                f"the {what.replace('_', ' ')} file has changed since the record was made, or is"
                " another",
                "the configuration of that time: --config FILE",
            )


def caveats_of(path: Path) -> tuple[str, ...]:
    """Why a replay may differ, a sentence each: to be told before it. Raises: FileError."""
    return tuple(Timeline(RecordReader(path), str(path)).caveats)


def replayed(
    path: Path,
    loaded: LoadedConfig,
    stage: ReplayStage,
    progress: Callable[[int], None] = lambda _: None,
) -> Comparison:
    """`progress` is called with the number of pulses so far. Raises: FileError, BoardFault,
    BusError.
    """
    source = loaded.board.source
    comparer = Comparer(source.full_scale_ua / (source.codes - 1))
    timeline = Timeline(RecordReader(path), str(path))
    from_ns = timeline.compared_from_ns
    with ReplayEngine(loaded, stage) as engine:
        for each in timeline.told:
            engine.tell(each)
        # What makes the engine ready measures the fake's own body.
        for _ in engine.until(from_ns - _BEFORE_NS, None):
            pass
        for pulses, row in enumerate(_rows(path, from_ns), start=1):
            comparer.recorded(row)
            for fired in engine.until(row.t_ns + _SLACK_NS, row):
                comparer.replayed(fired)
            progress(pulses)
        for fired in engine.until(timeline.told[-1].t_ns + _AFTER_NS, None):
            comparer.replayed(fired)
        comparer.lost(_lost(path))
        return comparer.done(engine.refused)


def _lost(path: Path) -> int:
    return sum(line.pulses for line in RecordReader(path) if isinstance(line, Lost))


def _rows(path: Path, from_ns: int) -> Iterator[PulseRow]:
    """Of the engine with which the record begins."""
    has_begun = False
    for line in RecordReader(path):
        if isinstance(line, Carried):
            has_begun = True
        elif isinstance(line, EngineGone) and has_begun:
            return
        elif isinstance(line, Pulses):
            yield from (row for row in line.rows if row.asked_ns >= from_ns)
