"""What the engine computes in each stage of a pulse, on ports that cost nothing.

Owns: measuring it between the calls by which the fake tells the stages apart
(`etd_hal.fake.processor`). Must not know: what the figures are used for.
"""

from __future__ import annotations

import statistics
from collections import defaultdict
from collections.abc import Mapping

from bench.processor import (
    FIRST_SEQ,
    RATE_HZ,
    WARM_UP,
    FreeClock,
    FreeGpio,
    FreeSpi,
    armed,
    play_one,
)
from etd.client import clock as real_clock
from etd.stabilize.settings import NO_STABILIZERS, Settings
from etd_hal.fake.processor import Call, Stage, Stages, State
from etd_hal.ports import Changes, Message, Wait

#: After each frame, so that their median is of polls with nothing to do.
_IDLE_POLLS = 20

#: What is computed in each state until the next call.
_STAGE_IN: Mapping[State, Stage] = {
    "idle": "idle_poll",
    "shifted": "clear",
    "cleared": "clear",
    "connected": "fire",
    "ready": "fire",
    "sent": "judge",
    "discharged": "report",
}


class StageWatch:
    """The durations of each stage, one for each time that it was gone through."""

    def __init__(self) -> None:
        self._stages = Stages()
        self._since_ns = real_clock.now_ns()
        self._taken_ns = 0
        self.durations_ns: defaultdict[Stage, list[int]] = defaultdict(list)

    def begin(self, call: Call) -> None:
        self._taken_ns += real_clock.now_ns() - self._since_ns
        state = self._stages.state
        is_planning = self._stages.behind(call) == ("plan_step",)
        stage = "plan_step" if is_planning else _STAGE_IN[state]
        if is_planning or stage != _STAGE_IN[self._stages.state] or call == "doze":
            self.durations_ns[stage].append(self._taken_ns)
            self._taken_ns = 0

    def end(self) -> None:
        self._since_ns = real_clock.now_ns()


class WatchedClock(FreeClock):
    def __init__(self, watch: StageWatch) -> None:
        super().__init__()
        self._watch = watch
        self.host = _WatchedHost(self, watch)

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._watch.begin("sleep")
        super().sleep_until_ns(deadline_ns)
        self._watch.end()

    def doze_until_ns(self, deadline_ns: int) -> None:
        self._watch.begin("doze")
        FreeClock.sleep_until_ns(self, deadline_ns)
        self._watch.end()

    def doze_until_woken(self, deadline_ns: int, wait: Wait) -> None:
        self._watch.begin("doze")
        if not wait(0.0):
            FreeClock.sleep_until_ns(self, deadline_ns)
        self._watch.end()


class _WatchedHost:
    def __init__(self, clock: FreeClock, watch: StageWatch) -> None:
        self._clock = clock
        self._watch = watch

    def now_ns(self) -> int:
        self._watch.begin("host")
        self._watch.end()
        return self._clock.t_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._clock.sleep_until_ns(deadline_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        self._clock.sleep_until_ns(deadline_ns)


class WatchedSpi(FreeSpi):
    def __init__(self, clock: FreeClock, gpio: FreeGpio, watch: StageWatch) -> None:
        super().__init__(clock, gpio)
        self._watch = watch

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        self._watch.begin("message")
        read = super().transfer(message)
        self._watch.end()
        return read


class WatchedGpio(FreeGpio):
    def __init__(self, watch: StageWatch) -> None:
        super().__init__()
        self._watch = watch

    def set(self, changes: Changes) -> None:
        self._watch.begin("switch")
        super().set(changes)
        self._watch.end()


def measure(scans: int, stabilize: Settings = NO_STABILIZERS) -> dict[Stage, float]:
    """The median of each stage in us."""
    watch = StageWatch()
    clock = WatchedClock(watch)
    gpio = WatchedGpio(watch)
    spi = WatchedSpi(clock, gpio, watch)
    engine, gateway, ends = armed(clock, spi, gpio, stabilize, clock.host)
    for seq in range(FIRST_SEQ, FIRST_SEQ + WARM_UP + scans):
        if seq == FIRST_SEQ + WARM_UP:
            watch.durations_ns.clear()
        play_one(engine, gateway, seq)
        for _ in range(_IDLE_POLLS):
            engine.step()
        clock.t_ns += int(1e9 / RATE_HZ)
    engine.supervisor.end()
    for channel in ends:
        channel.close()
    return {
        stage: statistics.median(durations_ns) / 1_000
        for stage, durations_ns in watch.durations_ns.items()
    }
