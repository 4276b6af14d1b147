"""A bus trace decoded from its SPI and GPIO events alone: which electrode got what, and when.

Owns: the reading of a trace as an oscilloscope on the wires would show it. It imports nothing of
the project: whatever the program believes about itself does not count here.
Must not know: `body` and `engine` records, beyond the `frame` remarks that group the pulses.

Facts used. AD5452: 16 bits a chip select, C1 C0 D11..D0 X X, output updated when chip select
rises. HV507 and HV513: shift on CLK rising, latch transparent while LE is high; BL 0 POL 1 all
low, BL 0 POL 0 all high, BL 1 POL 1 the latch, BL 1 POL 0 its inverse; a high output is on the
source, a low one on ground. 74HC595: shift on CLK rising, copied on LE rising; relays follow
within ton and toff.
"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from itertools import chain
from pathlib import Path
from typing import Any

Record = dict[str, Any]
DAC_BITS = 16
HALF_BRIDGES = ("HV507", "HV513")
SWITCH_LINES = ("POL", "BL", "LE", "CLK", "DATA")


@dataclass(frozen=True)
class Facts:
    """The trace's first line."""

    switch: str
    outputs: int
    lines: dict[str, int]
    full_scale_ua: float
    codes: int
    electrodes: tuple[int, ...]
    on_bit: int = 0
    return_bit: int = 1
    ton_ns: int = 0
    toff_ns: int = 0
    #: Nothing stronger is a probe; 0 where the trace does not say it: then nothing is.
    probe_ua: float = 0.0

    @classmethod
    def of(cls, header: Record) -> Facts:
        assert header["etd_trace"] == 1, "not a trace of version 1"
        return cls(
            header["switch"],
            header["outputs"],
            dict(header["lines"]),
            header["full_scale_ua"],
            header["codes"],
            tuple(header["electrodes"]),
            header.get("on_bit", 0),
            header.get("return_bit", 1),
            header.get("ton_us", 0) * 1_000,
            header.get("toff_us", 0) * 1_000,
            header.get("probe_current_ua", 0),
        )

    def current_ua(self, code: int) -> float:
        return code * self.full_scale_ua / (self.codes - 1)


@dataclass(frozen=True)
class Phase:
    """An unbroken stretch of one DAC code through one state of the switch. A prepulse is a phase
    of its own, which the pulse's follows without a gap.

    `source` and `ground` are outputs; `electrode` the one that stands alone on its side (the
    source's, with one on each), None where none does or no electrode hangs there. `seq`, `tag`
    and `scan` (counted from 0 through the whole trace) are those of the last `frame` remark.
    """

    electrode: int | None
    source: frozenset[int] = field(repr=False)
    ground: frozenset[int] = field(repr=False)
    is_anodic: bool
    code: int
    current_ua: float
    from_ns: int
    to_ns: int
    seq: int | None
    tag: int | None
    scan: int | None
    #: How often a line of the switch had changed before it.
    moves: int = field(default=0, compare=False, repr=False)
    #: No stronger than the board's probes.
    is_weak: bool = field(default=False, compare=False, repr=False)

    @property
    def width_us(self) -> float:
        return (self.to_ns - self.from_ns) / 1_000

    @property
    def charge_pc(self) -> float:
        return self.current_ua * self.width_us


@dataclass
class Shifter:
    """A chain of stages; a stage that was never written since power-up is not known."""

    stages: int
    bits: int = 0
    written: int = 0

    def __post_init__(self) -> None:
        self._full = (1 << self.stages) - 1

    def shift(self, bit: int) -> None:
        self.bits = (self.bits << 1 | bit) & self._full
        self.written += 1

    @property
    def is_known(self) -> bool:
        return self.written >= self.stages


