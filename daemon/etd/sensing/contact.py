"""Which electrodes are touched, and how, as measured by pulses.

Owns: contact by threshold with hysteresis, the resistance with the leak taken out, the state of
each contact, and when it expires. Must not know: what follows from it, clocks (time comes in),
hardware beyond its constants.

With nothing connected the node rises to I x leak, or to the compliance: the open-circuit signature.
A touched electrode holds it well below. Both thresholds are fractions of that signature, from the
body-site file. The contact of an electrode is unknown before its first pulse, and again without a
pulse for MAX_AGE_NS (`etd.pulse.measured`): the finger may have left and come back. An electrode
found open stays open until a measurement shows contact; less current is sent meanwhile.

States: `open`; `soft`, for a while after a contact was made anew (after an open or unknown one) or
shrank (its resistance rose by half from one pulse to the next: peeling); `saturated`, when a strong
pulse ended near the compliance, so that less was delivered than commanded (the next weak pulse
measures whether anything touches); `shorted`, when the resistance is below what skin can have, as
beside a neighbor under paste; `closed`.
"""

from __future__ import annotations

from collections.abc import Sequence

from etd.files.body_site import SiteContact
from etd.protocol.carried import ContactsState
from etd.protocol.messages import ContactState
from etd.pulse.measured import CONTACT_POLL_NS, MAX_AGE_NS
from etd_hal.boardfile import Source

#: Fractions of the compliance: above the first a pulse was not delivered, below the second it was.
_SATURATED, _DELIVERED = 0.95, 0.90
#: A rise of resistance by this factor between two comparable pulses: the contact shrinks.
PEELED = 1.5
#: A pulse is comparable at this part of the current before or more: skin resists weak currents
#: more.
_LIKE = 0.8
#: A short ends at this many times the resistance at which it begins.
_SHORT_ENDS = 1.5


