"""One visit of one electrode: stabilize, limit, ledger, fire, discharge, learn, report.

Owns: the order of these, which is the order of safety: whatever a stabilizer asks, the limits and
the ledger come after it, and nothing after them increases anything.
Must not know: frames, schedules, sockets, states (beyond being called only when firing may go on).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

from etd.engine.asking import Asker
from etd.engine.contact import ContactMap
from etd.engine.impedance import Samples
from etd.engine.ledger import Entry, Ledger
from etd.engine.limits import Maxima, last_word
from etd.engine.opening import Opening
from etd.engine.plan import Visit
from etd.engine.reporting import FiredPulse, Reporter
from etd.engine.sharing import Sharing
from etd.errors import BoardFault
from etd.protocol import Clamp
from etd.stabilize.pipeline import Wish
from etd_hal.board import Board, Pulse, Shot
from etd_hal.watch import Prepulse

#: Of the mean deviation from plan, by which drift is seen.
_DRIFT_WEIGHT = 0.02


@dataclass(slots=True)
class Tools:
    """What a visit works with; one set a lease."""

    board: Board
    maxima: Maxima
    ledger: Ledger
    opening: Opening
    contact: ContactMap
    sharing: Sharing
    reporter: Reporter
    asker: Asker


class Visitor:
    """See the module."""

    def __init__(self, tools: Tools) -> None:
        self._tools = tools
        machine = tools.board.machine
        self._halt_excess_ns = int(machine.halt_excess_us * 1_000)
        self._drift_ns = machine.drift_us * 1_000
        self._deviation_ns = 0.0

    @property
    def has_drifted(self) -> bool:
        """Messages take longer or shorter than calibrated, on the mean: calibrate again."""
        return abs(self._deviation_ns) > self._drift_ns

    def forget_drift(self) -> None:
        """After a calibration."""
        self._deviation_ns = 0.0

    def visit(
        self, visit: Visit, opening_ua: int, now_ns: int, may_still: Callable[[], bool]
    ) -> int | None:
        """Visit, if limits and ledger let anything through; when its pulse began, if it had one.

        `may_still` is asked once more when all is connected: the rest before takes 0.2 ms, and
        relays take milliseconds.

        Raises: BusError, GuardRefusal, BoardFault: the caller makes the board safe.
        """
        wish = self._tools.asker.wish(visit, now_ns)
        return self._let_through(visit, wish, opening_ua, now_ns, may_still)

    def probe(
        self, visit: Visit, opening_ua: int, now_ns: int, may_still: Callable[[], bool]
    ) -> int | None:
        """The same for a probe, about which nobody is asked."""
        return self._let_through(visit, visit.wish, opening_ua, now_ns, may_still)

    def awaited(self, probes: Sequence[Visit], now_ns: int) -> list[Visit]:
        """Those of these probes that somebody waits for."""
        sharing = self._tools.sharing
        if not sharing.is_wanted:
            return []
        return [one for one in probes if sharing.is_due(one.electrode, now_ns)]

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
        entry = _entry(probe, given, share)
        if pulse.code == 0 or tools.ledger.why_not(entry, now_ns) is not None:
            return
        tools.board.connect(probe.selection, probe.phases[0])
        if not may_still():
            tools.board.discharge()
            return
        shots = self._fire(probe, pulse, entry, given)
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
        electrode, reporter = visit.electrode, self._tools.reporter
        share = self._share(visit, now_ns)
        current_ua, clamp = self._limited(visit, wish, share, opening_ua, now_ns)
        given = wish.at(current_ua)
        pulse = self._tools.board.pulse(current_ua, given.width_us, _prepulse(given))
        entry = _entry(visit, given, share)
        if pulse.code == 0:
            if clamp is not None:
                reporter.clamped(clamp)
            elif wish.current_ua > 0:
                reporter.skipped(electrode, "resolution")
            return None
        if self._tools.ledger.why_not(entry, now_ns) is not None:
            self._tools.sharing.want(now_ns)
            reporter.skipped(electrode, "ledger")
            return None
        if clamp is not None and clamp.reason == "return_cap":
            self._tools.sharing.want(now_ns)
        self._tools.board.connect(visit.selection, visit.phases[0])
        if not may_still():
            self._tools.board.discharge()
            return None
        shots = self._fire(visit, pulse, entry, given)
        self._learn(visit, pulse, *shots)
        self._tell(visit, pulse, shots[0].begun_ns)
        if clamp is not None:
            # Told with its pulse: a report may have gone out while relays moved.
            reporter.clamped(clamp)
        return shots[0].begun_ns

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
            wish.current_ua,
            wish.width_us,
            tools.maxima,
            opening_ua,
            tools.opening.recontact_ua(electrode, now_ns),
            tools.contact.is_touched[electrode] is False,
            visit.most,
            wish.charge_us,
        )

    def _fire(self, visit: Visit, pulse: Pulse, entry: Entry, given: Wish) -> tuple[Shot, Shot]:
        """The first and the last phase's."""
        board = self._tools.board
        first, *others = visit.phases
        allowed = (given.current_ua, given.width_us, _prepulse(given))
        shot = board.fire(pulse, visit.selection, first, *allowed)
        self._tools.ledger.book(entry, shot.begun_ns)
        first_shot = shot
        self._check_duration(shot, pulse, entry)
        for is_anodic in others:
            board.flip(visit.selection, is_anodic)
            shot = board.fire(pulse, visit.selection, is_anodic, *allowed)
            self._check_duration(shot, pulse, entry)
        board.discharge()
        return first_shot, shot

    def _check_duration(self, shot: Shot, pulse: Pulse, entry: Entry) -> None:
        """What a message took over its plan bounds what the current flowed too long."""
        excess_ns = shot.excess_ns
        self._deviation_ns += _DRIFT_WEIGHT * (excess_ns - self._deviation_ns)
        if excess_ns <= 0:
            return
        excess_pc = math.ceil(pulse.told_ua * excess_ns / 1_000)
        self._tools.ledger.book_excess(entry, excess_pc, shot.begun_ns)
        if excess_ns > self._halt_excess_ns:
            raise BoardFault(
                f"message for electrode {entry.electrode}",
                f"{excess_ns / 1_000:.0f} us over its plan",
                f"at most {self._halt_excess_ns / 1_000:.0f} us",
            )

    def _learn(self, visit: Visit, pulse: Pulse, first: Shot, last: Shot) -> None:
        tools, electrode = self._tools, visit.electrode
        begun_ns, is_at_end = first.begun_ns, pulse.shape.has_end_sample
        if tools.contact.learn(
            electrode, pulse.told_ua, last.voltage_v, begun_ns, is_at_end=is_at_end
        ):
            tools.opening.touched_again(electrode)
        if pulse.told_ua > tools.maxima.probe_current_ua:
            # Of a second phase the skin is not at rest before: the first one tells more.
            tools.asker.learn(electrode, _samples(pulse, first))
        touches = tools.contact.is_touched[electrode] is True
        if visit.returns is None:
            tools.sharing.learn(electrode, touches, begun_ns)
        elif not touches:
            tools.sharing.lose(electrode)

    def _tell(self, visit: Visit, pulse: Pulse, begun_ns: int) -> None:
        contact, electrode = self._tools.contact, visit.electrode
        self._tools.reporter.fired(
            FiredPulse(
                electrode=electrode,
                begun_ns=begun_ns,
                wanted_ua=visit.wish.current_ua,
                told_ua=pulse.told_ua,
                delivered_ua=contact.delivered_ua(electrode),
                width_us=round(pulse.shape.width_us, 2),
                voltage_v=contact.voltage_v[electrode] or 0.0,
                resistance_ohm=contact.resistance_ohm[electrode],
                contact=contact.state(electrode, begun_ns),
            )
        )


def _entry(visit: Visit, given: Wish, share: float) -> Entry:
    phases = len(visit.phases)
    charge_pc = given.current_ua * given.width_us + given.prepulse_ua * given.prepulse_us
    return Entry(visit.electrode, charge_pc * phases, given.whole_us * phases, visit.returns, share)


def _prepulse(given: Wish) -> Prepulse | None:
    return Prepulse(given.prepulse_ua, given.prepulse_us) if given.prepulse_us else None


def _samples(pulse: Pulse, shot: Shot) -> Samples:
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
    )
