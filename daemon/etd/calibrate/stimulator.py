"""Presents one current on one electrode: through a display, over the protocol.

Owns: the frame of a presentation, waiting until telemetry reports it fired as requested, the soft
start before the first one, and the stop. Must not know: procedures, questions, sockets. Time comes
through a clock port.

What was fired otherwise than requested (soft start, a re-contact, the ledger) does not count as a
presentation: it is repeated, and after several times given up, with the reason. It is never more
than requested. The soft start rises with what is fired, so repetitions that came further than the
one before do not count as tries. A presentation that the net charge of those before it does not let
stand waits for that to leak away, with a time constant of a second: a person is asked at one
current several times.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Protocol

from etd.calibrate.conditions import Conditions
from etd.calibrate.trial import Stopped, TooStrongSaid
from etd.client.options import FrameOptions
from etd.protocol.errors import EtdError, Refused
from etd.protocol.felt import FeltFacts
from etd.protocol.frame import Ring
from etd.protocol.messages import FrameReply, Halt, Scan, StateReport
from etd_hal.ports import Clock

if TYPE_CHECKING:
    from typing_extensions import Unpack

_MS = 1_000_000
#: Far below any threshold, and how far the soft start rises by pulses that weak.
_PRIME_UA, _PRIMED_UA = 50, 500
_OPEN_WITHIN_NS = 30_000 * _MS
_FIRED_WITHIN_NS = 5_000 * _MS
#: A lease lasts for a second, and a busy machine may take half of it for one message.
_KEEP_NS = 200 * _MS
_TRIES = 8
#: The whole array may be slower, and take longer.
_MOST_TTL_MS = 1_000
_AGAIN_NS = 150 * _MS
#: Five time constants: what is refused after that is too much by itself.
_LEAKED_WITHIN_NS, _LEAKS_S = 5_000 * _MS, 0.1
#: Reports come 30 times a second; the stop is polled more often.
_LOOK_S = 0.02
#: The current fired may be one step of the source lower than requested.
_STEPS_UA = 12
#: Clamps that may pass by themselves: the presentation is repeated. What a return carries is not
#: known after a second of silence.
_PASSING = ("soft_start", "recontact", "contact_open", "return_cap")
_LOWERED = ": too strong was said since it was armed; disarm, and begin again"
#: Widths are accurate to a microsecond or two; stabilizers change them by steps of five.
_WIDER_US = 4.0


@dataclass(frozen=True, slots=True)
class Delivered:
    """One presentation: the commanded current, the skin's resistance as stabilizers use it, and
    when its frame was sent, on the stimulator's clock. The first pulse follows within milliseconds.
    `rate_hz`: at which the daemon shows it; None: that of the conditions.
    """

    electrode: int
    current_ua: int
    resistance_ohm: int | None
    begun_ns: int = 0
    rate_hz: float | None = None


class NotDelivered(EtdError):
    """A current could not be presented as requested. Fields: electrode, why, fired_ua (the most of
    what was fired in its place).
    """

    def __init__(self, electrode: int, why: str, fired_ua: int) -> None:
        self.electrode = electrode
        self.why = why
        self.fired_ua = fired_ua
        super().__init__(f"electrode {electrode} could not be presented: {why}")


class Shows(Protocol):
    """The methods used of a display; `etd.Display` has them."""

    def show_current(
        self, current_ua: Sequence[int], **options: Unpack[FrameOptions]
    ) -> FrameReply: ...

    def keep(self) -> None: ...

    def stop(self) -> None: ...


class Reports(Protocol):
    """Telemetry of the topics `scan`, `halt` and `state`; `etd.Telemetry` is one."""

    def receive(self, timeout_s: float | None = 0.0) -> tuple[object, object] | None: ...


class Stimulator:
    """On an armed display. Its methods raise: Refused (`halted`, ...), DaemonGone, Stopped."""

    def __init__(
        self,
        display: Shows,
        reports: Reports,
        clock: Clock,
        conditions: Conditions,
        wants_stop: Callable[[], bool],
        on_report: Callable[[object], None] = lambda _: None,
    ) -> None:
        self._display = display
        self._reports = reports
        self._clock = clock
        self._conditions = conditions
        self._wants_stop = wants_stop
        self._on_report = on_report
        self._ceiling_ua = 0
        #: How many words of the strength the daemon has had since arming; None: not told yet.
        self._words: int | None = None
        self._kept_ns = 0
        self._lasted_s = conditions.presentation_s

    def open(self) -> None:
        """Pass through the soft start's beginning with a current that is not felt. Presentations
        that rise by less than half a milliampere are not clamped by it afterwards.
        """
        until_ns = self._clock.now_ns() + _OPEN_WITHIN_NS
        current_ua = min(_PRIME_UA, self._conditions.cap_ua)
        while self._ceiling_ua < min(_PRIMED_UA, self._conditions.cap_ua):
            if self._clock.now_ns() > until_ns:
                raise Refused(
                    "wrong_state", f"the soft start is at {self._ceiling_ua} uA and does not rise"
                )
            self._show({0: current_ua}, pulses=None, ttl_ms=500)
            self.pause(0.2)
        self._show({}, pulses=None, ttl_ms=500)

    def present(self, electrode: int, current_ua: int) -> Delivered:
        """Present the conditions' pulses of this current, once. Raises: NotDelivered."""
        delivered = self._repeated({electrode: current_ua})
        self._lasted_s = (self._clock.now_ns() - delivered.begun_ns) / 1e9
        return delivered

    def present_whole(self, currents_ua: Mapping[int, int]) -> Delivered:
        """The conditions' pulses of all these at once, slower where they do not fit in. What is
        delivered is that of the highest current. Raises: NotDelivered.
        """
        return self._repeated(currents_ua)

    def _repeated(self, currents_ua: Mapping[int, int]) -> Delivered:
        """Until it was fired as requested."""
        why, tries, most_ua = "", 0, 0
        while tries < _TRIES:
            delivered, why, fired_ua = self._presented(currents_ua)
            if delivered is not None:
                return delivered
            if fired_ua <= most_ua + _STEPS_UA:
                tries += 1
            most_ua = max(most_ua, fired_ua)
            self._sleep(_AGAIN_NS)
        raise NotDelivered(_highest(currents_ua), why, most_ua)

    def silence(self, electrode: int) -> Delivered:
        """Nothing, for as long as the last presentation took: its length must not tell."""
        begun_ns = self._clock.now_ns()
        self.pause(self._lasted_s)
        return Delivered(electrode, 0, None, begun_ns)

    def pause(self, seconds: float) -> None:
        """Wait; the lease is renewed, and a halt or a stop raises."""
        until_ns = self._clock.now_ns() + int(seconds * 1e9)
        while (left_ns := until_ns - self._clock.now_ns()) > 0:
            self._keep_if_due()
            self._look()
            self._sleep(min(left_ns, int(_LOOK_S * 1e9)))
        # What was said until now is not about what comes next.
        self._look()

    def keep(self) -> None:
        """Renew the lease, and process telemetry."""
        self._keep()
        self._look()

    def _keep(self) -> None:
        self._kept_ns = self._clock.now_ns()
        self._display.keep()

    def _keep_if_due(self) -> None:
        """Without processing telemetry."""
        if self._clock.now_ns() - self._kept_ns >= _KEEP_NS:
            self._keep()

    def stop(self) -> None:
        """Stop stimulation at once; the daemon is HALTED."""
        self._display.stop()

    # --- one presentation --------------------------------------------------------------------

    def _presented(self, currents_ua: Mapping[int, int]) -> tuple[Delivered | None, str, int]:
        """The presentation, or why there was none; and the highest current of its last pulses, in
        uA.
        """
        conditions, is_whole = self._conditions, len(currents_ua) > 1
        self._look()
        ttl_ms = _MOST_TTL_MS if is_whole else int(conditions.presentation_s * 1000) + 250
        reply, begun_ns = self._shown_once_leaked(currents_ua, ttl_ms, allow_slower=is_whole)
        seq = reply.seq
        until_ns = self._clock.now_ns() + _FIRED_WITHIN_NS
        trouble: set[str] = set()
        while self._clock.now_ns() < until_ns:
            self._keep_if_due()
            scan = self._receive(_LOOK_S)
            if not isinstance(scan, Scan) or all(shown.seq != seq for shown in scan.shown):
                continue
            trouble |= {one.reason for one in scan.clamped if one.electrode in currents_ua}
            trouble |= {one.reason for one in scan.not_fired if one.electrode in currents_ua}
            if any(shown.seq == seq and shown.ended for shown in scan.shown):
                fired_ua = max(scan.fired.current_ua[electrode] for electrode in currents_ua)
                delivered, why = self._settled(scan, currents_ua, trouble, begun_ns)
                if delivered is not None:
                    delivered = replace(delivered, rate_hz=reply.rate_hz)
                return delivered, why, fired_ua
        return None, "nothing was fired", 0

    def _settled(
        self, scan: Scan, currents_ua: Mapping[int, int], trouble: set[str], begun_ns: int
    ) -> tuple[Delivered | None, str]:
        whys = (
            self._departed(scan, electrode, current_ua, trouble)
            for electrode, current_ua in currents_ua.items()
        )
        if why := next((why for why in whys if why), ""):
            return None, why
        highest = _highest(currents_ua)
        fired = scan.fired
        return (
            Delivered(highest, fired.current_ua[highest], fired.skin_ohm[highest], begun_ns),
            "",
        )

    def _departed(self, scan: Scan, electrode: int, current_ua: int, trouble: set[str]) -> str:
        """In what it was not fired as requested; empty if it was."""
        fired_ua = scan.fired.current_ua[electrode]
        if trouble:
            return f"{' and '.join(sorted(trouble))}: {fired_ua} of {current_ua} uA"
        fired_us, asked_us = scan.fired.width_us[electrode], self._conditions.width_us
        if abs(fired_us - asked_us) >= _WIDER_US:
            return (
                f"pulses of {fired_us:g} us were fired instead of {asked_us} us: a stabilizer of"
                " the body site changes the width"
            )
        if not current_ua - _STEPS_UA <= fired_ua <= current_ua:
            return f"{fired_ua} uA were fired instead of {current_ua} uA"
        return ""

    def _shown_once_leaked(
        self, currents_ua: Mapping[int, int], ttl_ms: int, *, allow_slower: bool
    ) -> tuple[FrameReply, int]:
        """The reply, and when the frame was sent: when the net charge lets it stand."""
        until_ns = self._clock.now_ns() + _LEAKED_WITHIN_NS
        while True:
            begun_ns = self._clock.now_ns()
            try:
                pulses = self._conditions.pulses
                reply = self._show(currents_ua, pulses, ttl_ms, allow_slower=allow_slower)
            except Refused as refused:
                if refused.code != "over_maximum" or begun_ns >= until_ns:
                    raise
                self.pause(_LEAKS_S)
            else:
                return reply, begun_ns

    def _show(
        self,
        currents_ua: Mapping[int, int],
        pulses: int | None,
        ttl_ms: int,
        *,
        allow_slower: bool = False,
    ) -> FrameReply:
        conditions, returns = self._conditions, self._conditions.returns
        each_ua = [currents_ua.get(electrode, 0) for electrode in range(conditions.electrodes)]
        options: FrameOptions = {
            "width_us": conditions.width_us,
            "polarity": conditions.polarity,
            "rate_hz": conditions.rate_hz,
            "returns": {"ring_mm": returns.ring_mm} if isinstance(returns, Ring) else returns,
            "ttl_ms": ttl_ms,
        }
        if allow_slower:
            options["allow_slower"] = True
        if pulses is not None:
            options["pulses"] = pulses
        reply = self._display.show_current(each_ua, **options)
        for clamp in reply.clamped:
            if clamp.reason not in _PASSING:
                what_to_do = _LOWERED if clamp.reason == "felt" else ""
                raise Refused(
                    "over_limit",
                    f"electrode {clamp.electrode} would get {clamp.allowed_ua} of"
                    f" {clamp.wanted_ua} uA ({clamp.reason} of electrode {clamp.limited_by})"
                    f"{what_to_do}",
                    clamp.electrode,
                )
        return reply

    # --- telemetry ---------------------------------------------------------------------------

    def _look(self) -> None:
        """Process all reports that have arrived, and whether the person asked to stop."""
        while self._receive(0.0) is not None:
            pass

    def _receive(self, timeout_s: float) -> object | None:
        """The next report within the time. Raises: Refused (`halted`), Stopped."""
        if self._wants_stop():
            self._display.stop()
            raise Stopped("stop")
        item = self._reports.receive(timeout_s)
        if item is None:
            return None
        report = item[1]
        self._on_report(report)
        if isinstance(report, Halt):
            raise Refused("halted", f"halted by {report.cause} ({report.source}: {report.detail})")
        if isinstance(report, StateReport):
            self._heed_words(report.felt)
        if isinstance(report, Scan):
            self._ceiling_ua = report.ceiling_ua
        return report

    def _heed_words(self, felt: FeltFacts | None) -> None:
        """Whatever a question is answered with: *too strong* by the wearer's button, by a monitor
        or a program is of what is presented here. Raises: Stopped.
        """
        words = 0 if felt is None else felt.answers
        is_new = self._words is not None and words > self._words
        self._words = words
        if is_new and felt is not None and felt.answer == "too_strong":
            self._display.stop()
            raise TooStrongSaid

    def _sleep(self, duration_ns: int) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns() + duration_ns)


def _highest(currents_ua: Mapping[int, int]) -> int:
    """The electrode of the highest current."""
    return max(currents_ua, key=currents_ua.__getitem__)
