"""What a daemon drives its board with, each part made once and put to the others.

Owns: which parts there are, and what each is made of. Must not know: states, leases, what is asked
of them, and when.
"""

from __future__ import annotations

from collections.abc import Sequence

from etd.config import LoadedConfig
from etd.engine.asking import Asker
from etd.engine.contact import ContactMap
from etd.engine.dialogue import Dialogue
from etd.engine.duty import BusyClock
from etd.engine.impedance import ImpedanceMap
from etd.engine.looking_ahead import LookingAhead
from etd.engine.opening import Opening
from etd.engine.reporting import Reporter
from etd.engine.scan import Scanner
from etd.engine.sensors import PressureSensors, RailSensor
from etd.engine.sharing import Sharing
from etd.engine.stopper import Stopper
from etd.engine.timeouts import Timeouts
from etd.engine.visits import Tools, Visitor
from etd.ledger import Bounds, Ledger
from etd.maxima import maxima_of
from etd.stabilize.pipeline import Stabilizer
from etd.stabilize.settings import pipeline
from etd_hal.backend import Backend
from etd_hal.board import Board


class Parts:
    """See the module. `stabilizers` None: those of the body-site file."""

    def __init__(
        self, loaded: LoadedConfig, backend: Backend, stabilizers: Sequence[Stabilizer] | None
    ) -> None:
        source, electrodes = loaded.board.source, loaded.array.count
        self.loaded = loaded
        self.backend = backend
        self.marker = backend.marker
        #: The board's, with which all is timed that happens on it.
        self.clock = BusyClock(backend.clock)
        #: The machine's, on which ttl, lease and the gateway's silence count.
        self.host_clock = backend.host_clock
        self.timeouts = Timeouts(backend.timeout_factor)
        self.board = Board(loaded.board, loaded.machine, backend.spi, backend.gpio, self.clock)
        self.stopper = Stopper(self.board, backend.clock)
        self.rail = RailSensor(loaded.board, backend.i2c, backend.clock)
        self.pressure = PressureSensors(loaded.array, backend.i2c, backend.clock)
        self._dialogue = Dialogue(self.timeouts.silence_ns)
        self.reporter = Reporter(electrodes, self._dialogue.send, self.pressure.told)
        self.scanner = Scanner(self.board, self.clock, self.host_clock, self.marker, self.reporter)
        # What bounds a pulse.
        self.maxima = maxima_of(loaded.board, loaded.body_site)
        self.ledger = Ledger(electrodes, Bounds.of(self.maxima))
        self.opening = Opening(self.maxima.current_ua)
        # What is known of the electrodes, and who asks by it.
        self.contact = ContactMap(electrodes, source, loaded.body_site.contact)
        self.sharing = Sharing(electrodes)
        impedance = ImpedanceMap(electrodes, source)
        self.ahead = LookingAhead(electrodes, self.contact, impedance)
        if stabilizers is None:
            stabilizers = pipeline(loaded.body_site.stabilize, source, self.reporter.not_believed)
        self.asker = Asker(stabilizers, self.contact, impedance, self.pressure, self.reporter)
        self._tools = Tools(
            self.board,
            self.clock,
            self.maxima,
            self.ledger,
            self.opening,
            self.contact,
            self.sharing,
            self.reporter,
            self.asker,
            self.ahead,
        )
        self._visitor = Visitor(self._tools)