class ContactMap:
    """Contact, resistance and voltage of every electrode; None where unknown. The lists hold what
    pulses measured last; expired entries are removed by the first call with a time.
    """

    def __init__(self, electrodes: int, source: Source, site: SiteContact) -> None:
        self._leak_ohm = source.leak_ohm
        self._compliance_v = source.compliance_v
        self._touch_fraction = site.touch_fraction
        self._open_fraction = site.open_fraction
        self._shorted_ohm = site.shorted_ohm
        self._soften_ns = site.soften_ms * 1_000_000
        self.is_touched: list[bool | None] = [None] * electrodes
        self.resistance_ohm: list[int | None] = [None] * electrodes
        self.voltage_v: list[float | None] = [None] * electrodes
        #: The current of the last undelivered pulse, until a pulse is delivered.
        self.undelivered_ua: list[int | None] = [None] * electrodes
        self._is_shorted = [False] * electrodes
        self._soft_since_ns: list[int | None] = [None] * electrodes
        self._commanded_ua = [0] * electrodes
        self._was_at_end = [False] * electrodes
        self._measured_ns: list[int | None] = [None] * electrodes

    def reset(self) -> None:
        """The supply was off: any contact may have changed."""
        for electrode in range(len(self.is_touched)):
            self.is_touched[electrode] = None
            self._reset_one(electrode)

    def saved(self) -> ContactsState:
        """For a record."""
        return ContactsState(
            is_touched=tuple(self.is_touched),
            resistance_ohm=tuple(self.resistance_ohm),
            voltage_v=tuple(self.voltage_v),
            undelivered_ua=tuple(self.undelivered_ua),
            is_shorted=tuple(self._is_shorted),
            soft_since_ns=tuple(self._soft_since_ns),
            commanded_ua=tuple(self._commanded_ua),
            was_at_end=tuple(self._was_at_end),
            measured_ns=tuple(self._measured_ns),
        )

    def resume(self, saved: ContactsState, ahead_ns: int) -> None:
        """As a record has it, whose clock is so much ahead. Nothing but a replay calls this."""
        self.is_touched[:] = saved.is_touched
        self.resistance_ohm[:] = saved.resistance_ohm
        self.voltage_v[:] = saved.voltage_v
        self.undelivered_ua[:] = saved.undelivered_ua
        self._is_shorted[:] = saved.is_shorted
        self._soft_since_ns[:] = _moved(saved.soft_since_ns, ahead_ns)
        self._commanded_ua[:] = saved.commanded_ua
        self._was_at_end[:] = saved.was_at_end
        self._measured_ns[:] = _moved(saved.measured_ns, ahead_ns)

    def _reset_one(self, electrode: int) -> None:
        """Reset all of an electrode, except that it is open."""
        if self.is_touched[electrode]:
            self.is_touched[electrode] = None
        self.resistance_ohm[electrode] = None
        self.voltage_v[electrode] = None
        self.undelivered_ua[electrode] = None
        self._is_shorted[electrode] = False
        self._soft_since_ns[electrode] = None
        self._measured_ns[electrode] = None

    def _let_go(self, electrode: int, now_ns: int) -> None:
        """Reset an electrode whose measurement has expired."""
        told_ns = self._measured_ns[electrode]
        if told_ns is not None and now_ns - told_ns >= MAX_AGE_NS:
            self._reset_one(electrode)

    def state(self, electrode: int, now_ns: int) -> ContactState:
        self._let_go(electrode, now_ns)
        is_touched = self.is_touched[electrode]
        if self.undelivered_ua[electrode] is not None:
            return "saturated"
        if is_touched is None:
            return "unknown"
        if not is_touched:
            return "open"
        if self._is_shorted[electrode]:
            return "shorted"
        return "soft" if self.firmness(electrode, now_ns) < 1.0 else "closed"

    def firmness(self, electrode: int, now_ns: int) -> float:
        """From 0, when the contact was made anew or shrank, to 1, when it counts as firm."""
        since_ns = self._soft_since_ns[electrode]
        if since_ns is None:
            return 1.0
        part = (now_ns - since_ns) / self._soften_ns
        if part < 1.0:
            return max(0.0, part)
        self._soft_since_ns[electrode] = None
        return 1.0

    def delivered_ua(self, electrode: int) -> int:
        """The current through the skin near the end of the last pulse: the leak took the rest."""
        leaked_ua = (self.voltage_v[electrode] or 0.0) / self._leak_ohm * 1e6
        return max(0, round(self._commanded_ua[electrode] - leaked_ua))

    def update(
        self,
        electrode: int,
        commanded_ua: int,
        voltage_v: float,
        now_ns: int = 0,
        *,
        is_at_end: bool = True,
    ) -> bool:
        """Take the measurement of a pulse of `commanded_ua`: the node's voltage near its end (or,
        for a pulse too short for that, after its beginning: then `is_at_end` is False).

        Returns True when an electrode known to be open is touched again.
        """
        if commanded_ua <= 0:
            return False
        resistance_ohm = self.seen_ohm(commanded_ua, voltage_v)
        is_again = self.update_touch(electrode, commanded_ua, voltage_v, now_ns)
        if resistance_ohm is not None:
            if self.is_touched[electrode] and self._peels(
                electrode, commanded_ua, resistance_ohm, is_at_end
            ):
                self._soft_since_ns[electrode] = now_ns
            ends = _SHORT_ENDS if self._is_shorted[electrode] else 1.0
            self._is_shorted[electrode] = resistance_ohm < ends * self._shorted_ohm
        self.voltage_v[electrode] = round(voltage_v, 2)
        if voltage_v < _DELIVERED * self._compliance_v:
            self.undelivered_ua[electrode] = None
        else:
            self._update_delivery(electrode, commanded_ua, voltage_v)
        self.resistance_ohm[electrode] = resistance_ohm
        self._commanded_ua[electrode], self._was_at_end[electrode] = commanded_ua, is_at_end
        return is_again

    def update_touch(
        self, electrode: int, commanded_ua: int, voltage_v: float, now_ns: int
    ) -> bool:
        """Take from a pulse only whether anything touches: a weak pulse measures no more than that
        reliably.

        Returns True when an electrode known to be open is touched again.
        """
        self._let_go(electrode, now_ns)
        signature_v = min(commanded_ua * self._leak_ohm / 1e6, self._compliance_v)
        fraction, was = voltage_v / signature_v, self.is_touched[electrode]
        if fraction < self._touch_fraction:
            now = True
        elif fraction > self._open_fraction or was is None:
            now = False
        else:
            now = was
        if now and not was:
            self._soft_since_ns[electrode] = now_ns
        self.is_touched[electrode], self._measured_ns[electrode] = now, now_ns
        return now and was is False

    def is_as_before(self, electrode: int, now_ns: int) -> None:
        """Refreshes a contact state that had expired and was found unchanged."""
        self._let_go(electrode, now_ns)
        if self.is_touched[electrode] is None:
            self.is_touched[electrode], self._measured_ns[electrode] = True, now_ns

    def is_poll_due(self, electrode: int, now_ns: int) -> bool:
        """Whether the electrode is due for a contact poll, so that its contact stays known."""
        told_ns = self._measured_ns[electrode]
        return told_ns is None or now_ns - told_ns >= CONTACT_POLL_NS

    def shrank(self, electrode: int, now_ns: int) -> None:
        """The contact was found to peel: it is soft from now on."""
        self._soft_since_ns[electrode] = now_ns

    def _peels(
        self, electrode: int, commanded_ua: int, resistance_ohm: int, is_at_end: bool
    ) -> bool:
        before_ohm = self.resistance_ohm[electrode]
        if before_ohm is None or resistance_ohm <= PEELED * before_ohm:
            return False
        return (
            commanded_ua >= _LIKE * self._commanded_ua[electrode]
            and is_at_end == self._was_at_end[electrode]
        )

    def _update_delivery(self, electrode: int, commanded_ua: int, voltage_v: float) -> None:
        can_saturate = commanded_ua * self._leak_ohm / 1e6 > self._compliance_v
        if can_saturate and voltage_v >= _SATURATED * self._compliance_v:
            self.undelivered_ua[electrode] = commanded_ua

    def seen_ohm(self, commanded_ua: int, voltage_v: float) -> int | None:
        """V / (I - V / leak); None near the compliance and where the leak takes it all."""
        through_ua = commanded_ua - voltage_v / self._leak_ohm * 1e6
        if through_ua < commanded_ua * 0.02 or voltage_v >= 0.95 * self._compliance_v:
            return None
        return int(voltage_v / through_ua * 1e6)


def _moved(times_ns: Sequence[int | None], ahead_ns: int) -> list[int | None]:
    return [None if t_ns is None else t_ns - ahead_ns for t_ns in times_ns]
