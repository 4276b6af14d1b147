"""From SAFE to a live board, for `arm` and `measure`: stopper alive, the supply noted and on, rail
up, contact measured.

Owns: the checks before, the waiting, and the probe scan. Must not know: sockets, frames, what is
done with a live board. The engine's loop steps it, so that a stop is noticed in between.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from etd.engine.stopper import StopperLiveness
from etd.planning.schedule import DuePulse
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.errors import Refused
from etd.sensing.sensors import RailSensor
from etd_hal.board import Board
from etd_hal.ports import Clock

Goal = Literal["arm", "measure"]
#: How long an unmonitored rail gets to settle.
UNWATCHED_SETTLE_NS = 500_000_000
#: The sensor thread reads every few tens of milliseconds; a stuck bus blocks for a second.
FIRST_READING_NS = 1_500_000_000
#: A slow memory card takes a second for a small file.
NOTED_WITHIN_NS = 5_000_000_000
#: In rise times of the monitor's rail.
_RISE_TIMES_ALLOWED = 2


@dataclass(frozen=True, slots=True)
class Readiness:
    """What keeps the board from being powered; None and empty tuples where nothing does."""

    unaccepted_guards: tuple[str, ...]
    open_stops: tuple[str, ...]
    #: Why the wearer's stop is to be tried first, with what to do.
    untried_stop: str | None
    #: Why the last self-test does not allow arming.
    untested: str | None = None


def lasting_refusal(unaccepted_guards: tuple[str, ...], untested: str | None) -> str | None:
    """Why arming is refused until the configuration, the board or its self-test has changed, with
    what to do.
    """
    if unaccepted_guards:
        return (
            f"the board has no {', '.join(unaccepted_guards)}: accept each by name in"
            " accept_absent_guards of the configuration, or wire it"
        )
    return untested


def check_ready(ready: Readiness) -> None:
    """Checked before the supply goes on. Raises: Refused (`arm_failed`), with what to do."""
    lasting = lasting_refusal(ready.unaccepted_guards, ready.untested)
    if lasting is not None:
        raise Refused("arm_failed", lasting)
    if ready.open_stops:
        raise Refused("arm_failed", f"{' and '.join(ready.open_stops)} open: release or plug it in")
    if ready.untried_stop is not None:
        raise Refused("arm_failed", ready.untried_stop)


class PowerUp:
    """One power-up; made when it begins, dropped when it ends."""

    def __init__(
        self,
        goal: Goal,
        ref: int,
        board: Board,
        rail: RailSensor,
        stopper: StopperLiveness,
        probes: Sequence[ScheduledPulse],
        clock: Clock,
    ) -> None:
        self.goal: Goal = goal
        self.ref = ref
        self._board = board
        self._is_measuring = False
        self._at = 0
        self._rail = rail
        self._stopper = stopper
        self._probes = probes
        self._clock = clock
        #: Whether the supply was switched on, where the board has a line for it.
        self.is_on = False
        self._begun_ns = clock.now_ns()

    def begin(self) -> None:
        """Begin, after the stopper was woken. The supply goes on once the stopper checks, and once
        a monitored rail has a reading.

        Raises: Refused, if the stopper or the rail's sensor has a problem; BusError.
        """
        self._stopper.begin(self._begun_ns)
        self._await_watch(self._begun_ns)

    def _await_watch(self, now_ns: int) -> None:
        """The supply waits for its watches: the stopper's first check, its note of the supply, and
        the sensor thread's first reading.
        """
        if not self._stopper.has_looked:
            if self._stopper.problem is not None:
                raise Refused("arm_failed", self._stopper.problem)
        elif not self._stopper.has_noted:
            if now_ns - self._begun_ns > NOTED_WITHIN_NS:
                raise Refused("arm_failed", "the disk takes seconds for a note of the supply")
        elif self._stopper.note_problem is not None:
            raise Refused("arm_failed", self._stopper.note_problem)
        elif not self._rail.is_there or self._rail.rail_v(now_ns) is not None:
            self._board.supply_on()
            self.is_on = True
            self._begun_ns = now_ns
        elif self._rail.problem or now_ns - self._begun_ns > FIRST_READING_NS:
            why = self._rail.problem or "no reading yet"
            raise Refused("arm_failed", f"the rail is not known ({why}): check I2C")

    def is_rail_there(self, now_ns: int) -> bool:
        """Whether the rail is up; from then on contact is measured.

        Raises: Refused (`arm_failed`) when the rail is too high, or does not come up; BusError.
        """
        self._is_measuring = self._is_rail_there(now_ns)
        return self._is_measuring

    def _is_rail_there(self, now_ns: int) -> bool:
        if not self.is_on:
            self._await_watch(now_ns)
            return False
        monitor = self._board.file.guards.rail_monitor
        waited_ns = now_ns - self._begun_ns
        if monitor == "absent":
            is_switched = self._board.file.guards.hv_enable != "absent"
            return not is_switched or waited_ns >= UNWATCHED_SETTLE_NS
        rail_v = self._rail.rail_v(now_ns)
        if rail_v is not None and rail_v > monitor.high_v:
            raise Refused("arm_failed", f"the rail is at {rail_v:.0f} V, above {monitor.high_v} V")
        if rail_v is not None and rail_v >= monitor.low_v:
            return True
        if waited_ns > _RISE_TIMES_ALLOWED * monitor.rise_ms * 1_000_000:
            found = "unknown" if rail_v is None else f"at {rail_v:.0f} V"
            raise Refused(
                "arm_failed",
                f"the rail is {found} after {waited_ns // 1_000_000} ms, it should be"
                f" {monitor.low_v} to {monitor.high_v} V: check the supply",
            )
        return False

    # --- the measurement of contact ----------------------------------------------------------

    @property
    def is_measuring(self) -> bool:
        """The rail is up, and not every electrode has had its probe."""
        return self._is_measuring and self._at < len(self._probes)

    def next_due(self) -> DuePulse | None:
        """The next probe, until every electrode has had its own."""
        if not self.is_measuring:
            return None
        return DuePulse(self._probes[self._at], "measurement", rewrites_chain=self._at == 0)

    def has(self, due: DuePulse) -> bool:
        """Whether this is the probe that is due; a probe of an earlier power-up is not."""
        return self.is_measuring and due.scheduled is self._probes[self._at]

    def advance(self) -> None:
        """The probe that was due is over, fired or not."""
        self._at += 1
