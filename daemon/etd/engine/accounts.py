"""The accounts of frames that ask for one: what became of each, electrode by electrode.

Owns: what gathers while such a frame is shown, and the last accounts of a lease, which outlast it
until another is opened. Must not know: who asks, sockets, limits. A frame that asks for none costs
nothing here.
"""

from __future__ import annotations

from collections import Counter, deque
from typing import Final

from etd.planning.plan import Plan
from etd.protocol.outcome import Account, Clamp, FrameEnd, Shortfall

#: A presentation of a minute, renewed three times a second, has 180.
MOST_KEPT = 256


class _Pulses:
    """Of one electrode."""

    __slots__ = ("count", "delivered_ua", "least_ua", "most_ua")

    def __init__(self, commanded_ua: int) -> None:
        self.count = 0
        self.least_ua = commanded_ua
        self.most_ua = commanded_ua
        #: The sum.
        self.delivered_ua = 0


class OpenAccount:
    """Of the frame that is shown; see `Account`."""

    def __init__(self, plan: Plan, begun_ns: int, trigger_ns: int | None = None) -> None:
        self._plan: Final = plan
        self._begun_ns: Final = begun_ns
        self._trigger_ns: Final = trigger_ns
        self._first_ns: int | None = None
        self._last_ns: int | None = None
        self._rate_hz = plan.rate_hz
        self._fired: dict[int, _Pulses] = {}
        self._clamped: dict[tuple[int, str], Clamp] = {}
        self._not_fired: Counter[tuple[int | None, str]] = Counter()

    def fired(self, electrode: int, begun_ns: int, commanded_ua: int, delivered_ua: int) -> None:
        if self._first_ns is None:
            self._first_ns = begun_ns
        self._last_ns = begun_ns
        pulses = self._fired.get(electrode)
        if pulses is None:
            pulses = self._fired[electrode] = _Pulses(commanded_ua)
        pulses.count += 1
        pulses.delivered_ua += delivered_ua
        if commanded_ua < pulses.least_ua:
            pulses.least_ua = commanded_ua
        elif commanded_ua > pulses.most_ua:
            pulses.most_ua = commanded_ua

    def clamped(self, clamp: Clamp) -> None:
        key = clamp.electrode, clamp.reason
        before = self._clamped.get(key)
        if before is None or clamp.allowed_ua < before.allowed_ua:
            self._clamped[key] = clamp

    def not_fired(self, electrode: int | None, reason: str) -> None:
        self._not_fired[electrode, reason] += 1

    def slowed(self, rate_hz: float) -> None:
        self._rate_hz = rate_hz

    def closed(self, ended: FrameEnd, ended_ns: int, electrodes: int) -> Account:
        frame, wanted_ua = self._plan.frame, [0] * electrodes
        for scheduled in self._plan.schedule:
            wanted_ua[scheduled.electrode] = scheduled.request.current_ua
        columns = [[0] * electrodes for _ in range(4)]
        for electrode, pulses in self._fired.items():
            mean_ua = round(pulses.delivered_ua / pulses.count)
            values = pulses.count, pulses.least_ua, pulses.most_ua, mean_ua
            for column, value in zip(columns, values, strict=True):
                column[electrode] = value
        count, least_ua, most_ua, delivered_ua = map(tuple, columns)
        return Account(
            seq=frame.seq,
            tag=frame.tag,
            ended=ended,
            rate_hz=self._rate_hz,
            begun_ns=self._begun_ns,
            first_ns=self._first_ns,
            last_ns=self._last_ns,
            pulses=count,
            wanted_ua=tuple(wanted_ua),
            least_ua=least_ua,
            most_ua=most_ua,
            delivered_ua=delivered_ua,
            clamped=tuple(self._clamped.values()),
            not_fired=self._shortfalls(),
            calibrated_hz=self._plan.calibrated_hz,
            trigger_ns=self._trigger_ns,
            # A fake's clock may have stood still since it was over.
            ended_ns=max(ended_ns, self._last_ns or self._begun_ns),
        )

    def _shortfalls(self) -> tuple[Shortfall, ...]:
        found = [
            Shortfall(electrode=electrode, reason=reason, pulses=pulses)  # type: ignore[arg-type]
            for (electrode, reason), pulses in self._not_fired.items()
        ]
        if self._rate_hz < self._plan.rate_hz:
            slowed = Shortfall(
                electrode=None, reason="rate", rate_hz=self._rate_hz, bound_by="processor"
            )
            found.append(slowed)
        # How long its net charge would let it last is no pulse that was not fired.
        planned = [
            told
            for told in self._plan.slowed
            if told.rate_hz is not None or told.reason == "balanced"
        ]
        return (*planned, *found)


class Accounts:
    """Of one lease: a new one numbers its frames anew."""

    def __init__(self) -> None:
        #: The token of the lease whose frames they are of: the one that stands, or the last one.
        self.lease: str | None = None
        self._closed: deque[Account] = deque(maxlen=MOST_KEPT)
        #: (ref, seq) of those who ask for the account of a frame that stands.
        self.awaited: list[tuple[int, int]] = []

    def keep(self, account: Account) -> None:
        self._closed.append(account)

    def of(self, seq: int) -> Account | None:
        """The newest first: that is the one asked for."""
        for account in reversed(self._closed):
            if account.seq == seq:
                return account
        return None

    def begin(self, lease: str) -> None:
        """Another lease was opened."""
        self.lease = lease
        self._closed.clear()
