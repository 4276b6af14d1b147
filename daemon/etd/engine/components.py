"""What a daemon drives its board with: each component made once, and handed to those that use it.

Owns: which components there are, and what each is made of. Must not know: states, leases, what is
asked of a component, and when.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from etd.config import LoadedConfig
from etd.engine.active_schedule import ActiveSchedule
from etd.engine.asking import Asker
from etd.engine.clearance import Clearance
from etd.engine.contact import ContactMap
from etd.engine.dialogue import Dialogue
from etd.engine.duty import BusyClock
from etd.engine.findings import Findings
from etd.engine.impedance import ImpedanceMap
from etd.engine.looking_ahead import LookingAhead
from etd.engine.opening import Opening
from etd.engine.reporting import Reporter
from etd.engine.requests import Requests
from etd.engine.sensors import PressureSensors, RailSensor
from etd.engine.sharing import Sharing
from etd.engine.stopper import Stopper, StopperLiveness
from etd.engine.timeouts import Timeouts
from etd.firing import Firing
from etd.ledger import Bounds, Ledger
from etd.maxima import MaximaInForce, maxima_of
from etd.stabilize.pipeline import Stabilizer
from etd.stabilize.settings import pipeline
from etd_hal.backend import Backend
from etd_hal.board import Board
from etd_hal.ports import Clock


@dataclass(slots=True)
class Components:
    """One of each, for as long as the engine runs: a new lease does not forget the ledger."""

    loaded: LoadedConfig
    backend: Backend
    #: The board's, with which all is timed that happens on it.
    clock: BusyClock
    #: The machine's, on which ttl, lease and the gateway's silence count.
    host_clock: Clock
    timeouts: Timeouts
    board: Board
    stopper: Stopper
    stopper_liveness: StopperLiveness
    dialogue: Dialogue
    reporter: Reporter
    active: ActiveSchedule
    # What is measured beside pulses.
    rail: RailSensor
    pressure: PressureSensors
    # What bounds a pulse.
    maxima: MaximaInForce
    ledger: Ledger
    opening: Opening
    sharing: Sharing
    clearance: Clearance
    # What is known of the electrodes, and what is requested by it.
    contact: ContactMap
    impedance: ImpedanceMap
    ahead: LookingAhead
    asker: Asker
    requests: Requests
    # What becomes of a pulse.
    firing: Firing
    findings: Findings


def components_of(
    loaded: LoadedConfig, backend: Backend, stabilizers: Sequence[Stabilizer] | None = None
) -> Components:
    """`stabilizers` None: those of the body-site file."""
    source, electrodes = loaded.board.source, loaded.array.count
    clock = BusyClock(backend.clock)
    board = Board(loaded.board, loaded.machine, backend.spi, backend.gpio, clock)
    stopper = Stopper(board, backend.clock)
    timeouts = Timeouts(backend.timeout_factor)
    dialogue = Dialogue(timeouts.silence_ns)
    pressure = PressureSensors(loaded.array, backend.i2c, backend.clock)
    reporter = Reporter(electrodes, dialogue.send, pressure.told)
    declared = maxima_of(loaded.board, loaded.body_site)
    maxima = MaximaInForce(declared)
    ledger = Ledger(electrodes, Bounds.of(declared))
    opening, sharing = Opening(declared.current_ua), Sharing(electrodes)
    contact = ContactMap(electrodes, source, loaded.body_site.contact)
    impedance = ImpedanceMap(electrodes, source)
    ahead = LookingAhead(electrodes, contact, impedance)
    if stabilizers is None:
        stabilizers = pipeline(loaded.body_site.stabilize, source, reporter.not_believed)
    asker = Asker(stabilizers, contact, impedance, pressure, reporter)
    is_quick = not board.switch.can_choose_returns
    return Components(
        loaded=loaded,
        backend=backend,
        clock=clock,
        host_clock=backend.host_clock,
        timeouts=timeouts,
        board=board,
        stopper=stopper,
        stopper_liveness=StopperLiveness(stopper),
        dialogue=dialogue,
        reporter=reporter,
        active=ActiveSchedule(clock, reporter),
        rail=RailSensor(loaded.board, backend.i2c, backend.clock),
        pressure=pressure,
        maxima=maxima,
        ledger=ledger,
        opening=opening,
        sharing=sharing,
        clearance=Clearance(board, maxima, ledger, opening, contact, sharing, reporter),
        contact=contact,
        impedance=impedance,
        ahead=ahead,
        asker=asker,
        requests=Requests(asker, ahead, contact, sharing, reporter, is_quick=is_quick),
        firing=Firing(board, ledger, clock),
        findings=Findings(maxima, opening, contact, sharing, asker, ahead, reporter),
    )
