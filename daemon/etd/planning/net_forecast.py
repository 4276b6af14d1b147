"""How long a frame can be shown before the net charge of an electrode passes its bound.

Owns: the direct current that the pulses of a frame leave on each electrode, the time that follows
from what is left there already, and the refusal of a frame that asks for longer. Must not know: how
net charge is counted pulse by pulse (`safety/net_charge.py`), how contacts are measured, sockets,
clocks.

All ways in which returns may share are looked at; the one by which the bound comes first counts.

With a leak of time constant tau, a current I that begins at a charge q0 leaves
I tau + (q0 - I tau) exp(-t / tau); a single pulse may stand above that by its own charge.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final, NamedTuple

from etd.planning.headroom import Headroom
from etd.planning.scheduled_pulse import ScheduledPulse
from etd.protocol.errors import Refused
from etd.protocol.frame import DEFAULT_TTL_MS, Frame
from etd.protocol.outcome import Shortfall
from etd.safety.net_charge import LEAK_NS, NetState, others_s, parts_of

_LEAK_S = LEAK_NS / 1e9
_PC_PER_UC = 1e6
#: What a ttl is longer, a frame is there for a client that hangs: most are replaced long before.
#: One that is not is told of, and no pulse of it passes the bound (`safety/ledger.py`).
_JUDGED_S = DEFAULT_TTL_MS / 1e3
#: Of the rate that lasts as returns conduct now: the one that is named. They are measured as it is
#: shown, and the accounts of the ways to share draw apart (docs/decisions/0077).
_LASTS_ALSO = 0.8


class NetLimit(NamedTuple):
    """Why a frame cannot be shown for ever: the electrode that reaches its bound first and when,
    the rate of all pulses that lasts (0: none does, or it is not known), and for how long the frame
    is shown as it says itself.
    """

    electrode: int
    after_s: float
    lasting_hz: float
    shown_s: float


class NetForecast:
    def __init__(self, electrodes: int, bound_pc: int, headroom: Headroom) -> None:
        self._count: Final = electrodes
        self._bound_pc: Final = bound_pc
        self._headroom: Final = headroom

    def limit(
        self,
        frame: Frame,
        schedule: Sequence[ScheduledPulse],
        slowdown: float,
        pulses: int,
        states: Sequence[NetState],
        *,
        are_returns_known: bool = True,
    ) -> NetLimit | None:
        """None: these pulses can be shown for ever, whatever is left there already. `slowdown`: the
        part of their rates that the scan has; `pulses` in a burst. `states`: what is on each
        electrode now; empty: nothing.
        """
        if not schedule:
            return None
        states = states or (NetState([1.0] * self._count, [0.0] * self._count),)
        visits_hz = [scheduled.rate_hz * slowdown * pulses for scheduled in schedule]
        found = [self._first(schedule, visits_hz, state) for state in states]
        firsts = [it for it in found if it is not None]
        if not firsts:
            return None
        after_s, electrode = min(firsts)
        lasting_hz = 0.0
        # What one electrode gives comes back to no other one as more than that.
        if are_returns_known or len(schedule) == 1:
            lasting_hz = min(self._lasting_hz(schedule, pulses, state) for state in states)
        slowest_hz = min(scheduled.rate_hz for scheduled in schedule)
        shown_s = min(frame.ttl_ms / 1e3, _JUDGED_S)
        if frame.pulses is not None:
            shown_s = min(shown_s, frame.pulses / (slowest_hz * slowdown * pulses))
        # A rate for all of them, by which none is raised.
        named_hz = math.floor(10 * min(_LASTS_ALSO * lasting_hz, slowest_hz)) / 10
        return NetLimit(electrode, after_s, named_hz, shown_s)

    def told(self, limit: NetLimit | None, not_balanced: str = "") -> tuple[Shortfall, ...]:
        """What its reply says of a frame that cannot be shown for ever. `not_balanced`: why it has
        not both phases, where the body site would have it so.

        Raises: Refused (`over_maximum`), where it would pass the bound as soon as in 200 ms.
        """
        if limit is None:
            return ()
        if limit.after_s < limit.shown_s:
            raise self._refusal(limit, not_balanced)
        told = Shortfall(
            electrode=limit.electrode,
            reason="net_charge",
            lasts_ms=int(limit.after_s * 1e3),
            lasting_hz=limit.lasting_hz or None,
        )
        return (told,)

    def _first(
        self, schedule: Sequence[ScheduledPulse], visits_hz: Sequence[float], state: NetState
    ) -> tuple[float, int] | None:
        """When the first electrode reaches the bound, and which; None: never."""
        once_pc, left_pc = [0.0] * self._count, state.left_pc
        currents = self._currents(schedule, visits_hz, state, once_pc)
        scan_s = 1.0 / max(visits_hz)
        found: tuple[float, int] | None = None
        for electrode, current in enumerate(currents):
            if not current:
                continue
            # What one scan may leave at most counts beside the mean.
            scan_pc = max(once_pc[electrode], abs(current) * scan_s)
            after_s = self._after_s(current, scan_pc, left_pc[electrode])
            if after_s is not None and (found is None or after_s < found[0]):
                found = after_s, electrode
        return found

    def _lasting_hz(
        self, schedule: Sequence[ScheduledPulse], pulses: int, state: NetState
    ) -> float:
        """The rate of all at which no electrode reaches the bound, whatever is left there now."""
        once_pc = [0.0] * self._count
        per_hz_pc = self._currents(schedule, [float(pulses)] * len(schedule), state, once_pc)
        lasting_hz = math.inf
        for once, current in zip(once_pc, per_hz_pc, strict=True):
            if current:
                room_pc = self._bound_pc - max(once, abs(current) / pulses)
                lasting_hz = min(lasting_hz, max(0.0, room_pc) / (abs(current) * _LEAK_S))
        return lasting_hz

    def _currents(
        self,
        schedule: Sequence[ScheduledPulse],
        visits_hz: Sequence[float],
        state: NetState,
        once_pc: list[float],
    ) -> list[float]:
        """Of each electrode, in pC a second: its own, less its part of what it carries back. Puts
        what one of its visits leaves into `once_pc`.
        """
        conducts_s = state.conducts_s
        beside_s = conducts_s if state.beside_s is None else state.beside_s
        found, pool, beside = [0.0] * self._count, 0.0, others_s(conducts_s, beside_s)
        for scheduled, hz in zip(schedule, visits_hz, strict=True):
            electrode, net_pc = scheduled.electrode, self._net_pc(scheduled)
            each = net_pc * hz
            once_pc[electrode] = abs(net_pc)
            found[electrode] += each
            if scheduled.returns is None:
                # All carry the pool back, and it its own part, which is put back here.
                part = each / beside[electrode]
                found[electrode] += conducts_s[electrode] * part
                pool += part
            else:
                parts = parts_of(scheduled.returns, conducts_s, is_whole=state.is_named_whole)
                for other, part in zip(scheduled.returns, parts, strict=True):
                    found[other] -= each * part
        return [current - own_s * pool for current, own_s in zip(found, conducts_s, strict=True)]

    def _net_pc(self, scheduled: ScheduledPulse) -> int:
        """Of one visit, never with more than the electrode's cap. A probe goes the way of the first
        phase.
        """
        net_pc = scheduled.probe_pc
        if len(scheduled.phases) == 1:
            current_ua = min(scheduled.current_ua, scheduled.path.cap_ua)
            net_pc += self._headroom.phase_pc(current_ua, scheduled.width_us)
        return net_pc if scheduled.phases[0] else -net_pc

    def _after_s(self, current: float, scan_pc: float, left_pc: float) -> float | None:
        """When the bound is reached; None: never."""
        if current < 0:
            current, left_pc = -current, -left_pc
        room_pc, end_pc = self._bound_pc - scan_pc, current * _LEAK_S
        if end_pc <= room_pc:
            return None
        if left_pc >= room_pc:
            return 0.0
        return _LEAK_S * math.log((end_pc - left_pc) / (end_pc - room_pc))

    def _refusal(self, limit: NetLimit, not_balanced: str) -> Refused:
        slower = f" rate_hz={limit.lasting_hz:.1f} lasts," if limit.lasting_hz > 0.0 else ""
        balance = not_balanced and f". It cannot be balanced here: {not_balanced}"
        return Refused(
            "over_maximum",
            f"electrode {limit.electrode}: after {limit.after_s * 1e3:.0f} ms of this frame more"
            f" than {self._bound_pc / _PC_PER_UC:g} uC of net charge would be on it, the maximum"
            " here: pulses of one polarity leave direct current, which leaks away in seconds where"
            ' it is silent. polarity="biphasic" leaves none (at twice the mean current; levels with'
            " a calibration for it);"
            f"{slower} or show it for less long, elsewhere in between (what moves can go on), or"
            f" with lower currents{balance}",
            limit.electrode,
        )
