"""What must never be seen in any bus trace, read from its SPI and GPIO events alone.

Owns: the rules, each as a sentence with its time where it is broken. Like the decoder it imports
nothing of the project. Must not know: what was meant to happen.

A stop is the one thing that may come while current flows: all outputs to ground (POL 1, BL 0) and
the supply off where the board has an enable line, within a microsecond. The enable line is taken
as on at 1, which is how every shipped board is wired.
"""

from __future__ import annotations

from collections.abc import Iterable

from trace_decoder import DAC_BITS, SWITCH_LINES, Dac, Facts, Record, Wires

MOST_DATA_TRANSFERS = 32
TRANSFERS_THAT_WRAP = 512
LONGEST_DELAY_US = 10
STOP_WITHIN_NS = 1_000


class Rules:
    """Fed with the events in order; `found` grows."""

    def __init__(self, facts: Facts, rest_us: float) -> None:
        self.facts = facts
        self.found: list[str] = []
        self._wires = Wires(facts)
        self._dac = Dac()
        self._rest_ns = rest_us * 1_000
        self._t_ns = 0
        self._words = 0
        self._last_word = 0
        self._is_cs_held = False
        #: Changes while current flowed, waiting for the rest of a stop.
        self._unexcused: list[tuple[int, str]] = []
        self._zero_ns: int | None = None
        self._zero_sides: tuple[frozenset[int], frozenset[int]] | None = None
        self._grounded_since_ns: int | None = None
        self._rested_ns = 0
        self._is_second = False
        #: The last code of the pulse before, whether a line of the switch has moved since, and
        #: whether that pulse went behind a probe.
        self._code_before = 0
        self._has_moved = False
        self._is_led = False
        self._steps = 0
        #: What flows goes into the node alone: no rest follows.
        self._is_unloaded = False
        #: Relays: when each stage was last told to open.
        self._opened_ns: dict[int, int] = {}

    def take(self, record: Record) -> None:
        t_ns = record["t_ns"]
        if t_ns < self._t_ns:
            self._broken(t_ns, f"a time before the one before it ({self._t_ns} ns)")
        self._t_ns = t_ns
        self._judge_unexcused(t_ns)
        if record["bus"] == "gpio":
            self._gpio(t_ns, record["line"], record["value"])
        elif record["bus"] == "spi":
            self._spi(t_ns, record)

    def end(self) -> None:
        """After the last event: nothing may be left on."""
        self._judge_unexcused(self._t_ns + 2 * STOP_WITHIN_NS)
        if self._dac.code:
            self._broken(self._t_ns, f"the DAC is left at code {self._dac.code}")
        if self._wires.is_relays:
            if self._wires.latch != 0:
                self._broken(self._t_ns, "relays are left closed, or nobody knows")
        elif self._wires.level.get("BL") != 0 or self._wires.latch != 0:
            self._broken(self._t_ns, "a selection is left: BL, or a bit of the latch, or unknown")

    def _broken(self, t_ns: int, what: str) -> None:
        self.found.append(f"{t_ns} ns: {what}")

    # --- lines -------------------------------------------------------------------------------

    def _gpio(self, t_ns: int, line: int, value: int) -> None:
        name, wires = self._wires.name(line), self._wires
        latch_before = wires.latch
        if not wires.change(t_ns, line, value):
            return
        self._has_moved |= name in SWITCH_LINES
        if self._dac.code and name in SWITCH_LINES:
            self._unexcused.append((t_ns, f"{name} changes while the DAC is at {self._dac.code}"))
        if name in ("POL", "BL", "HV"):
            self._check_blanking(t_ns)
        if wires.is_relays and name == "LE" and value:
            self._check_relays(t_ns, latch_before)
        self._follow_rest(t_ns)

    def _judge_unexcused(self, t_ns: int) -> None:
        if not self._unexcused or t_ns - self._unexcused[0][0] <= STOP_WITHIN_NS:
            return
        if not self._has_stopped():
            for at_ns, what in self._unexcused:
                self._broken(at_ns, what)
        self._unexcused.clear()

    def _has_stopped(self) -> bool:
        level = self._wires.level
        only_outputs = all(what.startswith(("POL ", "BL ")) for _, what in self._unexcused)
        is_dark = level.get("BL") == 0 and level.get("POL") == 1
        return only_outputs and is_dark and level.get("HV", 0) == 0

    def _check_blanking(self, t_ns: int) -> None:
        level = self._wires.level
        is_supplied = "HV" not in self.facts.lines or level.get("HV") == 1
        if is_supplied and level.get("BL") == 0 and level.get("POL") == 0:
            self._broken(t_ns, "BL 0 with POL 0 while the supply is on: all outputs high")

    # --- relays ------------------------------------------------------------------------------

    def _check_relays(self, t_ns: int, before: int | None) -> None:
        word = self._wires.latch
        if word is None:
            self._broken(t_ns, "relays copied from stages that nobody has written")
            return
        if any(word >> 2 * electrode & 3 == 3 for electrode in range(self.facts.outputs)):
            self._broken(t_ns, "both relays of one electrode are on")
        was = before if before is not None else 0
        if word & ~was and was & ~word:
            self._broken(t_ns, "relays make and break at once")
        self._check_break(t_ns, word & ~was)
        for stage in range(self._wires.chain.stages):
            if was & ~word & 1 << stage:
                self._opened_ns[stage] = t_ns
        if before is None:
            self._opened_ns = dict.fromkeys(range(self._wires.chain.stages), t_ns)

    def _check_break(self, t_ns: int, closing: int) -> None:
        latest_ns = max(self._opened_ns.values(), default=-self.facts.toff_ns)
        if closing and t_ns - latest_ns < self.facts.toff_ns:
            self._broken(
                t_ns,
                f"relays make {(t_ns - latest_ns) / 1e3:.0f} us after others were told to open",
            )

    # --- messages ----------------------------------------------------------------------------

    def _spi(self, t_ns: int, record: Record) -> None:
        event = record["event"]
        if event == "message":
            self._words = 0
            if record["transfers"] >= TRANSFERS_THAT_WRAP:
                self._broken(t_ns, f"a message of {record['transfers']} transfers")
        elif event == "transfer":
            self._transfer(t_ns, record)
        elif event == "cs":
            self._chip_select(t_ns, record["active"])
        elif event == "done":
            self._done(t_ns)

    def _transfer(self, t_ns: int, record: Record) -> None:
        sent = bytes.fromhex(record["tx"])
        self._dac.transfer(sent)
        self._is_cs_held = record["cs_change"]
        if record["delay_us"] > LONGEST_DELAY_US:
            self._broken(t_ns, f"a delay of {record['delay_us']} us")
        if not sent:
            return
        self._words += 1
        if len(sent) != 2:
            self._broken(t_ns, f"a word of {8 * len(sent)} bits")
        elif sent[0] >> 6:
            self._broken(t_ns, f"a word with control bits {sent[0] >> 6:02b}")
        elif sent[1] & 3:
            self._broken(t_ns, "a word with bits where none belong")

    def _chip_select(self, t_ns: int, is_active: bool) -> None:
        code_before = self._dac.code
        if not is_active and self._dac.bits not in (0, DAC_BITS):
            self._broken(t_ns, f"{self._dac.bits} bits in one chip select")
        self._dac.chip_select(is_active)
        code = self._dac.code
        if code and not code_before:
            self._steps = 0
            self._check_start(t_ns)
        elif code and code != code_before:
            self._steps += 1
            if code < code_before or self._steps > 1:
                self._broken(t_ns, f"current steps from code {code_before} to {code}")
        elif self._is_unloaded:
            self._is_unloaded = bool(code)
        elif code_before and not code:
            self._code_before, self._has_moved = code_before, False
            self._zero_ns, self._zero_sides = t_ns, self._wires.sides()
            self._rested_ns, self._grounded_since_ns = 0, None
            self._follow_rest(t_ns)

    def _done(self, t_ns: int) -> None:
        if self._words > MOST_DATA_TRANSFERS:
            self._broken(t_ns, f"a message of {self._words} transfers with data")
        if self._dac.code:
            self._broken(t_ns, f"a message that ends with the DAC at {self._dac.code}")
        if self._is_cs_held:
            self._broken(t_ns, "a message that keeps the chip select")

    # --- pulses ------------------------------------------------------------------------------

    def _check_start(self, t_ns: int) -> None:
        sides = self._wires.sides()
        if sides is None:
            self._broken(t_ns, "current into outputs of which nobody knows the state")
            return
        source, ground = sides
        is_weak = self.facts.current_ua(self._dac.code) <= self.facts.probe_ua
        self._is_unloaded = is_weak and (
            self._wires.is_isolated(t_ns) or self._wires.has_none_selected()
        )
        if self._is_unloaded:
            return
        if not source or not ground or min(len(source), len(ground)) != 1:
            self._broken(t_ns, "current with no output alone on its side")
        if self._wires.level.get("LE") == 1:
            self._broken(t_ns, "current with the latch open")
        if self._wires.is_relays and t_ns - self._wires.copied_ns < self.facts.ton_ns:
            self._broken(t_ns, "current before the relays have closed")
        self._check_rest(t_ns, source, ground)

    def _check_rest(self, t_ns: int, source: frozenset[int], ground: frozenset[int]) -> None:
        """Before each pulse, but for the second phase of a biphasic one: the other way round; and
        for one that follows a probe, or one as weak, once, with nothing moved.
        """
        self._follow_rest(t_ns)
        if self._zero_ns is None or self._rested_ns >= self._rest_ns:
            self._is_second = self._is_led = False
            return
        is_weak = self.facts.current_ua(self._code_before) <= self.facts.probe_ua
        if is_weak and not (self._has_moved or self._is_led):
            self._is_led = True
            return
        self._is_second = self._zero_sides == (ground, source) and not self._is_second
        if not self._is_second:
            self._broken(t_ns, f"a pulse after a rest of {self._rested_ns / 1e3:.0f} us")

    def _follow_rest(self, t_ns: int) -> None:
        """How long all were on ground together (relays: stayed closed) since the last pulse."""
        if self._zero_ns is None or self._dac.code:
            return
        is_resting = (
            self._wires.sides() == self._zero_sides
            if self._wires.is_relays
            else self._wires.level.get("BL") == 0 and self._wires.level.get("POL") == 1
        )
        since_ns = self._grounded_since_ns
        if since_ns is not None:
            self._rested_ns = max(self._rested_ns, t_ns - since_ns)
        if not is_resting:
            self._grounded_since_ns = None
        elif since_ns is None:
            self._grounded_since_ns = t_ns


def violations(trace: Iterable[Record], rest_us: float) -> list[str]:
    """Every rule that a whole trace breaks, as sentences; `rest_us` is the board's."""
    records = iter(trace)
    rules = Rules(Facts.of(next(records)), rest_us)
    for record in records:
        rules.take(record)
    rules.end()
    return rules.found
