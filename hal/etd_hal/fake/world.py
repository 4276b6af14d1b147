"""The fake board's second interface: contacts, inputs, sensors and faults, for tests and demos.

Owns: its methods. Must not know: buses, words.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Protocol

from etd_body.electrode import OPEN_CONTACT, Contact
from etd_body.interface import Body
from etd_hal.bench import EdgeName, StopName
from etd_hal.fake.faults import Fault, OutputSeries
from etd_hal.fake.faults_due import Faults
from etd_hal.fake.host import FakeHost
from etd_hal.fake.pressure_sensors import FakePressureSensors
from etd_hal.fake.rail import Rail


class Touchable(Body, Protocol):
    """A body whose contacts can be changed from outside."""

    def contact(self, electrode: int) -> Contact: ...

    def touch(self, t_ns: int, electrode: int, contact: Contact) -> None: ...


class World:
    """Changes a board from outside its ports."""

    def __init__(
        self,
        body: Touchable,
        electrodes: Sequence[int],
        rail: Rail,
        faults: Faults,
        pressed: FakePressureSensors,
        move_line: Callable[[StopName, int, int | None], None],
        give_edge: Callable[[EdgeName, int, int | None], None],
        now_ns: Callable[[], int],
    ) -> None:
        self.body = body
        self._electrodes = electrodes
        self._rail = rail
        self._faults = faults
        self._move_line = move_line
        self._give_edge = give_edge
        self._now_ns = now_ns
        self._pressed = pressed
        #: The machine that drives the board.
        self.host = FakeHost(faults)

    def press(self, stop: StopName, at_ns: int | None = None) -> None:
        """Open the loop of a stop line; without a time at once."""
        self._move_line(stop, 0, at_ns)

    def release(self, stop: StopName, at_ns: int | None = None) -> None:
        """Close the loop of a stop line."""
        self._move_line(stop, 1, at_ns)

    def trigger(self, at_ns: int | None = None, lasts_ns: int = 1_000_000) -> None:
        """Another instrument gives an edge on the trigger; without a time at once. Raises:
        ValueError for a board without one.
        """
        self._give_edge("trigger", lasts_ns, at_ns)

    def say_too_strong(self, at_ns: int | None = None, lasts_ns: int = 100_000_000) -> None:
        """The wearer presses the button for it; without a time at once. Raises: ValueError for a
        board without one.
        """
        self._give_edge("too_strong", lasts_ns, at_ns)

    def touch(self, electrode: int, contact: Contact) -> None:
        """Put something else under an electrode."""
        in_the_way_ohm = sum(
            fault.resistance_ohm
            for fault in self._faults.of(OutputSeries)
            if fault.output == self._electrodes[electrode]
        )
        behind = replace(contact, series_ohm=contact.series_ohm + in_the_way_ohm)
        self.body.touch(self._now_ns(), electrode, behind)

    def lift(self, electrode: int) -> None:
        """Take the skin off an electrode."""
        self.touch(electrode, OPEN_CONTACT)

    def put_in(self, fault: Fault) -> None:
        """Raises: ValueError for a line that the board has nothing behind."""
        self._faults.add(fault)

    def take_out(self, fault: Fault) -> None:
        """Raises: KeyError when the fault is not in."""
        self._faults.remove(fault)

    def mend(self) -> None:
        """Take every fault out."""
        self._faults.clear()

    @property
    def is_supply_enabled(self) -> bool:
        """The enable line says on; always, on a board without one."""
        return self._rail.enabled

    def rail_v(self) -> float:
        return self._rail.volts(self._now_ns())

    def set_sensor_v(self, address: int, channel: int, volts: float | None) -> None:
        """The voltage at an input of an ADS1115 (not the rail's own input); None leaves it to what
        presses there.
        """
        self._pressed.put_v(address, channel, volts)

    def press_array(self, kpa: float) -> None:
        """What all sensors under the array are pressed with from now on."""
        self._pressed.press(kpa)
