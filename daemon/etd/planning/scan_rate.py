"""How fast a frame can be shown: the electrodes that share a burst, and the duration of a scan.

Owns: the time of a round of pulses, the rate that follows, and the refusal of a rate that does not
fit. Must not know: currents, limits, how a pulse is made, time of day, hardware calls.
"""

from __future__ import annotations

from collections.abc import Sequence

from etd.planning.headroom import PlanRules
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.errors import Refused
from etd.protocol.frame import Frame
from etd.protocol.messages import Shortfall
from etd.stabilize.bursts import groups
from etd_hal.cost import Cost, CostModel

#: Places in the schedule, group by group.
Groups = tuple[tuple[int, ...], ...]

#: The loop may be busy for at most this part of any 100 ms; see `engine/cpu_budget.py`.
MAX_BUSY_FRACTION = 0.8

#: A plan uses at most this part of its period; the rest is for heartbeat and reports.
RESERVE = 0.98


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

    def grouped(self, schedule: Sequence[ScheduledPulse]) -> Groups:
        """The places whose pulses alternate in a burst. Raises: Refused, if a burst is too fast."""
        places = tuple(range(len(schedule)))
        if self._bursts is None or not places:
            return (places,)
        found = groups(
            places,
            self.interval_us,
            lambda group: self._round([schedule[place] for place in group], True).slot_us,
        )
        if found is None:
            raise Refused(
                "board_cannot",
                f"one pulse every {self.interval_us:.0f} us is faster than this board can fire an"
                " electrode: lower stabilize.bursts.rate_hz of the body site, or the widths",
            )
        return found

    def rate(
        self, frame: Frame, schedule: Sequence[ScheduledPulse], grouped: Groups
    ) -> tuple[float, tuple[Shortfall, ...]]:
        """The requested rate, or the rate that fits if the frame says `allow_slower`.

        Raises: Refused (`too_fast`).
        """
        if not schedule:
            return self._silent_hz, ()
        wanted_hz = max(scheduled.rate_hz for scheduled in schedule)
        achievable_hz = self._achievable_hz(schedule, grouped)
        if wanted_hz <= achievable_hz:
            return wanted_hz, ()
        if not frame.allow_slower:
            has_room = any(scheduled.bounds.width_us > scheduled.width_us for scheduled in schedule)
            room = ", the widest pulses of the stabilizers included" if has_room else ""
            raise Refused(
                "too_fast",
                f"{len(schedule)} electrodes at {wanted_hz:g} Hz do not fit: at most"
                f" {achievable_hz:.1f} Hz{room} (or send allow_slower: true to be slowed down)",
                achievable_hz=achievable_hz,
            )
        return achievable_hz, (Shortfall(electrode=None, reason="rate", rate_hz=achievable_hz),)

    def _achievable_hz(self, schedule: Sequence[ScheduledPulse], grouped: Groups) -> float:
        slots_us = busy_us = self._cost.rewrite_us()
        for group in grouped:
            once = self._round([schedule[place] for place in group], self._bursts is not None)
            slots_us += once.slot_us + (self.pulses - 1) * self.interval_us
            busy_us += once.busy_us * self.pulses
        return RESERVE * min(1e6 / slots_us, MAX_BUSY_FRACTION * 1e6 / busy_us)

    def _round(self, schedule: Sequence[ScheduledPulse], is_again: bool) -> Cost:
        """The cost of one pulse of each; where they repeat, the step from the last to the first is
        included (after a scan the rewriting of the chain is that step).
        """
        slot_us = busy_us = 0.0
        before = schedule[-1].selection.output
        for scheduled in schedule:
            output = scheduled.selection.output
            clocks = self._cost.clocks(before, output) if is_again or output > before else 0
            width_us = scheduled.bounds.width_us + scheduled.bounds.prepulse_us
            probe_us = 0 if scheduled.probe is None else scheduled.probe.width_us
            cost = self._cost.visit(width_us, len(scheduled.phases), clocks, probe_us)
            slot_us += cost.slot_us
            busy_us += cost.busy_us
            before = output
        return Cost(slot_us, busy_us)
