"""The engine's reports: every frame begun, every pulse fired, and why less was fired.

Owns: the scan report gathered between two messages, rate-capped without losing a frame; counters.
Must not know: sockets beyond the one function it sends with, hardware. Time comes in.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from etd.engine.accounts import Accounts, OpenAccount
from etd.protocol.errors import Refused
from etd.protocol.frame import Frame
from etd.protocol.link import Report
from etd.protocol.messages import (
    MODELLED_HZ,
    Contact,
    ContactState,
    Fired,
    Halt,
    Marked,
    Modelled,
    RefusedReport,
    Scan,
    Shown,
    StateReport,
)
from etd.protocol.outcome import Clamp, FrameEnd, Shortfall, Withheld
from etd.sensing.contact import ContactMap

#: Reports of scans come at most this often; no frame is lost by it.
_SCAN_PERIOD_NS = 1_000_000_000 // 30
_MODELLED_PERIOD_NS = 1_000_000_000 // MODELLED_HZ
STATE_PERIOD_NS = 1_000_000_000


@dataclass(slots=True)
class _ActiveFrame:
    frame: Frame
    begun_ns: int
    trigger_ns: int | None
    replaces: int | None
    first_ns: int | None = None
    last_ns: int | None = None
    ended_ns: int | None = None

    def shown(self) -> Shown:
        return Shown(
            seq=self.frame.seq,
            tag=self.frame.tag,
            begun_ns=self.begun_ns,
            first_ns=self.first_ns,
            last_ns=self.last_ns,
            ended=self.ended_ns is not None,
            ended_ns=self.ended_ns,
            trigger_ns=self.trigger_ns,
            replaces=self.replaces,
        )


@dataclass(slots=True)
class _Pending:
    """What has gathered since the last scan report."""

    ended: list[Shown] = field(default_factory=list)
    clamped: dict[tuple[int, str], Clamp] = field(default_factory=dict)
    not_fired: Counter[tuple[int | None, str]] = field(default_factory=Counter)
    scans: int = 0
    #: The rate to which this machine's lateness has lowered a frame's.
    slowed_hz: float | None = None


#: A pulse as reported: the columns of `Fired`, in their order.
Row = tuple[
    int,
    int,
    int,
    float,
    float | None,
    int | None,
    ContactState | None,
    int,
    int,
    int | None,
    float | None,
    float | None,
]
_COLUMNS = Fired.__struct_fields__


def _nothing(wanted_ua: int = 0, gain: float | None = None) -> Row:
    """Of an electrode that was not fired."""
    return wanted_ua, 0, 0, 0.0, None, None, None, 0, 0, None, None, gain


def _columns(rows: Sequence[Row]) -> Fired:
    """By electrode, a tuple for each column."""
    return Fired(**dict(zip(_COLUMNS, zip(*rows, strict=True), strict=True)))


def _shortfalls(pending: _Pending) -> tuple[Shortfall, ...]:
    not_fired = tuple(
        Shortfall(electrode=electrode, reason=reason, pulses=count)  # type: ignore[arg-type]
        for (electrode, reason), count in pending.not_fired.items()
    )
    if pending.slowed_hz is None:
        return not_fired
    slowed = Shortfall(
        electrode=None, reason="rate", rate_hz=pending.slowed_hz, bound_by="processor"
    )
    return (*not_fired, slowed)


class BodyFelt(Protocol):
    """Per electrode, the strongest sensation since the last call."""

    @property
    def felt(self) -> tuple[float, ...]: ...

    @property
    def pain(self) -> tuple[float, ...]: ...


#: Per electrode in kPa, at this time.
Pressure = Callable[[int], tuple[float | None, ...]]


class Reporter:
    """See the module. `send` returns False when the report was dropped."""

    def __init__(
        self, electrodes: int, send: Callable[[Report], bool], pressure: Pressure = lambda _: ()
    ) -> None:
        self._send = send
        self._pressure = pressure
        self._electrodes = electrodes
        self._active: _ActiveFrame | None = None
        #: The frame that the next one takes the place of.
        self._replaced: int | None = None
        #: Of the frame that is shown, if it asks for one; and of those before it.
        self._account: OpenAccount | None = None
        self.accounts = Accounts()
        self._pending = _Pending()
        #: Before then no scan report is due.
        self.due_ns = _SCAN_PERIOD_NS
        self._has_news = False
        self._modelled_ns = 0
        self._was_felt = False
        self.counters: Counter[str] = Counter()
        #: Of the frame that is shown.
        self.seq = -1
        #: The last pulse of each electrode in the frame that is shown.
        self._rows = [_nothing()] * electrodes

    # --- frames and scans --------------------------------------------------------------------

    def frame_begun(
        self,
        frame: Frame,
        now_ns: int,
        account: OpenAccount | None = None,
        trigger_ns: int | None = None,
    ) -> None:
        """Called at the start of the frame's first scan. `account`: if the frame asks for one.
        `trigger_ns`: the edge that begins it.
        """
        self.frame_ended("replaced", now_ns)
        # One that has waited for an edge was silent until then.
        replaces = self._replaced if trigger_ns is None else None
        self._active = _ActiveFrame(frame, now_ns, trigger_ns, replaces)
        self._replaced = None
        self.seq = frame.seq
        self._account = account
        self._rows = [_nothing()] * self._electrodes
        self._has_news = True
        self.counters["frames_shown"] += 1

    def frame_ended(self, why: FrameEnd, now_ns: int) -> None:
        if self._account is not None:
            self.accounts.keep(self._account.closed(why, now_ns, self._electrodes))
            self._account = None
        showing, self._active = self._active, None
        if showing is not None:
            self._replaced = showing.frame.seq if why == "replaced" else None
            # A fake's clock may have stood still since it was over.
            showing.ended_ns = max(now_ns, showing.last_ns or showing.begun_ns)
            self._pending.ended.append(showing.shown())
            self._has_news = True

    def scan_begun(self) -> None:
        self._pending.scans += 1
        self.counters["scans"] += 1
        self._has_news = True

    def fired(self, electrode: int, begun_ns: int, row: Row) -> None:
        showing = self._active
        if showing is not None:
            if showing.first_ns is None:
                showing.first_ns = begun_ns
            showing.last_ns = begun_ns
        if self._account is not None:
            self._account.fired(electrode, begun_ns, row[1], row[2])
        self._rows[electrode] = row
        self.counters["pulses"] += 1

    def nothing_requested(self, electrode: int, wanted_ua: int) -> None:
        """A pulse of the frame for which a stabilizer requests no current."""
        self._rows[electrode] = _nothing(wanted_ua, gain=0.0)

    def clamped(self, clamp: Clamp) -> None:
        """The latest clamp of each electrode and reason is reported."""
        self._pending.clamped[clamp.electrode, clamp.reason] = clamp
        if self._account is not None:
            self._account.clamped(clamp)
        self.counters["clamped"] += 1

    def not_fired(self, electrode: int | None, reason: str) -> None:
        """A pulse that was not fired, or a scan that came late."""
        self._pending.not_fired[electrode, reason] += 1
        if self._account is not None:
            self._account.not_fired(electrode, reason)
        self.counters[f"not_fired_{reason}"] += 1

    def slowed(self, rate_hz: float) -> None:
        """Scans came late for a second, and go on at this rate."""
        self._pending.slowed_hz = rate_hz
        if self._account is not None:
            self._account.slowed(rate_hz)
        self._has_news = True
        self.counters["slowed"] += 1

    def rejected(self, what: str) -> None:
        """Counted once, when it begins."""
        self.counters[f"rejected_{what}"] += 1

    def scan_report(self, now_ns: int, ceiling_ua: int, is_due: bool = False) -> None:
        """Send what has gathered, if a report is due (or `is_due`)."""
        if not self._has_news or (now_ns < self.due_ns and not is_due):
            return
        pending, showing = self._pending, self._active
        current = () if showing is None else (showing.shown(),)
        shown = (*pending.ended, *current)
        report = Scan(
            now_ns=now_ns,
            shown=shown,
            seq=shown[-1].seq if shown else -1,
            tag=shown[-1].tag if shown else None,
            scans=pending.scans,
            fired=_columns(self._rows),
            clamped=tuple(pending.clamped.values()),
            not_fired=_shortfalls(pending),
            ceiling_ua=ceiling_ua,
            dropped_reports=self.counters["reports_dropped"],
            pressure_kpa=self._pressure(now_ns),
        )
        if self._send_report(Report(scan=report)):
            # What could not be sent goes with the next report: no frame is lost.
            self._pending = _Pending()
            self._has_news = False
        self.due_ns = now_ns + _SCAN_PERIOD_NS

    # --- the rest ----------------------------------------------------------------------------

    def state(self, report: StateReport) -> None:
        self._send_report(Report(state=report))

    def modelled(self, body: Callable[[], BodyFelt], now_ns: int) -> None:
        """What the body behind a fake board feels by its model; a report without sensation is sent
        once.
        """
        if now_ns - self._modelled_ns < _MODELLED_PERIOD_NS:
            return
        self._modelled_ns = now_ns
        said = body()
        is_felt = any(said.pain) or any(said.felt)
        if is_felt or self._was_felt:
            felt = tuple(round(value, 3) for value in said.felt)
            pain = tuple(round(value, 3) for value in said.pain)
            self._send_report(Report(modelled=Modelled(now_ns=now_ns, felt=felt, pain=pain)))
        self._was_felt = is_felt

    def marked(self, mark: Marked) -> None:
        self._send_report(Report(mark=mark))

    def halt(self, halt: Halt) -> None:
        self._send_report(Report(halt=halt))

    def refused(self, frame: Frame, refusal: Refused, now_ns: int) -> None:
        """A frame that is not shown, and that no client waits for an answer to."""
        self.counters["frames_refused"] += 1
        count = self.counters["frames_refused"]
        report = RefusedReport(now_ns=now_ns, count=count, seq=frame.seq, **refusal.fields)
        self._send_report(Report(refused=report))

    def undecodable(self, why: str, now_ns: int) -> None:
        """The last report to a gateway before its connection is closed."""
        self.counters["gateway_undecodable"] += 1
        self._send_report(
            Report(refused=RefusedReport(now_ns=now_ns, error="bad_message", reason=why, count=1))
        )

    def never_shown(self, frame: Frame, now_ns: int) -> None:
        """The frame was accepted, but expired before its first scan could begin."""
        self._replaced = None
        before = "an edge of the trigger came" if frame.on_trigger else "the scan under way"
        why = f"its ttl of {frame.ttl_ms} ms was over before {before}: give it longer"
        self.refused(frame, Refused("expired", why), now_ns)

    def superseded(self, frames: int = 1) -> None:
        """Newer frames replaced so many that were not begun."""
        if frames:
            self.counters["frames_superseded"] += frames

    def contact(
        self, contact: ContactMap, now_ns: int, withheld: tuple[Withheld, ...] = ()
    ) -> Contact:
        """Sends the contact report, and returns it for the answer."""
        report = Contact(
            contact=tuple(contact.is_touched),
            resistance_ohm=tuple(contact.resistance_ohm),
            voltage_v=tuple(contact.voltage_v),
            t_ns=now_ns,
            pressure_kpa=self._pressure(now_ns),
            withheld=withheld,
        )
        self._send_report(Report(contact=report))
        return report

    def _send_report(self, report: Report) -> bool:
        if self._send(report):
            return True
        self.counters["reports_dropped"] += 1
        return False
