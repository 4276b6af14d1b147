"""One visit of one electrode: stabilize, limit, ledger, fire, discharge, learn, report.

Owns: the order of these, which is the order of safety: whatever a stabilizer asks, the limits and
the ledger come after it, and nothing after them (`firing`) increases anything.
Must not know: frames, schedules, sockets, states (beyond being called only when firing may go on).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import msgspec

from etd.engine.asking import Asker
from etd.engine.contact import ContactMap
from etd.engine.impedance import Samples
from etd.engine.limits import last_word
from etd.engine.looking_ahead import LookingAhead
from etd.engine.opening import Opening
from etd.engine.reporting import FiredPulse, Reporter
from etd.engine.sharing import Sharing
from etd.engine.visit import Visit
from etd.firing import Firing, ReadyPulse, prepulse_of
from etd.ledger import Entry, Ledger
from etd.maxima import Maxima
from etd.protocol import Clamp
from etd.stabilize.pipeline import Wish
from etd_hal.board import Board, Pulse, Shot
from etd_hal.ports import Clock


@dataclass(slots=True)
class Tools:
    """What a visit works with, as long as the engine runs: no new lease forgets the ledger."""

    board: Board
    clock: Clock
    maxima: Maxima
    ledger: Ledger
    opening: Opening
    contact: ContactMap
    sharing: Sharing
    reporter: Reporter
    asker: Asker
    ahead: LookingAhead


class _Ready(ReadyPulse, frozen=True, kw_only=True):
    """A pulse that limits and ledger let through, and the clamp to tell, if any."""

    clamp: Clamp | None

    def with_probe(self, probe: Wish) -> Entry:
        """What the ledger must have room for before the probe is fired."""
        charge_pc = self.entry.charge_pc + probe.charge_pc
        on_us = self.entry.on_us + probe.width_us
        return msgspec.structs.replace(self.entry, charge_pc=charge_pc, on_us=on_us)


class Visitor:
    """See the module."""

    def __init__(self, tools: Tools) -> None:
        self._tools = tools
        self.firing = Firing(tools.board, tools.ledger, tools.clock)

    def visit(
        self, visit: Visit, opening_ua: int, now_ns: int, may_still: Callable[[], bool]
    ) -> int | None:
        """Visit, if limits and ledger let anything through; when its pulse began, if it had one.

        `may_still` is asked once more when all is connected: the rest before takes 0.2 ms, and
        relays take milliseconds.

        Raises: BusError, GuardRefusal, BoardFault: the caller makes the board safe.
        """
        wish = self._tools.asker.wish(visit, now_ns)
        if wish.current_ua == 0:
            # Limits and ledger tell what they take; nobody else tells this.
            self._tools.reporter.nothing_asked(visit.electrode, visit.current_ua)
        return self._let_through(visit, wish, opening_ua, now_ns, may_still)

    def probe(
        self, visit: Visit, opening_ua: int, now_ns: int, may_still: Callable[[], bool]
    ) -> int | None:
        """The same for a probe, about which nobody is asked."""
        return self._let_through(visit, visit.wish, opening_ua, now_ns, may_still)

    def awaited(self, probes: Sequence[Visit], now_ns: int) -> list[Visit]:
        """Those of these probes that a clamped pulse waits for."""
        sharing = self._tools.sharing
        if not sharing.is_wanted:
            return []
        return [one for one in probes if sharing.is_due(one.electrode, now_ns)]

    def due(self, probes: Sequence[Visit], now_ns: int) -> list[Visit]:
        """Those that keep a contact known, for a law that goes by it. Relays have no time to spare,
        and wear.
        """
        tools = self._tools
        if not tools.asker.goes_by_contact or tools.board.switch.can_choose_returns:
            return []
        return [one for one in probes if tools.contact.is_look_due(one.electrode, now_ns)]

    def look(
        self, probe: Visit, opening_ua: int, now_ns: int, may_still: Callable[[], bool]
    ) -> None:
        """Ask an electrode that a frame leaves silent whether it still touches.

        It is no part of the frame: it is counted, and not told as one of its pulses.
        """
        tools = self._tools
        share = self._share(probe, now_ns)
        wish = probe.wish
        current_ua, _ = self._limited(probe, wish, share, opening_ua, now_ns)
        given = wish.at(current_ua)
        pulse = tools.board.pulse(current_ua, given.width_us)
        entry = _entry_of(probe, given, share)
        if pulse.code == 0 or tools.ledger.why_not(entry, now_ns) is not None:
            return
        tools.board.connect(probe.selection, probe.phases[0])
        if not may_still():
            tools.board.discharge()
            return
        shots = self.firing.visit(ReadyPulse(entry, probe.selection, pulse, given), probe.phases)
        self._learn(probe, pulse, *shots)
        tools.reporter.counters["looks"] += 1

    def _let_through(
        self,
        visit: Visit,
        wish: Wish,
        opening_ua: int,
        now_ns: int,
        may_still: Callable[[], bool],
    ) -> int | None:
        tools = self._tools
        ready = self._ready(visit, wish, opening_ua, now_ns)
        if ready is None:
            return None
        probe = tools.ahead.probe_of(visit, ready.given)
        if probe is not None and not self._fits(visit, ready.with_probe(probe), now_ns):
            return None
        if probe is not None:
            # Laid out before anything is connected: it is at hand then.
            tools.board.pulse(probe.current_ua, probe.width_us)
        tools.board.connect(visit.selection, visit.phases[0])
        probe_ua = 0
        if probe is not None and may_still():
            probe_ua = self._probe_first(visit, probe, ready.entry.share)
            ready = self._ready_again(visit, wish, opening_ua, now_ns)
        if ready is None or not may_still():
            tools.board.discharge()
            if probe_ua:
                tools.reporter.counters["probes_alone"] += 1
            return None
        shots = self.firing.visit(ready, visit.phases)
        given_ua, ended_ns = ready.given.current_ua, shots[-1].ended_ns
        tools.opening.fired(visit.electrode, given_ua, ready.pulse.told_ua, ended_ns)
        probed_v = tools.ahead.probed_v(visit.electrode) if probe_ua else 0.0
        self._learn(visit, ready.pulse, *shots, probed_v)
        tools.ahead.was_followed(visit.electrode)
        self._tell(visit, ready.pulse, shots[0].begun_ns, probe_ua)
        if ready.clamp is not None:
            # Told with its pulse: a report may have gone out while relays moved.
            tools.reporter.clamped(ready.clamp)
        return shots[0].begun_ns

    def _ready(
        self, visit: Visit, wish: Wish, opening_ua: int, now_ns: int, pulses: int = 1
    ) -> _Ready | None:
        """What limits and ledger let through of a wish; None, and told why, where that is nothing.
        `pulses` 0: the visit is booked already.
        """
        electrode, tools = visit.electrode, self._tools
        share = self._share(visit, now_ns)
        current_ua, clamp = self._limited(visit, wish, share, opening_ua, now_ns)
        given = wish.at(current_ua)
        pulse = tools.board.pulse(current_ua, given.width_us, prepulse_of(given))
        if pulse.code == 0:
            if clamp is not None:
                tools.reporter.clamped(clamp)
            elif wish.current_ua > 0:
                tools.reporter.skipped(electrode, "resolution")
            return None
        entry = _entry_of(visit, given, share, pulses)
        if not self._fits(visit, entry, now_ns):
            return None
        if clamp is not None and clamp.reason == "return_cap":
            tools.sharing.want(now_ns)
        return _Ready(entry, visit.selection, pulse, given, clamp=clamp)

    def _fits(self, visit: Visit, entry: Entry, now_ns: int) -> bool:
        tools = self._tools
        if tools.ledger.why_not(entry, now_ns) is None:
            return True
        tools.sharing.want(now_ns)
        tools.reporter.skipped(visit.electrode, "ledger")
        return False

    def _probe_first(self, visit: Visit, probe: Wish, share: float) -> int:
        """Fire, book and learn; the current that the source was told, in uA."""
        tools, electrode = self._tools, visit.electrode
        pulse = tools.board.pulse(probe.current_ua, probe.width_us)
        entry = Entry(electrode, probe.charge_pc, probe.width_us, visit.returns, share)
        ready = ReadyPulse(entry, visit.selection, pulse, probe)
        shot = self.firing.message(ready, visit.phases[0])
        if tools.ahead.learn(electrode, pulse, shot):
            tools.asker.not_believed("probe")
        self._learn_share(visit, shot.begun_ns)
        return pulse.told_ua

    def _ready_again(self, visit: Visit, wish: Wish, opening_ua: int, now_ns: int) -> _Ready | None:
        """After a probe: everything is asked anew, at the same instant, so that nothing can have
        risen. An electrode that the probe has found open gets nothing more.
        """
        tools, electrode = self._tools, visit.electrode
        if tools.contact.is_touched[electrode] is False:
            tools.reporter.clamped(
                Clamp(
                    electrode=electrode,
                    wanted_ua=wish.current_ua,
                    got_ua=0,
                    reason="contact_open",
                    limited_by=electrode,
                )
            )
            return None
        expected_ohm = tools.ahead.expected_ohm(electrode, now_ns)
        wish = tools.asker.wish_again(visit, wish, expected_ohm, now_ns)
        return self._ready(visit, wish, opening_ua, now_ns, pulses=0)

    def _share(self, visit: Visit, now_ns: int) -> float:
        """What one return may carry: explicit ones are each reckoned as if alone."""
        if visit.returns is not None:
            return 1.0
        return self._tools.sharing.largest(visit.electrode, now_ns)

    def _limited(
        self, visit: Visit, wish: Wish, share: float, opening_ua: int, now_ns: int
    ) -> tuple[int, Clamp | None]:
        tools, electrode = self._tools, visit.electrode
        return last_word(
            visit.path.with_share(share),
            wish,
            tools.maxima,
            opening_ua,
            tools.opening.recontact_ua(electrode, now_ns),
            tools.contact.is_touched[electrode] is False,
            visit.most,
            visit.probe_pc,
        )

    def _learn(
        self, visit: Visit, pulse: Pulse, first: Shot, last: Shot, probed_v: float = 0.0
    ) -> None:
        tools, electrode = self._tools, visit.electrode
        begun_ns, is_at_end = first.begun_ns, pulse.shape.has_end_sample
        if tools.contact.learn(
            electrode, pulse.told_ua, last.voltage_v, begun_ns, is_at_end=is_at_end
        ):
            tools.opening.touched_again(electrode)
        if pulse.told_ua > tools.maxima.probe_current_ua:
            # Of a second phase the skin is not at rest before: the first one tells more.
            tools.asker.learn(electrode, _samples(pulse, first, probed_v), begun_ns)
        self._learn_share(visit, begun_ns)

    def _learn_share(self, visit: Visit, begun_ns: int) -> None:
        tools, electrode = self._tools, visit.electrode
        touches = tools.contact.is_touched[electrode] is True
        if visit.returns is None:
            tools.sharing.learn(electrode, touches, begun_ns)
        elif not touches:
            tools.sharing.lose(electrode)

    def _tell(self, visit: Visit, pulse: Pulse, begun_ns: int, probe_ua: int) -> None:
        contact, electrode = self._tools.contact, visit.electrode
        skin_ohm, capacitance_nf = self._tools.asker.told(electrode, begun_ns)
        self._tools.reporter.fired(
            FiredPulse(
                electrode=electrode,
                begun_ns=begun_ns,
                wanted_ua=visit.wish.current_ua,
                told_ua=pulse.told_ua,
                delivered_ua=contact.delivered_ua(electrode),
                width_us=pulse.told_us,
                voltage_v=contact.voltage_v[electrode] or 0.0,
                resistance_ohm=contact.resistance_ohm[electrode],
                contact=contact.state(electrode, begun_ns),
                prepulse_ua=pulse.prepulse_ua,
                probe_ua=probe_ua,
                skin_ohm=skin_ohm,
                capacitance_nf=capacitance_nf,
            )
        )


def _entry_of(visit: Visit, given: Wish, share: float, pulses: int = 1) -> Entry:
    """All phases of it. `pulses` 0: the visit is booked already."""
    phases = len(visit.phases)
    on_us = given.whole_us * phases
    return Entry(visit.electrode, given.charge_pc * phases, on_us, visit.returns, share, pulses)


def _samples(pulse: Pulse, shot: Shot, probed_v: float) -> Samples:
    has_end = pulse.shape.has_end_sample
    # After a prepulse the skin does not begin at rest: then the end alone tells, where there is
    # one; else the early sample makes the resistance look too high, which asks for less.
    is_end_alone = has_end and pulse.prepulse_ua > 0
    return Samples(
        told_ua=pulse.told_ua,
        width_us=pulse.shape.width_us,
        resting_v=shot.baseline_v,
        early_v=shot.voltage_v if is_end_alone else shot.early_v,
        end_v=shot.voltage_v if has_end else None,
        probed_v=probed_v,
    )