@dataclass
class Wires:
    """Levels, chain and latch as the events so far have left them."""

    facts: Facts
    level: dict[str, int] = field(default_factory=dict)
    latch: int | None = None
    #: When the outputs were last copied, and what they were before (relays only).
    copied_ns: int = 0
    latch_before: int | None = None

    def __post_init__(self) -> None:
        self.is_relays = self.facts.switch not in HALF_BRIDGES
        self.switch_lines = frozenset(
            line for name, line in self.facts.lines.items() if name in SWITCH_LINES
        )
        stages = self.facts.outputs * (2 if self.is_relays else 1)
        self.chain = Shifter(stages)
        self._names = {line: name for name, line in self.facts.lines.items()}
        #: By word: a trace has few, and asks at each edge.
        self._sides_of: dict[int, tuple[frozenset[int], frozenset[int]]] = {}

    def name(self, line: int) -> str:
        found = self._names.get(line)
        return f"line {line}" if found is None else found

    def change(self, t_ns: int, line: int, value: int) -> bool:
        """One gpio event; True if the level is another one now."""
        name, level = self.name(line), self.level
        was = level.get(name)
        if was == value:
            return False
        level[name] = value
        rises = value == 1 and was == 0
        if rises and name == "CLK":
            self.chain.shift(level.get("DATA", 0))
        if self.is_relays:
            if rises and name == "LE":
                self._copy(t_ns)
        elif level.get("LE") == 1:
            self.latch = self.chain.bits if self.chain.is_known else None
        return True

    def _copy(self, t_ns: int) -> None:
        self.latch_before, self.copied_ns = self.latch, t_ns
        self.latch = self.chain.bits if self.chain.is_known else None

    def sides(self) -> tuple[frozenset[int], frozenset[int]] | None:
        """(source, ground) as outputs; None while it cannot be known."""
        word = self.latch if self.is_relays else self._high()
        if word is None:
            return None
        found = self._sides_of.get(word)
        if found is None:
            found = self._relay_sides(word) if self.is_relays else self._half_bridge_sides(word)
            self._sides_of[word] = found
        return found

    def _high(self) -> int | None:
        """Of half-bridges: the outputs at the source, as bits."""
        full = (1 << self.facts.outputs) - 1
        direct = self.level.get("POL") == 1
        if self.level.get("BL") == 0:
            return 0 if direct else full
        if self.latch is None:
            return None
        return (self.latch if direct else ~self.latch) & full

    def _half_bridge_sides(self, high: int) -> tuple[frozenset[int], frozenset[int]]:
        everybody = range(self.facts.outputs)
        source = frozenset(electrode for electrode in everybody if high >> electrode & 1)
        return source, frozenset(everybody) - source

    def is_isolated(self, t_ns: int) -> bool:
        """Nothing is connected to the source, and no output is selected, by latch or relay."""
        if self.is_relays:
            return self.latch == 0 and t_ns - self.copied_ns >= self.facts.toff_ns
        return self.latch == 0 and self.level.get("BL") == 0 and self.level.get("POL") == 1

    def has_none_selected(self) -> bool:
        """All outputs are live and on ground: half-bridges whose closed latch holds zeros."""
        lines = self.level.get("BL"), self.level.get("POL"), self.level.get("LE")
        return not self.is_relays and self.latch == 0 and lines == (1, 1, 0)

    def _relay_sides(self, word: int) -> tuple[frozenset[int], frozenset[int]]:
        facts, everybody = self.facts, range(self.facts.outputs)
        return (
            frozenset(
                electrode for electrode in everybody if word >> 2 * electrode + facts.on_bit & 1
            ),
            frozenset(
                electrode for electrode in everybody if word >> 2 * electrode + facts.return_bit & 1
            ),
        )


@dataclass
class Dac:
    """What the DAC makes of its chip select; `bits` since it fell."""

    code: int = 0
    word: int = 0
    bits: int = 0

    def transfer(self, sent: bytes) -> None:
        self.word = int.from_bytes(sent, "big") if sent else self.word
        self.bits += 8 * len(sent)

    def chip_select(self, is_active: bool) -> None:
        if is_active:
            self.bits = 0
        elif self.bits:
            self.code = self.word >> 2 & 0xFFF


