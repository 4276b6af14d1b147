"""What the source's node reads in each message of a visit, judged before the next selection.

Owns: which bound holds for which message, and the sentence of the halt. Must not know: how a
message is sent and booked, what the bounds are made of (`etd_hal.source_rules`), skin.

| message | before it, at code 0 | in it |
|---|---|---|
| the first of a visit | at most `RESTED_V` | at most current x leak, and what stood there before |
| a pulse after its probe | at most what the probe came to, where that is more | the same |
| a second phase | at most `RESTED_V`: what skin holds of the first one lowers the node | the same |

A current that stands at code 0 is so told in the first pulse that it passes through skin which
resists enough. Where relays connect, what is there before a pulse is charge of the skin: they have
just closed over a node that was at rest (`Board.connect`). There it is not judged.
"""

from __future__ import annotations

from math import inf

from etd.firing import ReadyPulse
from etd.protocol.errors import BoardFault
from etd_hal.board import Board
from etd_hal.phase import PulseResult
from etd_hal.source_rules import RESTED_V


class NodeCheck:
    """See the module. Called after each message: a few comparisons."""

    def __init__(self, board: Board) -> None:
        self._rules = board.rules
        self._rested_v = inf if board.switch.can_choose_returns else RESTED_V
        #: What the message before came to, and its way: skin may still hold that.
        self._held_v = 0.0
        self._was_anodic = True

    def check(self, ready: ReadyPulse, is_anodic: bool, result: PulseResult) -> None:
        """Raises: BoardFault, with what was read and what it may be."""
        baseline_v = result.baseline_v
        # An entry without a pulse of its own goes on with a visit that its probe has begun.
        is_led = not ready.entry.pulses and is_anodic == self._was_anodic
        allowed_v = max(self._rested_v, self._held_v) if is_led else self._rested_v
        if baseline_v > allowed_v:
            raise BoardFault(
                f"node before the pulse at electrode {ready.entry.electrode}, with the DAC at zero",
                f"{baseline_v:.1f} V",
                f"at most {allowed_v:.1f} V: a current flows that was not commanded",
            )
        node_v = max(result.voltage_v, result.early_v)
        most_v = self._rules.most_v(ready.pulse.commanded_ua, baseline_v)
        if node_v > most_v:
            raise BoardFault(
                f"node in the pulse of {ready.pulse.commanded_ua} uA at electrode"
                f" {ready.entry.electrode}",
                f"{node_v:.1f} V",
                f"at most {most_v:.1f} V, current x leak: more current flows than was commanded",
            )
        self._held_v, self._was_anodic = node_v + self._rules.noise_v, is_anodic
