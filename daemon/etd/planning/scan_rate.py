"""How fast a frame can be shown: the electrodes that share a burst, and the duration of a scan.

Owns: the time of a round of pulses, the rate that follows, what part of the time binds it, and the
refusal of a rate that does not fit. Must not know: currents, limits, how a pulse is made, time of
day, hardware calls.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

from etd.planning.duty import BELOW_BRAKE, shortest_period_us
from etd.planning.headroom import PlanRules
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.errors import Refused, TimePart
from etd.protocol.frame import Frame
from etd.protocol.outcome import Shortfall
from etd.stabilize.bursts import groups
from etd_hal.cost import Cost, CostModel

#: A plan uses at most this part of its period. The rest is for a message that is laid out in memory
#: anew: 0.1 ms on a Raspberry Pi 4, once for each current and width.
RESERVE = 0.995

#: Places in the schedule, group by group.
Groups = tuple[tuple[int, ...], ...]


class _Fastest(NamedTuple):
    """A scan at the highest rate, in ms, by what takes its time."""

    wire_ms: float
    rest_ms: float
    #: Computing that no rest hides, the pauses in which the kernel must not find it busy, and what
    #: scans have come late by.
    processor_ms: float

    @property
    def rate_hz(self) -> float:
        return 1e3 / sum(self)

    @property
    def bound_by(self) -> TimePart:
        """The part that takes most of it."""
        parts: tuple[TimePart, ...] = ("wire", "rest", "processor")
        return max(zip(self, parts, strict=True))[1]

    def __str__(self) -> str:
        return (
            f"a scan takes {sum(self):.1f} ms, the wire {self.wire_ms:.1f}, rests"
            f" {self.rest_ms:.1f}, the processor {self.processor_ms:.1f}"
        )


class Counted(NamedTuple):
    """A schedule's pulses by what they cost: nothing of it depends on how strong they are."""

    wanted_hz: float
    groups: Groups
    #: By group, how many pulses cost alike.
    rounds: tuple[Mapping[tuple[int, int, int, int], int], ...]
    #: What messages and calls take, with the widths that the frame itself has.
    wire_us: float


