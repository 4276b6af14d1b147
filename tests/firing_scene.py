"""A live board on even skin, and the one way for current to it.

Owns: the scene, its pulse, and what of it is looked at. Must not know: what is judged.
"""

from __future__ import annotations

from board_rig import BoardRig, board_rig
from charge_witness import even_skin
from engine_parts import body_site
from etd.firing import Firing, ReadyPulse
from etd.pulse.request import PulseRequest
from etd.safety.bookings import Entry
from etd.safety.ledger import Bounds, Ledger
from etd.safety.maxima import maxima_of
from etd_body.interface import Side
from etd_hal.fake.faults import Fault
from stepped_board import shipped_board

KAJIMOTO, RELAY = "kajimoto-hv507", "feetthrough-relay"
HERE, RETURNS = 5, (6, 9)
CURRENT_UA, WIDTH_US = 1_000, 100
PHASE_PC = CURRENT_UA * WIDTH_US
#: A message that is so much over its plan halts, by the machine file.
HALT_EXCESS_US = 300
#: Of the body site.
INTERVAL_US = 2_000
#: Of the plan: the rest goes through the leak.
NEARLY = 0.75
#: Of two phases, the message of the second: before it, relays are looked at.
SECOND_MESSAGE = {KAJIMOTO: 2, RELAY: 3}


class Scene:
    """A live board on even skin, a ledger, and a pulse that is connected."""

    def __init__(self, board: str = KAJIMOTO, phases: tuple[bool, ...] = (True,)) -> None:
        file = shipped_board(board)
        self.count = file.switch.outputs
        self.body = even_skin(file, self.count)
        self.rig: BoardRig = board_rig(board, body=self.body)
        self.rig.begin()
        maxima = maxima_of(file, body_site())
        assert maxima.interval_us == INTERVAL_US
        self.ledger = Ledger(self.count, Bounds.of(maxima))
        self.firing = Firing(self.rig.board, self.ledger, self.rig.clock)
        returns = RETURNS if board == RELAY else None
        selection = self.rig.board.selection(HERE, returns)
        pulse = self.rig.board.pulse(CURRENT_UA, WIDTH_US)
        charge_pc, on_us = PHASE_PC * len(phases), WIDTH_US * len(phases)
        entry = Entry(HERE, charge_pc, on_us, returns, 1.0, net_pc=0 if len(phases) > 1 else None)
        given = PulseRequest(CURRENT_UA, WIDTH_US)
        self.ready = ReadyPulse(entry, selection, phases, pulse, given)
        self.rig.board.prepare(selection, whole=True)
        self.rig.board.connect(selection, phases[0])
        self.begun_ns = self.rig.clock.now_ns()

    def fire(self, *faults: Fault) -> None:
        for fault in faults:
            self.rig.fake.world.put_in(fault)
        self.firing.fire(self.firing.book(self.ready), self.ready)

    @property
    def is_connected(self) -> bool:
        """By the wire: not all electrodes are on ground."""
        return Side.SOURCE in self.rig.sides

    @property
    def booked_pc(self) -> int:
        return self.ledger.charge_pc(HERE, self.rig.clock.now_ns())

    @property
    def left_pc(self) -> float:
        """Net, by the ledger."""
        return self.ledger.net.of(HERE, self.rig.clock.now_ns())

    def since_pc(self, begun_ns: int) -> int:
        """At its full current until now."""
        return CURRENT_UA * (self.rig.clock.now_ns() - begun_ns) // 1_000

    def pulses_ns(self) -> list[int]:
        """When the messages with a pulse began: those of several transfers, since the scene did."""
        return [
            entry["t_ns"]
            for entry in self.rig.records()
            if entry.get("event") == "message"
            and entry["transfers"] > 1
            and entry["t_ns"] >= self.begun_ns
        ]

    def got_pc(self, electrode: int = HERE) -> float:
        return self.body.absolute_charge_pc(electrode)

    def check_all(self) -> None:
        """No electrode got more than the ledger has."""
        now_ns = self.rig.clock.now_ns()
        for electrode in range(self.count):
            assert self.got_pc(electrode) <= self.ledger.charge_pc(electrode, now_ns) + 1.0