class Decoder:
    """Fed with the events of a trace in order; `phases` grows, and `unloaded` by what is weak and
    goes into the node alone.
    """

    def __init__(self, facts: Facts) -> None:
        self.facts = facts
        self.wires = Wires(facts)
        self.dac = Dac()
        self.phases: list[Phase] = []
        self.unloaded: list[Phase] = []
        #: The same with the outputs live, and none selected.
        self.unselected: list[Phase] = []
        self._electrode_of = {
            output: electrode for electrode, output in enumerate(facts.electrodes)
        }
        self._frame: tuple[int | None, int | None] = (None, None)
        self._scan: int | None = None
        self._since_ns = 0
        self._moves = 0

    def take(self, record: Record) -> None:
        t_ns, bus = record["t_ns"], record["bus"]
        if bus == "gpio":
            self._gpio(t_ns, record["line"], record["value"])
        elif bus == "spi":
            self._spi(t_ns, record)
        elif bus == "engine" and record["event"] == "frame":
            self._frame = (record["seq"], record["tag"])
            self._scan = 0 if self._scan is None else self._scan + 1

    def _gpio(self, t_ns: int, line: int, value: int) -> None:
        wires, code = self.wires, self.dac.code
        if not code:
            # Most of a trace: chains are shifted while nothing flows.
            self._moves += wires.change(t_ns, line, value) and line in wires.switch_lines
            return
        before_sides = wires.sides()
        is_moved = wires.change(t_ns, line, value)
        if wires.sides() != before_sides:
            self._cut(t_ns, code, before_sides)
        self._moves += is_moved and line in wires.switch_lines

    def _spi(self, t_ns: int, record: Record) -> None:
        event = record["event"]
        if event == "transfer":
            self.dac.transfer(bytes.fromhex(record["tx"]))
        elif event == "cs":
            before = self.dac.code
            self.dac.chip_select(record["active"])
            if self.dac.code != before:
                self._cut(t_ns, before, self.wires.sides() if before else None)

    def _cut(
        self, t_ns: int, code: int, sides: tuple[frozenset[int], frozenset[int]] | None
    ) -> None:
        """What went on until now with `code` is a phase of its own, if it is one at all."""
        since_ns, self._since_ns = self._since_ns, t_ns
        if not code:
            return
        source, ground = sides if sides is not None else (frozenset(), frozenset())
        output, is_anodic = _odd_one_out(source, ground)
        electrode = None if output is None else self._electrode_of.get(output)
        seq, tag = self._frame
        is_weak = self.facts.current_ua(code) <= self.facts.probe_ua
        kept = self.phases
        if is_weak and self.wires.is_isolated(since_ns):
            kept = self.unloaded
        elif is_weak and self.wires.has_none_selected():
            kept = self.unselected
        kept.append(
            Phase(
                electrode,
                source,
                ground,
                is_anodic,
                code,
                self.facts.current_ua(code),
                since_ns,
                t_ns,
                seq,
                tag,
                self._scan,
                self._moves,
                is_weak,
            )
        )


def _odd_one_out(source: frozenset[int], ground: frozenset[int]) -> tuple[int | None, bool]:
    if len(source) == 1 and ground:
        return next(iter(source)), True
    if len(ground) == 1 and source:
        return next(iter(ground)), False
    return None, True


def read(path: Path) -> list[Record]:
    """The lines of a trace file, its header first."""
    return parse(path.read_bytes())


def parse(data: bytes) -> list[Record]:
    return [json.loads(line) for line in data.splitlines()]


def decode(trace: Iterable[Record]) -> list[Phase]:
    """All phases of a trace, in order of time."""
    records = iter(trace)
    decoder = Decoder(Facts.of(next(records)))
    for record in records:
        decoder.take(record)
    return decoder.phases


def by_frame(phases: Iterable[Phase]) -> dict[int, list[Phase]]:
    """The phases of each frame, by seq; those before the first frame are left out."""
    found: dict[int, list[Phase]] = {}
    for phase in phases:
        if phase.seq is not None:
            found.setdefault(phase.seq, []).append(phase)
    return found


Pulse = tuple[Phase, ...]


def pulses(phases: Iterable[Phase]) -> Iterator[Pulse]:
    """Phases without a gap between them, through the same outputs: a prepulse and its pulse."""
    pending: Pulse = ()
    for phase in phases:
        if pending and not _follows(pending[-1], phase):
            yield pending
            pending = ()
        pending = (*pending, phase)
    if pending:
        yield pending


def _follows(first: Phase, second: Phase) -> bool:
    is_same = (first.source, first.ground) == (second.source, second.ground)
    return is_same and first.to_ns == second.from_ns


def visits(phases: Iterable[Phase]) -> Iterator[tuple[Phase, ...]]:
    """Phases that belong together: a pulse, with its prepulse if it has one; a probe that went
    before it; and the next one, if that is on the same electrode, the other way round, in the same
    scan.
    """
    pending: list[Pulse] = []
    for pulse in pulses(phases):
        if len(pending) == 1 and is_led(pending[0][-1], pulse[0]):
            pending.append(pulse)
        elif pending and _is_second(pending[-1][-1], pulse[0]):
            yield (*chain(*pending), *pulse)
            pending = []
        else:
            if pending:
                yield tuple(chain(*pending))
            pending = [pulse]
    if pending:
        yield tuple(chain(*pending))


def is_led(probe: Phase, pulse: Phase) -> bool:
    """One no stronger than a probe, the current off, and then the pulse, which may have become
    weaker still: the same way, with nothing moved.
    """
    is_same = (probe.source, probe.ground) == (pulse.source, pulse.ground)
    is_same &= (probe.scan, probe.seq) == (pulse.scan, pulse.seq)
    is_unmoved = probe.moves == pulse.moves and probe.to_ns < pulse.from_ns
    return is_same and is_unmoved and probe.is_weak


def _is_second(first: Phase, second: Phase) -> bool:
    return (
        first.source == second.ground
        and first.ground == second.source
        and first.scan == second.scan
        and first.seq == second.seq
    )