class ScanRate:
    """The scan rate for a site's bursts on a board. An electrode has `pulses` in a burst,
    `interval_us` apart; without bursts these are 1 and 0.
    """

    def __init__(self, rules: PlanRules, cost: CostModel) -> None:
        self._cost = cost
        self._silent_hz = rules.site.defaults.rate_hz
        self._bursts = rules.site.stabilize.bursts
        self.pulses = 1 if self._bursts is None else self._bursts.pulses
        self.interval_us = 0.0 if self._bursts is None else self._bursts.interval_us

    @property
    def has_bursts(self) -> bool:
        """Electrodes share a burst by what pulses cost now; without bursts all are one group."""
        return self._bursts is not None

    def counted(self, schedule: Sequence[ScheduledPulse]) -> Counted:
        """Raises: Refused, if a burst is too fast."""
        grouped = self._grouped(schedule)
        is_again = self._bursts is not None
        rounds = tuple(
            self._counted([schedule[place] for place in group], is_again)
            for group in grouped
            if group
        )
        wanted_hz = max((scheduled.rate_hz for scheduled in schedule), default=self._silent_hz)
        return Counted(wanted_hz, grouped, rounds, self.wire_us(schedule))

    def _grouped(self, schedule: Sequence[ScheduledPulse]) -> Groups:
        """The places whose pulses alternate in a burst. Raises: Refused, if a burst is too fast."""
        places = tuple(range(len(schedule)))
        if self._bursts is None or not places:
            return (places,)
        found = groups(
            places,
            self.interval_us,
            lambda group: (
                self._round(self._counted([schedule[place] for place in group], True)).slot_us
            ),
        )
        if found is None:
            raise Refused(
                "board_cannot",
                f"one pulse every {self.interval_us:.0f} us is faster than this board can fire an"
                " electrode: lower stabilize.bursts.rate_hz of the body site, or the widths",
            )
        return found

    def rate(
        self, frame: Frame, schedule: Sequence[ScheduledPulse], counted: Counted
    ) -> tuple[float, tuple[Shortfall, ...]]:
        """The requested rate, or the rate that fits if the frame says `allow_slower`.

        Raises: Refused (`too_fast`).
        """
        wanted_hz = counted.wanted_hz
        if not schedule:
            return wanted_hz, ()
        fastest = self._fastest(counted)
        achievable_hz, bound_by = fastest.rate_hz, fastest.bound_by
        if wanted_hz <= achievable_hz:
            return wanted_hz, ()
        if not frame.allow_slower:
            has_room = any(scheduled.bounds.width_us > scheduled.width_us for scheduled in schedule)
            room = ", the widest pulses of the stabilizers included" if has_room else ""
            raise Refused(
                "too_fast",
                f"{len(schedule)} electrodes at {wanted_hz:g} Hz do not fit: at most"
                f" {achievable_hz:.1f} Hz, as {fastest}{room} (fire fewer at once, ask for a lower"
                " rate_hz, or send allow_slower: true to be slowed down)",
                achievable_hz=achievable_hz,
                bound_by=bound_by,
            )
        slowed = Shortfall(electrode=None, reason="rate", rate_hz=achievable_hz, bound_by=bound_by)
        return achievable_hz, (slowed,)

    def _fastest(self, counted: Counted) -> _Fastest:
        computing = self._cost.computing
        wire_us, rest_us, processor_us = self._cost.rewrite_us(), 0.0, computing.between_us
        busy_us = wire_us + processor_us
        for kinds in counted.rounds:
            once = self._round(kinds)
            # Between the pulses of a burst its interval is waited for.
            rest_us += once.rest_us + (self.pulses - 1) * self.interval_us
            wire_us += once.wire_us
            processor_us += once.processor_us
            busy_us += once.busy_us * self.pulses
        slots_us = wire_us + rest_us + processor_us
        fraction = computing.busy_fraction - BELOW_BRAKE
        period_us = shortest_period_us(slots_us, slots_us - busy_us, self._cost.idle_us, fraction)
        scan_us = computing.stretch * period_us / RESERVE
        return _Fastest(wire_us / 1e3, rest_us / 1e3, (scan_us - wire_us - rest_us) / 1e3)

    def _counted(
        self, schedule: Sequence[ScheduledPulse], is_again: bool
    ) -> Mapping[tuple[int, int, int, int], int]:
        """One pulse of each, by what it costs; where they repeat, the step from the last to the
        first is included (after a scan the rewriting of the chain is that step).
        """
        found: Counter[tuple[int, int, int, int]] = Counter()
        before = schedule[-1].selection.output
        for scheduled in schedule:
            output = scheduled.selection.output
            clocks = self._cost.clocks(before, output) if is_again or output > before else 0
            width_us = scheduled.bounds.width_us + scheduled.bounds.prepulse_us
            found[width_us, len(scheduled.phases), clocks, _probe_us(scheduled)] += 1
            before = output
        return found

    def _round(self, kinds: Mapping[tuple[int, int, int, int], int]) -> Cost:
        """The cost of these pulses. Most of a frame are alike, and each kind is looked at once."""
        costs = [(self._cost.visit(*kind), count) for kind, count in kinds.items()]
        return Cost(*(sum(cost[part] * count for cost, count in costs) for part in range(4)))

    @property
    def chain_us(self) -> float:
        """The calls that rewrite the chain, which a measurement of contact begins with."""
        return self._cost.chain_us()

    def wire_us(self, schedule: Sequence[ScheduledPulse]) -> float:
        """What messages and calls of a scan take, with the widths that the frame itself has."""
        if not schedule:
            return 0.0
        found: Counter[tuple[int, int, int]] = Counter()
        for scheduled in schedule:
            width_us = scheduled.width_us + scheduled.bounds.prepulse_us
            found[width_us, len(scheduled.phases), _probe_us(scheduled)] += 1
        # In the order of the chain: all shifts together lead from the first to the last.
        clocks = schedule[-1].selection.output - schedule[0].selection.output
        pulses_us = sum(self._cost.wire_us(*kind) * count for kind, count in found.items())
        return pulses_us + self._cost.shift_us(clocks)


def _probe_us(scheduled: ScheduledPulse) -> int:
    return 0 if scheduled.probe is None else scheduled.probe.width_us
