"""The components of an engine: each made once, and handed to those that use it.

Owns: which components there are, and what each is made of. Must not know: states, leases, what a
component is used for, and when.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from etd.engine.active_schedule import ActiveSchedule
from etd.engine.clearance import Clearance
from etd.engine.computing import MeasuredComputing
from etd.engine.cpu_budget import CpuBudget
from etd.engine.feeling import Feeling
from etd.engine.findings import Findings
from etd.engine.gateway_link import GatewayLink
from etd.engine.machine_watch import MachineWatch
from etd.engine.node_check import NodeCheck
from etd.engine.opening import Opening
from etd.engine.pulse_log import PulseLog
from etd.engine.reporting import Reporter
from etd.engine.requests import Requests
from etd.engine.returns import Returns
from etd.engine.source_check import SourceCheck
from etd.engine.stimulus_adapter import StimulusAdapter
from etd.engine.stopper import StopperLiveness
from etd.engine.timeouts import Timeouts
from etd.files.calibration_process import CalibrationReader
from etd.files.configuration import LoadedConfig
from etd.firing import Firing
from etd.safety.ledger import Bounds, Ledger
from etd.safety.maxima import MaximaInForce, maxima_of
from etd.safety.soft_start import SoftStart
from etd.sensing.contact import ContactMap
from etd.sensing.impedance import ImpedanceMap
from etd.sensing.pre_probe import PreProbe
from etd.sensing.readings import Readings
from etd.sensing.scan_core import ScanCoreReading
from etd.sensing.sensors import PressureSensors, RailSensor, slots_of
from etd.stabilize.pipeline import Stabilizer
from etd.stabilize.settings import pipeline
from etd_hal.backend import Backend
from etd_hal.board import Board
from etd_hal.ports import Clock
from etd_hal.supply_note import SupplyNote


@dataclass(slots=True)
class Components:
    """One of each, for as long as the engine runs: a new lease does not reset the ledger."""

    loaded: LoadedConfig
    backend: Backend
    #: The board's clock, which times all that happens on the board.
    clock: CpuBudget
    #: What this machine computes for a pulse.
    computing: MeasuredComputing
    #: The machine's clock, on which ttl, lease and the gateway's silence count.
    host_clock: Clock
    timeouts: Timeouts
    board: Board
    stopper_liveness: StopperLiveness
    gateway_link: GatewayLink
    opening: Opening
    reporter: Reporter
    active: ActiveSchedule
    # What is measured beside pulses, and where the sensors' last values are.
    readings: Readings
    rail: RailSensor
    pressure: PressureSensors
    scan_core: ScanCoreReading
    # What bounds a pulse.
    maxima: MaximaInForce
    ledger: Ledger
    soft_start: SoftStart
    returns: Returns
    clearance: Clearance
    # What is known of the electrodes, and the requests that follow from it.
    contact: ContactMap
    impedance: ImpedanceMap
    pre_probe: PreProbe
    feeling: Feeling
    adapter: StimulusAdapter
    requests: Requests
    # What becomes of a pulse.
    firing: Firing
    source_check: SourceCheck
    machine_watch: MachineWatch
    findings: Findings
    pulse_log: PulseLog


def components_of(
    loaded: LoadedConfig,
    backend: Backend,
    reader: CalibrationReader,
    stabilizers: Sequence[Stabilizer] | None = None,
    supply_note: SupplyNote | None = None,
) -> Components:
    """`stabilizers` None: those of the body-site file."""
    source, electrodes = loaded.board.source, loaded.array.count
    timeouts = Timeouts(backend.timeout_factor)
    dialogue = GatewayLink(timeouts.silence_ns)
    readings = Readings(slots_of(loaded.array))
    scan_core = ScanCoreReading(readings, backend.clock, backend.scan_core)
    clock = CpuBudget(backend.clock, backend.wakeups, scan_core.is_left_alone)
    board = Board(loaded.board, loaded.machine, backend.codec, backend.spi, backend.gpio, clock)
    pressure = PressureSensors(loaded.array, backend.i2c, backend.clock, readings)
    pulse_log = PulseLog(dialogue.send)
    reporter = Reporter(electrodes, dialogue.send, pressure.kpa_of_all)
    declared = maxima_of(loaded.board, loaded.body_site)
    maxima = MaximaInForce(declared)
    ledger = Ledger(electrodes, Bounds.of(declared))
    soft_start, returns = SoftStart(declared.current_ua), Returns(electrodes, source, ledger)
    contact = ContactMap(electrodes, source, loaded.body_site.contact)
    impedance = ImpedanceMap(electrodes, source)
    ahead = PreProbe(electrodes, contact, impedance)
    if stabilizers is None:
        stabilizers = pipeline(loaded.body_site.stabilize, source, reporter.rejected)
    feeling = Feeling(electrodes, may_raise=loaded.body_site.felt_may_raise)
    adapter = StimulusAdapter(
        stabilizers,
        contact,
        impedance,
        pressure,
        reporter,
        feeling,
        loaded.board.name,
        source.leak_ohm,
    )
    firing = Firing(board, ledger, clock, NodeCheck(board).check)
    is_quick = not board.switch.can_choose_returns
    return Components(
        loaded=loaded,
        backend=backend,
        clock=clock,
        computing=MeasuredComputing(clock, loaded.machine.visit_us),
        host_clock=backend.host_clock,
        timeouts=timeouts,
        board=board,
        stopper_liveness=StopperLiveness(
            board.cut, supply_note, most_silent_ns=timeouts.stopper_silence_ns
        ),
        gateway_link=dialogue,
        opening=Opening(reader),
        reporter=reporter,
        active=ActiveSchedule(clock, reporter),
        readings=readings,
        rail=RailSensor(loaded.board, backend.i2c, backend.clock, readings),
        pressure=pressure,
        scan_core=scan_core,
        maxima=maxima,
        ledger=ledger,
        soft_start=soft_start,
        returns=returns,
        clearance=Clearance(board, maxima, ledger, soft_start, contact, returns, reporter, feeling),
        contact=contact,
        impedance=impedance,
        pre_probe=ahead,
        feeling=feeling,
        adapter=adapter,
        requests=Requests(adapter, ahead, contact, returns, reporter, is_quick=is_quick),
        firing=firing,
        source_check=SourceCheck(board, maxima, firing),
        machine_watch=MachineWatch(backend.troubles, reporter.counters),
        findings=Findings(
            maxima, soft_start, contact, returns, adapter, ahead, reporter, pulse_log, feeling
        ),
        pulse_log=pulse_log,
    )
