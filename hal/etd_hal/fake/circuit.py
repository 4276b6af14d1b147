"""One fake board behind its wires, put together.

Owns: the wiring of chips, rail, switch, body and buses (`gpio`, `spi`, `i2c`). Every call comes
with the time it starts at and answers with the time it ends at.
Must not know: clocks, threads, sockets.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from etd_body.interface import Side, Sides
from etd_hal.boardfile import BoardFile, Relays
from etd_hal.errors import BusError
from etd_hal.fake.currentpath import CurrentPath
from etd_hal.fake.faults import Bridge, Fault
from etd_hal.fake.faults_due import Faults
from etd_hal.fake.halfbridges import HalfBridgeChain
from etd_hal.fake.header import Header
from etd_hal.fake.i2cbus import I2cBus
from etd_hal.fake.machines import PI4, MachineModel
from etd_hal.fake.pressure_sensors import (
    FakePressureSensors,
    PressureModel,
    SensorUnderArray,
    lying,
)
from etd_hal.fake.rail import Rail
from etd_hal.fake.relays import RelayChain
from etd_hal.fake.spibus import SpiBus
from etd_hal.fake.timeline import Timeline
from etd_hal.fake.trace import Trace
from etd_hal.fake.world import Touchable, World
from etd_hal.ports import LineSetup, SpiSetup

#: Above this, two closed relays of one electrode would carry current.
_RAIL_IS_UP_V = 30.0


class Circuit:
    """See the module. `electrodes[i]` is the chain output of the body's electrode i; `sensors` are
    under the array, and `pressing` is what they feel of the body.
    """

    def __init__(
        self,
        board: BoardFile,
        body: Touchable,
        electrodes: Sequence[int],
        trace: Trace,
        faults: Iterable[Fault],
        *,
        start_ns: int,
        seed: int,
        sensors: Sequence[SensorUnderArray] = (),
        pressing: PressureModel = lying,
        machine: MachineModel = PI4,
    ) -> None:
        self.board = board
        self._trace = trace
        self._timeline = Timeline(start_ns, trace)
        self._faults = faulty = Faults(faults, board.used_lines())
        self._rail = Rail(board, faulty, start_ns)
        self._switch = self._make_switch(electrodes, faulty, seed)
        self._path = CurrentPath(
            board, body, self._rail, faulty, trace, self._switch.sides, self._switch.settle
        )
        self._path.set_sides(start_ns, self._switch.sides, self._switch.shorted)
        self._timeline.before_call.append(self._path.settle)
        self._timeline.reached.append(lambda: self._path.reached_ns)
        self.gpio = Header(
            board, self._switch, self._path, self._rail, faulty, self._timeline, trace, machine
        )
        self.spi = SpiBus(board.source, self._path, faulty, self._timeline, trace, machine)
        pressed = FakePressureSensors(sensors, pressing)
        self.world = World(
            body,
            electrodes,
            self._rail,
            faulty,
            pressed,
            self.gpio.move_stop,
            self.gpio.give_edge,
            self.now_ns,
        )
        self.i2c = I2cBus(board, self._rail, faulty, pressed, self._timeline, trace, machine)
        trace.begin(board, electrodes)

    @property
    def violations(self) -> list[str]:
        """The rules that were broken, each with its time."""
        return self._timeline.violations

    @property
    def dac_code(self) -> int:
        """What the DAC's output stands at."""
        return self._path.code

    @property
    def sides(self) -> Sides:
        """What the switch connects, per electrode."""
        return self._switch.sides

    def now_ns(self) -> int:
        """The time of the last thing that happened."""
        return self._timeline.now_ns

    def settle(self, t_ns: int) -> None:
        """What goes on by itself until `t_ns`."""
        self._path.settle(t_ns)

    def request(self, t_ns: int, lines: LineSetup, spi: SpiSetup) -> int:
        """Take the lines, with their initial levels, and open the SPI device.

        Raises: BusError (`busy`, `invalid`, `absent`).
        """
        end_ns = self.gpio.request(t_ns, lines)
        try:
            self.spi.open(spi)
        except BusError:
            self.gpio.release()
            raise
        return end_ns

    def release(self) -> None:
        """Let go of everything; outputs keep their levels."""
        self.gpio.release()
        self.spi.close()
        self._trace.write()

    def mark(self, t_ns: int, event: str, seq: int, tag: int | str | None) -> None:
        """The engine's remark: for the trace alone."""
        self._trace.engine(self._timeline.start(t_ns), event, seq, tag)
        self._trace.write()

    def close(self) -> None:
        """The end of the board: the DAC must stand at zero."""
        if self._path.code:
            what = f"the DAC was left at code {self._path.code}"
            self._timeline.complain(self._timeline.now_ns, what)
        self._trace.close()

    def _make_switch(
        self, electrodes: Sequence[int], faults: Faults, seed: int
    ) -> HalfBridgeChain | RelayChain:
        switch = self.board.switch
        for electrode, output in enumerate(electrodes):
            if not 0 <= output < switch.outputs:
                raise ValueError(f"electrode {electrode} is on output {output} of {switch.outputs}")
        if isinstance(switch, Relays):
            return RelayChain(switch, electrodes, faults, self._relays_moved, seed=seed)
        return HalfBridgeChain(switch.outputs, electrodes, faults, self._outputs_changed, seed=seed)

    def _outputs_changed(self, t_ns: int, sides: Sides) -> None:
        self._path.set_sides(t_ns, sides, self._is_bridged(sides))

    def _relays_moved(self, t_ns: int, sides: Sides, shorted: bool) -> None:
        if shorted and (self._path.code or self._rail.volts(t_ns) > _RAIL_IS_UP_V):
            what = "both relays of one electrode closed while current can flow"
            self._timeline.complain(t_ns, what)
        self._path.set_sides(t_ns, sides, shorted or self._is_bridged(sides))

    def _is_bridged(self, sides: Sides) -> bool:
        """Solder leads from the source to ground."""
        return any(
            {sides[bridge.first], sides[bridge.second]} == {Side.SOURCE, Side.GROUND}
            for bridge in self._faults.of(Bridge)
        )
