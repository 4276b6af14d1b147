"""The rule of visits: which messages are one visit, and how often an output may have one.

Owns: the state of the visit under way, and the count of visits of each output. Must not know:
bytes, levels, limits of persons; how a selection was made. Time comes in.

A visit is a message with current, or up to three: a probe, the pulse after it, and the reverse
phase of a pulse. Visits are counted, so a message that continues a visit must follow closely:

| state      | message                       | next state | counts                       |
|------------|-------------------------------|------------|------------------------------|
| any        | a probe, the outputs blanked  | `idle`     | a visit                      |
| any        | a probe, none selected        | `idle`     | nothing                      |
| `idle`     | one within the probe's bounds | `probed`   | a visit                      |
| `idle`     | any other                     | `fired`    | a visit                      |
| `probed`   | the same way, nothing moved   | `fired`    | its charge, with the probe's |
| `probed`   | the reverse, flipped, in time | `idle`     | nothing                      |
| `fired`    | the reverse, flipped, in time | `idle`     | nothing                      |
| not `idle` | any other                     | as `idle`  | a visit                      |

*The same way*: the same outputs on source and on ground. *The reverse*: they have changed places.
*Flipped*: the switch was, once, and nothing else moved what is connected. A message that is refused
changes nothing; the safe state leads to `idle`. A visit counts for every output that is alone on
its side: with a single output on each side either may be the stimulated one.

*In time*: within a flip and a millisecond after the first phase has ended, all at worst.
Half-bridges flip by one call, a change of POL; relays open, settle, close and settle, and two words
are shifted. The millisecond covers what else may lie between the two messages: the engine's
computation, and the lateness that a message may have before the stopper acts. Later than that, or
when the outputs were released in between, the reverse counts as a pulse of its own. A pulse after
its probe has no such bound: deciding between the two may take any time, and waiting gains no more
than one probe per visit.
"""

from __future__ import annotations

from collections import defaultdict, deque
from typing import Literal

from etd_hal.boardfile import BoardFile, MachineFile, Relays
from etd_hal.errors import GuardRefusal
from etd_hal.switch_shadow import Approval, SwitchShadow

VisitState = Literal["idle", "probed", "fired"]

_SECOND_NS = 1_000_000_000
_BETWEEN_PHASES_US = 1_000
#: The machine file has a time for each call that sets lines; computation adds as much again.
_WORK_BESIDES_CALLS = 2


def longest_flip_ns(board: BoardFile, machine: MachineFile) -> int:
    """From the worst end of a first phase's transfers until its second phase must have begun."""
    calls, settling_us = 1, 0
    if isinstance(board.switch, Relays):
        # Two words through the chain, the clock up and down for each stage; two copies.
        stages = board.switch.bits_per_electrode * board.switch.outputs
        calls = 2 * 2 * stages + 4
        settling_us = board.switch.toff_us + board.switch.ton_us
    calls_us = calls * machine.gpio_call_us * _WORK_BESIDES_CALLS
    between_us = machine.message_us.high + settling_us + calls_us + _BETWEEN_PHASES_US
    return int(between_us * 1_000)


class VisitRule:
    """See the module. One per guard."""

    def __init__(self, rate_hz: int, flip_ns: int, switch: SwitchShadow) -> None:
        self._rate_hz = rate_hz
        self._flip_ns = flip_ns
        self._switch = switch
        self.state: VisitState = "idle"
        #: By output, as a bit set: when its visits of the last second began.
        self._begun_ns: defaultdict[int, deque[int]] = defaultdict(deque)
        # The last message, in `probed` and `fired`:
        self._source = self._ground = 0
        self._moves = self._switched = 0
        self._charge_nc = 0.0
        self._reverse_until_ns = 0

    def reset(self) -> None:
        """After the safe state: no visit is under way. The counts stay."""
        self.state = "idle"

    def probe_nc(self, approval: Approval) -> float:
        """The worst charge of the probe that this pulse would follow; 0 if there is none."""
        if self.state == "probed" and self._follows_probe(approval):
            return self._charge_nc
        return 0.0

    def take(
        self,
        approval: Approval,
        longest_us: float,
        longest_nc: float,
        is_probe: bool,
        now_ns: int,
    ) -> None:
        """Take a message that is about to be sent, with its worst duration and charge.

        Raises: GuardRefusal, if it begins one visit too many.
        """
        if approval.is_blanked or not approval.source:
            if approval.source:
                self._begin(approval, now_ns)
            self.state = "idle"
            return
        if self.state != "idle" and self._is_reverse(approval, now_ns):
            self.state = "idle"
            return
        if self.state == "probed" and self._follows_probe(approval):
            self.state = "fired"
        else:
            self._begin(approval, now_ns)
            self.state = "probed" if is_probe else "fired"
        self._source, self._ground = approval.source, approval.ground
        self._moves, self._switched = self._switch.edge_count, self._switch.switched
        self._charge_nc = longest_nc
        self._reverse_until_ns = now_ns + int(longest_us * 1_000) + self._flip_ns

    def _follows_probe(self, approval: Approval) -> bool:
        """The same outputs the same way, and nothing has moved: they were not released in
        between.
        """
        return (
            approval.source == self._source
            and approval.ground == self._ground
            and not approval.is_blanked
            and self._switch.edge_count == self._moves
        )

    def _is_reverse(self, approval: Approval, now_ns: int) -> bool:
        return (
            approval.source == self._ground
            and approval.ground == self._source
            and self._switch.switched - self._switched == self._switch.switched_by_flip
            and now_ns <= self._reverse_until_ns
        )

    def _begin(self, approval: Approval, now_ns: int) -> None:
        """Count a visit for each output that is alone; for none of them if one is at its limit."""
        alone, other = approval.source, approval.ground
        if alone.bit_count() != 1:
            alone, other = other, alone
            if alone.bit_count() != 1:
                raise GuardRefusal(
                    "visit", "no output alone on its side", "one against its returns"
                )
        begun_ns = self._with_room(alone, now_ns)
        if other.bit_count() == 1:
            self._with_room(other, now_ns).append(now_ns)
        begun_ns.append(now_ns)

    def _with_room(self, output: int, now_ns: int) -> deque[int]:
        """When the visits of the last second began. Raises: GuardRefusal, if no more may begin."""
        begun_ns = self._begun_ns[output]
        while begun_ns and begun_ns[0] <= now_ns - _SECOND_NS:
            begun_ns.popleft()
        if len(begun_ns) >= self._rate_hz:
            raise GuardRefusal(
                "rate", f"{len(begun_ns) + 1} pulses in a second", f"{self._rate_hz}"
            )
        return begun_ns
