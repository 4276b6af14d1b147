"""Every pulse that is fired, gathered for a record while one is written.

Owns: the rows that are not sent yet, and how many were lost. Must not know: files, sockets beyond
the one function it sends with, what a pulse means.

What a repeated pulse has in common with the one before is packed once.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeAlias

from etd.engine.clearance import Cleared
from etd.planning.schedule import DuePulse
from etd.protocol.link import PulseBatch
from etd.protocol.pulse_row import CLAMPS, CONTACTS, NONE, OWN, PURPOSES, SAME
from etd.pulse.measured import ContactState
from etd_hal.phase import PulseResult

#: A batch is one datagram of at most so many rows.
_BATCH_ROWS = 500
#: A gateway that does not read for some seconds loses pulses; they are counted, the newest first.
_MOST_ROWS = 20_000

_PURPOSE = {"stimulus": 0, "contact_poll": 1, "measurement": 2}
_PROBE = PURPOSES.index("probe")
_CONTACT = {name: number for number, name in enumerate(CONTACTS)}
_CLAMP = {name: number for number, name in enumerate(CLAMPS)}
_NO_SAMPLES = (0.0, 0.0, 0.0)
_pack, _pack_same = OWN.pack, SAME.pack


#: A pulse; None for both results: one that is withheld. Then seq, the time of its limits, and what
#: it found: the current delivered, the resistance, the contact.
Entry: TypeAlias = tuple[
    DuePulse,
    Cleared | None,
    PulseResult | None,
    PulseResult | None,
    int,
    int,
    int,
    int | None,
    ContactState,
]


class PulseLog:
    """`send` returns False when the batch was dropped."""

    def __init__(self, send: Callable[[PulseBatch], bool]) -> None:
        self._send = send
        self.is_on = False
        self._entries: list[Entry] = []
        self._lost = 0

    def turn(self, is_on: bool) -> None:
        """On: from the next pulse on. Off: what has gathered is sent, as far as it is taken."""
        self.send_off()
        self.is_on = is_on
        self._entries, self._lost = [], 0

    def add(self, entry: Entry) -> None:
        """Packed later, many together, which takes a fraction of the time."""
        if len(self._entries) < _MOST_ROWS:
            self._entries.append(entry)
        else:
            self._lost += 1

    def withheld(self, due: DuePulse, seq: int, asked_ns: int) -> None:
        """A pulse that was due and is not fired."""
        self.add((due, None, None, None, seq, asked_ns, 0, None, "unknown"))

    def send_off(self) -> None:
        """Send what has gathered; what is not taken stays for the next time."""
        while self._entries:
            rows = b"".join([_row(entry) for entry in self._entries[:_BATCH_ROWS]])
            if not self._send(PulseBatch(rows=rows, lost=self._lost)):
                return
            del self._entries[:_BATCH_ROWS]
            self._lost = 0


def _row(entry: Entry) -> bytes:
    due, cleared, first, last, seq, asked_ns, delivered_ua, resistance_ohm, contact = entry
    if due.purpose == "stimulus":
        purpose = _PROBE if cleared is not None and cleared.leads else 0
    else:
        purpose, seq = _PURPOSE[due.purpose], NONE
    if cleared is None or first is None or last is None:
        own = _pack(asked_ns, asked_ns, seq, purpose, 0, 0, NONE, *_NO_SAMPLES, *_NO_SAMPLES)
        return _nothing(due) + own
    if not cleared.row:
        cleared.row = _same(due, cleared)
    second_v = _NO_SAMPLES
    if last is not first:
        second_v = last.baseline_v, last.early_v, last.voltage_v
    return cleared.row + _pack(
        first.begun_ns,
        asked_ns,
        seq,
        purpose,
        _CONTACT[contact],
        delivered_ua,
        NONE if resistance_ohm is None else resistance_ohm,
        first.baseline_v,
        first.early_v,
        first.voltage_v,
        second_v[0],
        second_v[1],
        second_v[2],
    )


def _same(due: DuePulse, cleared: Cleared) -> bytes:
    pulse, clamp, scheduled = cleared.pulse, cleared.clamp, due.scheduled
    return _pack_same(
        scheduled.electrode,
        _polarity(cleared.phases),
        0 if clamp is None else _CLAMP[clamp.reason],
        NONE if clamp is None else clamp.limited_by,
        scheduled.request.current_ua if due.purpose == "stimulus" else 0,
        pulse.commanded_ua,
        pulse.prepulse_ua,
        pulse.commanded_us,
        cleared.given.charge_pc * len(cleared.phases),
    )


def _nothing(due: DuePulse) -> bytes:
    scheduled = due.scheduled
    wanted_ua = scheduled.request.current_ua if due.purpose == "stimulus" else 0
    polarity = _polarity(scheduled.phases)
    return _pack_same(scheduled.electrode, polarity, 0, NONE, wanted_ua, 0, 0, 0.0, 0)


def _polarity(phases: Sequence[bool]) -> int:
    """Its number in `POLARITIES`."""
    return 2 * (len(phases) - 1) + (0 if phases[0] else 1)
