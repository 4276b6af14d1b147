"""The board under test: its figures, its ports, its load, its operator.

Owns: waiting (with the heartbeat running and, while the supply is on, the stop lines watched), and
reading the rail. Must not know: what is checked, reports, what is printed.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from etd.files.configuration import LoadedConfig
from etd.selftest.beats import Beats
from etd.selftest.subject import subject_of
from etd_hal.backend import Bench, StopperTask
from etd_hal.bench import Health, Operator, StopName
from etd_hal.board import Board
from etd_hal.chips import ads1115
from etd_hal.errors import BoardFault, BusError
from etd_hal.ports import I2c

MS = 1_000_000
_TICK_NS = 5 * MS


#: Options named in the advice of skipped checks.
SECOND_LOAD_OPTION = "--second-load OHM"
LOAD_OPTIONS = f"--dummy-load OHM {SECOND_LOAD_OPTION} --load-electrodes A,B"


@dataclass(frozen=True, slots=True)
class DummyLoad:
    """A resistor between two electrodes; to name it confirms that no person is connected."""

    resistance_ohm: int
    first: int
    second: int


@dataclass(frozen=True, slots=True)
class SelftestOptions:
    load: DummyLoad | None = None
    #: The one-shot's time by an oscilloscope; software cannot measure it.
    one_shot_us: int | None = None
    #: A second resistor, which replaces the first one when the operator is asked to.
    second_load: DummyLoad | None = None


class Fixture:
    """`operator` None: no person is at the board."""

    def __init__(
        self, loaded: LoadedConfig, bench: Bench, operator: Operator | None, asked: SelftestOptions
    ) -> None:
        self.loaded = loaded
        self.file = loaded.board
        self.host = bench.host
        backend = bench.backend
        self.backend_name = backend.name
        self.subject = subject_of(loaded, backend.name, backend.identity)
        self.clock = backend.clock
        self.gpio = backend.gpio
        self.kill_test_process = bench.kill_test_process
        self.operator = operator
        self.options = asked
        self.board = Board(
            loaded.board, loaded.machine, backend.codec, backend.spi, backend.gpio, self.clock
        )
        self.beats = Beats(self.board, self.clock)
        #: The load was measured at its electrodes, and all others are open.
        self.is_load_confirmed = False
        #: The stop that the operator is asked to hold open now.
        self.held_stop: StopName | None = None
        #: As measured with the load; the board file's until then.
        self.leak_ohm = float(loaded.board.source.leak_ohm)
        #: Measured over commanded current, as measured with the load.
        self.gain = 1.0
        #: The machine's, before anything was switched.
        self.health_before: Health | None = None
        self._i2c = backend.i2c
        self._beside = backend.beside
        self._stopper: StopperTask | None = None
        #: Another process holds the lines: this process cannot read a stop.
        self.is_lent = False

    @property
    def free(self) -> list[int]:
        """The electrodes without the load."""
        load = self.options.load
        taken = () if load is None else (load.first, load.second)
        return [electrode for electrode in range(self.loaded.array.count) if electrode not in taken]

    @property
    def i2c(self) -> I2c:
        """Raises: BoardFault without one; the rules of board files exclude that."""
        if self._i2c is None:
            raise BoardFault("I2C", "not open", "a bus for the chips that the board file names")
        return self._i2c

    def start_stopper(self) -> StopperTask:
        """Beside the test until `end_stopper`; it holds the lines too, so they cannot be lent any
        more. It is above this thread, as it is above the engine's. Raises: BusError.
        """
        if self._beside is None:
            raise BusError("absent", "the stopper", "beginning", "this bench starts no process")
        wanted, board = self.loaded.config.engine, self.board
        self._stopper = self._beside.stopper(
            board.cut, board.safe_changes, None, wanted.stopper_priority, wanted.scan_core
        )
        return self._stopper

    def end_stopper(self) -> None:
        """Idempotent. It cuts once more, and the lines are this process' alone."""
        if self._stopper is not None:
            self._stopper.end()
            self._stopper = None

    def end_beats(self, level: int) -> None:
        """End with the line at `level`; wait without beats from now on."""
        if self.beats.every_ms is not None and self.board.heartbeat_level == level:
            self.beats.beat()
            self.wait_ms(self.beats.every_ms, is_beating=False)
        self.beats.beat()

    def supply_on(self) -> None:
        """With the first beat."""
        self.board.supply_on()
        self.beats.begin()

    def watch_stops(self) -> None:
        """Raises: BoardFault when a stop line is open that the operator was not asked to hold."""
        for name, is_open in self.board.stops().items():
            if is_open and name != self.held_stop:
                raise BoardFault(name, "open", "closed during the test")

    def wait_ms(self, duration_ms: float, is_beating: bool = True) -> None:
        """Sleep, as `wait_until`."""
        self.wait_until(lambda: False, duration_ms, is_beating)

    def wait_until(
        self, is_done: Callable[[], bool], within_ms: float, is_beating: bool = True
    ) -> bool:
        """Poll `is_done`; False if it was not true in time.

        Raises: BoardFault as `watch_stops`, within a tick, while the supply is on.
        """
        until_ns = self.clock.now_ns() + int(within_ms * MS)
        while not is_done():
            now_ns = self.clock.now_ns()
            if now_ns >= until_ns:
                return False
            self.clock.doze_until_ns(min(until_ns, now_ns + _TICK_NS))
            if self.board.is_supply_on and not self.is_lent:
                self.watch_stops()
            if is_beating:
                self.beats.beat_if_due()
        return True

    def rail_v(self, is_beating: bool = True) -> float:
        """A fresh reading of the rail's monitor. Raises: BusError, BoardFault without a monitor."""
        monitor = self.file.guards.rail_monitor
        if monitor == "absent":
            raise BoardFault("rail monitor", "absent", "a rail monitor")
        volts = ads1115.convert_v(
            self.i2c,
            monitor.address,
            monitor.channel,
            lambda duration_ns: self.wait_ms(duration_ns / MS, is_beating),
        )
        return volts * monitor.divider
