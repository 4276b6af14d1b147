"""SAFE, PROBE, ARMED, HALTED: what may follow what.

Owns: the state, the latched cause of a halt, whose stops stand in it, and the only ways between.
Must not know: hardware, sockets, clocks.

    SAFE ──probe──> PROBE ──arm──> ARMED
      ^───────safe────┴──────safe────┘          anything ──halt──> HALTED ──clear──> SAFE

The start is SAFE. A halt is left by `clear` alone: no restart of a client, reconnect or time-out
does it. The first cause stands; what follows from it is not a cause.
"""

from __future__ import annotations

from typing import Final

from etd.protocol.errors import Refused, halted
from etd.protocol.messages import Halt, State
from etd.safety.stop_askers import StopAskers


class StateMachine:
    def __init__(self) -> None:
        self.state: State = "SAFE"
        self.halt: Halt | None = None
        self.askers: Final = StopAskers()

    def need(self, *allowed: State) -> None:
        """Raises: Refused, naming the state and what to do."""
        if self.state in allowed:
            return
        self.check_not_halted()
        if allowed == ("ARMED",):
            raise Refused("not_armed", f"the state is {self.state}: arm first")
        raise Refused(
            "wrong_state", f"the state is {self.state}, it must be {' or '.join(allowed)}"
        )

    def check_not_halted(self) -> None:
        """Raises: Refused (`halted`), with the cause."""
        if self.halt is not None:
            raise halted(self.halt.cause, self.halt.source, self.halt.detail)

    def probe(self) -> None:
        self.need("SAFE")
        self.state = "PROBE"

    def arm(self) -> None:
        self.need("PROBE")
        self.state = "ARMED"

    def safe(self) -> None:
        """From PROBE and ARMED; in SAFE it changes nothing, in HALTED neither."""
        if self.state != "HALTED":
            self.state = "SAFE"

    def stop(self, halt: Halt) -> bool:
        """Latch. Returns False if it was halted already."""
        if self.state == "HALTED":
            return False
        self.state = "HALTED"
        self.halt = halt
        return True

    def clear(self) -> None:
        """Raises: Refused (`wrong_state`) when not halted."""
        if self.state != "HALTED":
            raise Refused("wrong_state", f"the state is {self.state}: there is nothing to clear")
        self.state = "SAFE"
        self.halt = None
        self.askers.lifted()
