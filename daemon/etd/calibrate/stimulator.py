"""How one current gets to one electrode and to a person: through a display, over the protocol.

Owns: the frame of a presentation, waiting until telemetry tells that it was fired as asked, the
opening before the first one, and the stop. Must not know: procedures, questions, sockets. Time
comes through a clock port.

What was fired otherwise than requested (soft start, a re-contact, the ledger) is no presentation:
it is shown again, and after a few times given up, with the reason. It never was more than asked. An
opening rises by what is fired, so a current far above all before takes some of them: those that
came further than the one before are not counted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Protocol, Unpack

from etd.calibrate.conditions import Conditions
from etd.calibrate.trial import Stopped
from etd.client.options import FrameOptions
from etd.protocol.errors import EtdError, Refused
from etd.protocol.frame import Ring
from etd.protocol.messages import FrameReply, Halt, Scan
from etd_hal.ports import Clock

_MS = 1_000_000
#: Far below anything that is felt, and as far as the soft start rises through anything so weak.
_PRIME_UA, _PRIMED_UA = 50, 500
_OPEN_WITHIN_NS = 30_000 * _MS
_FIRED_WITHIN_NS = 5_000 * _MS
#: A lease lasts for a second, and a machine that is busy may take half of it for one message.
_KEEP_NS = 200 * _MS
_TRIES = 8
_AGAIN_NS = 150 * _MS
#: A report comes 30 times a second; stop is looked for more often.
_LOOK_S = 0.02
#: The source has steps: what was fired may be one of them less than asked.
_STEPS_UA = 12
#: Widths are met to a microsecond or two; stabilizers change them by steps of five.
_WIDER_US = 4.0


@dataclass(frozen=True, slots=True)
class Delivered:
    """One presentation: what the source was told, and what the skin resisted its pulses, in the
    same way as stabilizers have it.
    """

    electrode: int
    current_ua: int
    resistance_ohm: int | None


class NotDelivered(EtdError):
    """It could not be presented as asked. Fields: electrode, why."""

    def __init__(self, electrode: int, why: str) -> None:
        self.electrode = electrode
        self.why = why
        super().__init__(f"electrode {electrode} could not be presented: {why}")


class Shows(Protocol):
    """What is needed of a display; `etd.Display` is one."""

    def show_current(
        self, current_ua: Sequence[int], **options: Unpack[FrameOptions]
    ) -> FrameReply: ...

    def keep(self) -> None: ...

    def stop(self) -> None: ...


class Reports(Protocol):
    """Telemetry with `scan` and `halt` in it; `etd.Telemetry` is one."""

    def receive(self, timeout_s: float | None = 0.0) -> tuple[object, object] | None: ...


class Stimulator:
    """On a display that is armed. Raises, from its methods: Refused (`halted`, `no_lease`, ...),
    DaemonGone, Stopped.
    """

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
        self._kept_ns = 0

    def open(self) -> None:
        """Let the opening begin with a current that nobody feels. What is presented from then on
        loses nothing to it, as long as it rises by steps of less than half a milliampere.
        """
        until_ns = self._clock.now_ns() + _OPEN_WITHIN_NS
        current_ua = min(_PRIME_UA, self._conditions.cap_ua)
        while self._ceiling_ua < min(_PRIMED_UA, self._conditions.cap_ua):
            if self._clock.now_ns() > until_ns:
                raise Refused(
                    "wrong_state", f"the soft start is at {self._ceiling_ua} uA and does not rise"
                )
            self._show(0, current_ua, pulses=None, ttl_ms=500)
            self.pause(0.2)
        self._show(0, 0, pulses=None, ttl_ms=500)

    def present(self, electrode: int, current_ua: int) -> Delivered:
        """So many pulses of this current on this electrode, once. Raises: NotDelivered."""
        why, tries, most_ua = "", 0, 0
        while tries < _TRIES:
            delivered, why, fired_ua = self._presented(electrode, current_ua)
            if delivered is not None:
                return delivered
            if fired_ua <= most_ua + _STEPS_UA:
                tries += 1
            most_ua = max(most_ua, fired_ua)
            self._sleep(_AGAIN_NS)
        raise NotDelivered(electrode, why)

    def pause(self, seconds: float) -> None:
        """Nothing is presented; the lease is kept, a halt and a stop are heard."""
        until_ns = self._clock.now_ns() + int(seconds * 1e9)
        while (left_ns := until_ns - self._clock.now_ns()) > 0:
            self._keep_if_due()
            self._look()
            self._sleep(min(left_ns, int(_LOOK_S * 1e9)))

    def keep(self) -> None:
        """Hold the lease, and hear what the daemon says."""
        self._keep()
        self._look()

    def _keep(self) -> None:
        self._kept_ns = self._clock.now_ns()
        self._display.keep()

    def _keep_if_due(self) -> None:
        """What is said meanwhile stays to be heard."""
        if self._clock.now_ns() - self._kept_ns >= _KEEP_NS:
            self._keep()

    def stop(self) -> None:
        """Silent at once; the daemon is halted then."""
        self._display.stop()

    # --- one presentation --------------------------------------------------------------------

    def _presented(self, electrode: int, current_ua: int) -> tuple[Delivered | None, str, int]:
        """What was delivered, or why nothing was; and the current of its last pulse in uA."""
        conditions = self._conditions
        self._look()
        ttl_ms = int(conditions.presentation_s * 1000) + 250
        seq = self._show(electrode, current_ua, conditions.pulses, ttl_ms)
        until_ns = self._clock.now_ns() + _FIRED_WITHIN_NS
        trouble: set[str] = set()
        while self._clock.now_ns() < until_ns:
            self._keep_if_due()
            scan = self._hear(_LOOK_S)
            if scan is None or all(shown.seq != seq for shown in scan.shown):
                continue
            trouble |= {clamp.reason for clamp in scan.clamped if clamp.electrode == electrode}
            trouble |= {
                shortfall.reason for shortfall in scan.not_fired if shortfall.electrode == electrode
            }
            if any(shown.seq == seq and shown.ended for shown in scan.shown):
                fired_ua = scan.fired.current_ua[electrode]
                return *self._settled(scan, electrode, current_ua, trouble), fired_ua
        return None, "nothing was fired", 0

    def _settled(
        self, scan: Scan, electrode: int, current_ua: int, trouble: set[str]
    ) -> tuple[Delivered | None, str]:
        fired_ua = scan.fired.current_ua[electrode]
        if trouble:
            return None, f"{' and '.join(sorted(trouble))}: {fired_ua} of {current_ua} uA"
        fired_us, asked_us = scan.fired.width_us[electrode], self._conditions.width_us
        if abs(fired_us - asked_us) >= _WIDER_US:
            return None, (
                f"pulses of {fired_us:g} us were fired, {asked_us} us were asked for: a stabilizer"
                " of the body site changes them"
            )
        if not current_ua - _STEPS_UA <= fired_ua <= current_ua:
            return None, f"{fired_ua} uA were fired, {current_ua} uA were asked for"
        return Delivered(electrode, fired_ua, scan.fired.skin_ohm[electrode]), ""

    def _show(self, electrode: int, current_ua: int, pulses: int | None, ttl_ms: int) -> int:
        conditions, returns = self._conditions, self._conditions.returns
        currents_ua = [0] * conditions.electrodes
        currents_ua[electrode] = current_ua
        options: FrameOptions = {
            "width_us": conditions.width_us,
            "polarity": conditions.polarity,
            "rate_hz": conditions.rate_hz,
            "returns": {"ring_mm": returns.ring_mm} if isinstance(returns, Ring) else returns,
            "ttl_ms": ttl_ms,
            "strict": True,
        }
        if pulses is not None:
            options["pulses"] = pulses
        return self._display.show_current(currents_ua, **options).seq

    # --- what the daemon says ----------------------------------------------------------------

    def _look(self) -> None:
        """Everything that has been said so far, and whether to stop."""
        while self._receive(0.0) is not None:
            pass

    def _hear(self, timeout_s: float) -> Scan | None:
        """The next report within the time, if it is of a scan."""
        report = self._receive(timeout_s)
        return report if isinstance(report, Scan) else None

    def _receive(self, timeout_s: float) -> object | None:
        """Raises: Refused (`halted`), Stopped."""
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
        if isinstance(report, Scan):
            self._ceiling_ua = report.ceiling_ua
        return report

    def _sleep(self, duration_ns: int) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns() + duration_ns)
