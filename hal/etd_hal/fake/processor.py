"""What computing costs the modelled machine, between two calls of its ports and clock.

Owns: which stage of a pulse the engine has computed when it calls a port or a clock, the cost of
each stage for stepped time, and the processor time measured for live time. Must not know: how time
moves (`clock.py`), engines, schedules.

The engine is not told. The calls of a pulse come in an order of their own: the machine's clock is
read by the poll, the outputs are un-blanked, the message is sent, the outputs are blanked, the next
selection is shifted in. So each call says what was computed before it. Reading the machine's clock
again with no other call between is planning: a frame's age is looked at, and each step asks whether
a poll is due.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Literal, Protocol

#: The calls of ports and clocks. `host`: the machine's clock is read; `now`: the board's; `switch`:
#: lines of the switch are set; `line`: any other line is set or read.
Call = Literal["host", "now", "sleep", "doze", "switch", "line", "message", "prepare", "mark"]

Stage = Literal["idle_poll", "plan_step", "clear", "fire", "judge", "report"]

#: What each stage takes on a PC, in ns; a machine's `slowness` multiplies it. `clear`: the poll
#: before a pulse, the request, limits, ledger, booking. `fire`: still valid, judged by the guard.
#: `judge`: after the message, until the outputs are blanked. `report`: what the pulse told, until
#: the next selection is shifted in. `plan_step`: a frame is read, so many of its pulses are planned
#: (`etd.planning.plan`), or their sum is.
STAGES_NS: Mapping[Stage, int] = {
    "idle_poll": 5_000,
    "plan_step": 10_000,
    "clear": 21_500,
    "fire": 5_000,
    "judge": 1_200,
    "report": 20_300,
}
#: The same where the engine is compiled.
COMPILED_STAGES_NS: Mapping[Stage, int] = {
    "idle_poll": 3_600,
    "plan_step": 4_500,
    "clear": 7_700,
    "fire": 2_400,
    "judge": 700,
    "report": 5_800,
}

#: What a pulse has come to, by its calls.
State = Literal["idle", "shifted", "cleared", "connected", "ready", "sent", "discharged"]
_Move = tuple[tuple[Stage, ...], State]

#: By the state and the call: what was computed before the call, and the state after it. A probe
#: before its pulse leaves the electrodes connected: then all up to the pulse comes at once.
_MOVES: Mapping[tuple[State, Call], _Move] = {
    ("idle", "host"): (("idle_poll",), "idle"),
    ("shifted", "host"): (("clear",), "cleared"),
    ("cleared", "switch"): ((), "connected"),
    ("connected", "host"): (("fire",), "ready"),
    ("connected", "message"): (("fire",), "sent"),
    ("ready", "switch"): ((), "shifted"),
    ("sent", "switch"): (("judge",), "discharged"),
    ("sent", "host"): (("judge", "clear", "fire"), "ready"),
    ("discharged", "switch"): (("report",), "shifted"),
    ("discharged", "host"): (("report", "clear"), "cleared"),
}
#: The same whatever the state.
_ANYWHERE: Mapping[Call, _Move] = {
    "message": ((), "sent"),
    "mark": ((), "shifted"),
    "doze": ((), "idle"),
}


class Processor(Protocol):
    """What a fake clock asks before each call of the thread that plays messages."""

    def cost_ns(self, call: Call) -> int:
        """What has been computed since the call before takes so long."""
        ...

    def resume(self) -> None:
        """The call is over: from here on the caller computes."""
        ...


class Stages:
    """Tells which stages lie behind each call."""

    def __init__(self) -> None:
        self.state: State = "idle"
        #: The call before, readings of the board's clock left out.
        self._before: Call = "doze"

    def behind(self, call: Call) -> tuple[Stage, ...]:
        """The stages that were computed between the call before and this one."""
        if call == "now":
            return ()
        before, self._before = self._before, call
        if before == call == "host":
            return ("plan_step",)
        move = _MOVES.get((self.state, call)) or _ANYWHERE.get(call)
        if move is None:
            return ()
        self.state = move[1]
        return move[0]


class StagedTime:
    """A cost for each stage, the same in every run: of interpreted code, or of compiled."""

    def __init__(self, slowness: float, stages_ns: Mapping[Stage, int] = STAGES_NS) -> None:
        self._stages = Stages()
        self._stages_ns = stages_ns
        self.slowness = slowness

    def cost_ns(self, call: Call) -> int:
        behind = self._stages.behind(call)
        return round(self.slowness * sum(self._stages_ns[stage] for stage in behind))

    def resume(self) -> None:
        """A stage costs the same whenever it begins."""


class ThreadTime:
    """What the thread really computes, times a factor: for live time. Between a message and the
    readings of the clock before and after it nearly all of that is the fake's own, and costs
    nothing: it would be the message's excess, and its scatter.
    """

    def __init__(self, slowness: float, thread_time_ns: Callable[[], int]) -> None:
        self._slowness = slowness
        self._thread_time_ns = thread_time_ns
        self._since_ns = thread_time_ns()
        self._before: Call = "now"

    def cost_ns(self, call: Call) -> int:
        before, self._before = self._before, call
        if "message" in (before, call):
            return 0
        return round(self._slowness * (self._thread_time_ns() - self._since_ns))

    def resume(self) -> None:
        self._since_ns = self._thread_time_ns()
