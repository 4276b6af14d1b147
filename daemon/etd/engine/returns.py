"""What the returns of a pulse allow, and what a fired pulse measures of them.

Owns: keeping the bounds of caps and the ledger's weights in step with what is known of the
electrodes. Must not know: how any of it is calculated, clocks: time comes in.

A named return counts as if it carried the whole current.
"""

from __future__ import annotations

from collections.abc import Sequence

from etd.planning.scheduled_pulse import ScheduledPulse
from etd.safety.bookings import Entry
from etd.safety.conductance import PathMeter, PathSamples
from etd.safety.ledger import Ledger
from etd.safety.limits import Path
from etd.safety.maxima import PC_PER_NC
from etd.safety.return_caps import Known, ReturnCaps
from etd.safety.return_share import ReturnShare
from etd_hal import ceilings
from etd_hal.boardfile import Source
from etd_hal.phase import Pulse, PulseResult

#: What no contact that changes is to bring an electrode, whatever its site allows.
_MOST_NET_PC = ceilings.NET_CHARGE_NC * PC_PER_NC


class Returns:
    """See the module. One for as long as the engine runs."""

    def __init__(self, electrodes: int, source: Source, ledger: Ledger) -> None:
        self._electrodes = range(electrodes)
        self._meter = PathMeter(source)
        self._ledger = ledger
        self.share = ReturnShare(electrodes, self._meter)
        self.set_caps((0,) * electrodes)

    def set_caps(self, caps_ua: Sequence[int]) -> None:
        """A lease may bring a new person, with these caps."""
        self._caps_ua = caps_ua
        self.reset()

    def reset(self) -> None:
        """The supply was off: any contact may have changed."""
        self.share.reset()
        self._is_measuring = False
        self._take(ReturnCaps(self._caps_ua, [None] * len(self._caps_ua)))

    def begin_measuring(self, now_ns: int) -> None:
        """After a reset every electrode is measured, one after another. What follows from that is
        determined once, after `all_measured`: until then any return may carry a whole current.
        """
        self.share.refresh(now_ns)
        self._keep_in_step(now_ns)
        self._is_measuring = True

    def all_measured(self) -> None:
        """The next pulse finds what follows."""
        self._is_measuring = False

    # --- before a pulse --------------------------------------------------------------------------

    def of(self, scheduled: ScheduledPulse, now_ns: int) -> tuple[Path, float]:
        """The caps on its path, and the share for its ledger entry."""
        if scheduled.returns is not None:
            return scheduled.path, 1.0
        path = self.path_now(scheduled.path, now_ns)
        return path, self.share.share(scheduled.electrode)

    def path_now(self, path: Path, now_ns: int) -> Path:
        """The path of a pulse through all others, with the caps that hold now."""
        if not self._is_measuring and self.share.refresh(now_ns):
            self._keep_in_step(now_ns)
        known = self._paths.get(path.electrode)
        # The cap of an electrode depends on the polarity: a poll may have another than a pulse.
        if known is None or known.cap_ua != path.cap_ua:
            known = path.with_returns(*self._caps.of(path.electrode))
            self._paths[path.electrode] = known
        return known

    def watch(self, scheduled: ScheduledPulse, request_ua: int, entry: Entry, now_ns: int) -> None:
        """Starts contact polls where an unknown electrode matters: it may carry the whole pulse,
        with a cap below the request, or all pulses of a second, or their direct current.
        """
        if self.share.is_wanted or scheduled.returns is not None:
            return
        ledger = self._ledger
        if (
            request_ua > scheduled.path.return_ua
            or ledger.exceeds_one_return(entry)
            or ledger.net.exceeds_one_return(now_ns)
        ):
            self.share.want()

    def is_poll_due(self, electrode: int, now_ns: int) -> bool:
        """Of a silent electrode, where polls are wanted: no pulse has measured it for long, or much
        direct current may have come back through it since.
        """
        return self._is_unread(electrode, now_ns) or self.share.is_due(electrode, now_ns)

    def must_be_polled(self, electrode: int, now_ns: int) -> bool:
        """Even when time is short: by what may have come back through it since it was read it would
        be above the ceiling with one scan more.
        """
        net = self._ledger.net
        return net.unread_pc(electrode, now_ns) + net.scan_pc > _MOST_NET_PC

    def _is_unread(self, electrode: int, now_ns: int) -> bool:
        """The same, beside what is counted."""
        net = self._ledger.net
        most_pc = abs(net.of(electrode, now_ns)) + net.unread_pc(electrode, now_ns)
        return most_pc + net.scan_pc > _MOST_NET_PC

    def scan_over(self, now_ns: int) -> None:
        """All pulses of a frame's scan were fired."""
        self._ledger.net.scan_over(now_ns)

    # --- after it --------------------------------------------------------------------------------

    def update(
        self,
        scheduled: ScheduledPulse,
        pulse: Pulse,
        result: PulseResult,
        *,
        touches: bool,
        is_followed: bool,
    ) -> None:
        """Stores what its first phase measured. `is_followed`: a probe, whose pulse comes next and
        tells more; it is read only where nothing else is known.
        """
        share, electrode, begun_ns = self.share, scheduled.electrode, result.begun_ns
        if scheduled.returns is None:
            reading = None
            if is_followed:
                is_due = not share.is_known(electrode, begun_ns)
            else:
                is_due = begun_ns >= share.read_from_ns[electrode]
                is_due = is_due or self._is_unread(electrode, begun_ns)
            if is_due:
                reading = self._meter.read(_samples(pulse, result), share.reading(electrode))
            is_as_before = share.update(electrode, touches, begun_ns, reading)
            if is_followed:
                share.read_from_ns[electrode] = begun_ns
            if reading is not None or not touches:
                self._ledger.net.read(electrode, is_as_before=is_as_before)
        elif not touches:
            share.lose(electrode)

    # --- in step ---------------------------------------------------------------------------------

    def _keep_in_step(self, now_ns: int) -> None:
        known = [self._known(electrode, now_ns) for electrode in self._electrodes]
        self._take(ReturnCaps(self._caps_ua, known))
        self._ledger.set_weights(self.share.weights(now_ns), now_ns)
        self._ledger.net.set_conductances(*self.share.parts(now_ns))

    def _take(self, caps: ReturnCaps) -> None:
        self._caps = caps
        #: By electrode, the caps on the path of its pulses through all others, until others hold.
        self._paths: dict[int, Path] = {}

    def _known(self, electrode: int, now_ns: int) -> Known | None:
        share = self.share
        reading = share.reading(electrode)
        if reading is None or not share.is_known(electrode, now_ns):
            return None
        touches = share.last_touch(electrode) is not None
        least_s, most_s = share.least_s[electrode], share.most_s[electrode]
        return Known(least_s, most_s, reading.current_ua, touches)


def _samples(pulse: Pulse, result: PulseResult) -> PathSamples:
    return PathSamples(
        pulse.code,
        pulse.shape.width_us,
        pulse.shape.has_end_sample,
        pulse.prepulse_ua > 0,
        result.baseline_v,
        result.early_v,
        result.voltage_v,
    )
