"""The choice of a backend: the only module that knows both `linux` and `fake`.

Owns: how the ports of either backend are opened and closed, and which codec belongs to the chips
behind them. It is part of the HAL so that making a board safe needs the HAL and the standard
library only.
Must not know: configuration files other than board and machine, frames, people.
"""

from __future__ import annotations

import dataclasses
import datetime
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from etd_hal.backend import Backend, Bench, ReplayStage
from etd_hal.bench import ScanCore
from etd_hal.boardfile import BoardFile, MachineFile, Source
from etd_hal.chips import ad5452, ad7276
from etd_hal.chips.codec import Codec
from etd_hal.errors import BusError
from etd_hal.linesetup import line_setup, spi_setup
from etd_hal.modelled_fingers import OWN, Finger
from etd_hal.ports import Gpio, I2c, Message, Spi
from etd_hal.unwired import NoMarker
from etd_hal.wakeups import NotingClock

if TYPE_CHECKING:
    from etd_hal.fake.board import FakeBoard, FakePorts
    from etd_hal.fake.clock import BoardClock
    from etd_hal.fake.machines import MachineModel
    from etd_hal.fake.pressure_sensors import SensorUnderArray
    from etd_hal.fake.remote import RemotePorts

_WORDS = {"AD5452": ad5452.word}
_SAMPLES = {"AD7276": ad7276.code_of}


def codec_of(source: Source) -> Codec:
    """The words of the board file's DAC and ADC."""
    return Codec(_WORDS[source.dac], _SAMPLES[source.adc])


class NoSpi:
    """Stands for an SPI device that cannot be opened, so that the board is made safe without it."""

    def __init__(self, device: str, reason: str) -> None:
        self._device = device
        self._reason = reason

    def prepare(self, message: Message) -> None:
        """Does nothing; `transfer` raises."""

    def transfer(self, message: Message) -> tuple[bytes, ...]:  # noqa: ARG002
        """Raises: BusError (absent), always."""
        raise BusError("absent", self._device, "reaching the DAC", self._reason)


def open_linux(board: BoardFile, machine: MachineFile) -> Backend:
    """Open the kernel's drivers. Raises: HardwareMissing, listing all that is missing."""
    from etd_hal.linux.beside import LinuxBeside
    from etd_hal.linux.opening import open_ports

    spi, gpio, i2c, clock = open_ports(board, machine, line_setup(board))
    backend = _on_kernel(board, spi, gpio, i2c, clock)
    device = None if board.i2c == "absent" else board.i2c
    facts = (*backend.facts, gpio.fact)
    return dataclasses.replace(backend, facts=facts, beside=LinuxBeside(gpio, device))


def _on_kernel(
    board: BoardFile, spi: Spi, gpio: Gpio, i2c: I2c | None, clock: NotingClock
) -> Backend:
    from etd_hal.linux import host, realtime, scan_core
    from etd_hal.linux import machine as this_machine

    def close() -> None:
        for port in (spi, gpio, i2c):
            closing = getattr(port, "close", None)
            if closing is not None:
                closing()

    return Backend(
        "linux",
        spi,
        gpio,
        i2c,
        clock,
        NoMarker(),
        close,
        host_clock=clock,
        codec=codec_of(board.source),
        wakeups=clock.wakeups,
        facts=this_machine.facts(),
        troubles=lambda: host.health().troubles,
        identity=this_machine.identity(),
        set_up_realtime=realtime.set_up,
        set_up_urgent_thread=realtime.scheduling,
        scan_core=scan_core.scan_core,
    )


def open_linux_safe(board: BoardFile) -> tuple[Backend, tuple[str, ...]]:
    """Open what is there of a board that must be made safe: its lines, and SPI if possible.

    Returns the backend and a sentence for each thing that is missing; the lines are driven to
    harmless levels already. Raises: HardwareMissing (the lines cannot be opened).
    """
    from etd_hal.linux.clock import LinuxClock
    from etd_hal.linux.opening import open_to_make_safe

    gpio, opened, problems = open_to_make_safe(board, line_setup(board))
    spi = opened or NoSpi(board.source.spi, "SPI could not be opened")

    def close() -> None:
        gpio.close()
        if opened is not None:
            opened.close()

    clock, codec = LinuxClock(), codec_of(board.source)
    return (
        Backend("linux", spi, gpio, None, clock, NoMarker(), close, host_clock=clock, codec=codec),
        problems,
    )


def open_fake(
    board: BoardFile,
    *,
    electrodes: Sequence[int],
    positions_mm: Sequence[tuple[float, float]] | None = None,
    trace: Path | None = None,
    board_socket: Path | None = None,
    stepped: bool = False,
    sensors: Sequence[SensorUnderArray] = (),
    timeout_factor: int = 1,
    machine: str | None = None,
    finger: Finger = OWN,
) -> Backend:
    """A fake board with a fingertip on it, in this process or behind a board process's socket.

    With `positions_mm`, an (x, y) for each electrode, the fingertip is modelled: it changes, and
    reports what it feels (`Backend.modelled`); `finger` says which it is. Without, and in a board
    process, it only conducts.
    `stepped` time passes only by being spent or slept, in one thread and without sockets; otherwise
    it follows the real clock. A board process writes its own trace. `timeout_factor` lengthens a
    frame's ttl, the lease and the gateway's silence, for a busy machine. `sensors` under the array
    measure the fingertip's pressure; a board process has those that it was started with. With a
    `machine` of `MODELLED_MACHINES` its calls, and computing, take the time that they would take
    there; without, calls take that of a pi4, and computing none. Raises: BusError (`absent` without
    a board process, `busy` while another client has it).
    """
    from etd_hal.fake.clock import LiveClock, SteppedClock
    from etd_hal.fake.machines import MACHINES, PI4
    from etd_hal.fake.processor import StagedTime, ThreadTime
    from etd_hal.linux.clock import LinuxClock, thread_time_ns

    if board_socket is not None:
        if stepped or trace is not None or machine is not None:
            raise ValueError("a board process has live time, its own trace and its own times")
        backend = _open_board_process(board, board_socket, LiveClock(LinuxClock()))
    else:
        model, staged, live, late_ns = PI4, None, None, None
        if machine is not None:
            model = MACHINES[machine]
            staged = StagedTime(model.slowness)
            live = ThreadTime(model.slowness, thread_time_ns)
            late_ns = model.wake_late
        clock: BoardClock = (
            SteppedClock(processor=staged, wake_late_ns=late_ns)
            if stepped
            else LiveClock(LinuxClock(), live, late_ns)
        )
        backend = _open_in_process(
            board, electrodes, positions_mm, trace, clock, sensors, model, finger
        )
    if machine is not None:
        fact = f"modelled: {machine}, on which computing takes {model.slowness:g} times as long"
        backend = dataclasses.replace(backend, facts=(fact,))
    return dataclasses.replace(backend, timeout_factor=timeout_factor)


def open_replay(
    board: BoardFile, *, electrodes: Sequence[int], sensors: Sequence[SensorUnderArray] = ()
) -> ReplayStage:
    """A fake board in stepped time, whose pulses measure what its SPI is told to expect."""
    from etd_hal.fake.board import FakeBoard
    from etd_hal.fake.clock import SteppedClock
    from etd_hal.fake.fingertip import fingertip_body
    from etd_hal.fake.replayed import ReplayedSpi

    clock = SteppedClock()
    fake = FakeBoard(
        board,
        clock,
        fingertip_body(board, len(electrodes)),
        electrodes=electrodes,
        sensors=sensors,
    )
    ports = fake.request(line_setup(board), spi_setup(board))
    spi = ReplayedSpi(ports.spi, board.source, lambda: fake.sides)
    backend = dataclasses.replace(_on_fake(board, ports, clock, ports.close), spi=spi)
    return ReplayStage(_with_wearer(board, fake, backend), spi, clock.at)


def open_linux_bench(board: BoardFile, machine: MachineFile) -> Bench:
    """A real board. Raises: HardwareMissing, BusError.

    Its lines are released once, to see whether they keep their levels: these are harmless then.
    """
    # This call reports what is missing, packages included; they are imported only after it.
    open_linux(board, machine).close()
    from etd_hal.linux.beside import LinuxBeside
    from etd_hal.linux.gpio import find_chip, keeps_driving
    from etd_hal.linux.host import LinuxHost
    from etd_hal.linux.kill_test_process import LentGpio, LinuxKillTestProcess
    from etd_hal.linux.opening import open_lines, open_ports

    setup = line_setup(board)
    keeps_pins = keeps_driving(find_chip(board.gpio_chip_labels), setup)
    spi, gpio, i2c, clock = open_ports(board, machine, setup)
    lent = LentGpio(gpio, lambda: open_lines(board, setup))
    device = None if board.i2c == "absent" else board.i2c
    backend = _on_kernel(board, spi, lent, i2c, clock)
    return Bench(
        dataclasses.replace(backend, beside=LinuxBeside(lent, device)),
        LinuxHost(machine, keeps_pins),
        None,
        LinuxKillTestProcess(board, setup, lent),
    )


def open_fake_bench(board: BoardFile, *, electrodes: Sequence[int]) -> Bench:
    """A fake board on a bench: no skin touches it, and its operator can clip any resistor to it.

    One thread drives it and is the only reader of the clock, so time only steps.
    """
    from etd_hal.fake.board import FakeBoard
    from etd_hal.fake.clock import SteppedClock
    from etd_hal.fake.fingertip import untouched
    from etd_hal.fake.kill_test_process import FakeKillTestProcess
    from etd_hal.fake.operator import FakeOperator
    from etd_hal.fake.stepped_beside import SteppedBeside

    clock = SteppedClock()
    fake = FakeBoard(board, clock, untouched(board, len(electrodes)), electrodes=electrodes)
    ports = fake.request(line_setup(board), spi_setup(board))
    backend = _on_fake(board, ports, clock, ports.close)
    return Bench(
        dataclasses.replace(backend, beside=SteppedBeside(ports.gpio, clock)),
        fake.world.host,
        FakeOperator(fake.world, clock),
        FakeKillTestProcess(fake, board, ports.gpio, line_setup(board), clock),
    )


def _open_in_process(
    board: BoardFile,
    electrodes: Sequence[int],
    positions_mm: Sequence[tuple[float, float]] | None,
    trace: Path | None,
    clock: BoardClock,
    sensors: Sequence[SensorUnderArray],
    machine: MachineModel,
    finger: Finger,
) -> Backend:
    from etd_hal.fake.board import FakeBoard
    from etd_hal.fake.fingertip import fingertip_body, living_fingertip
    from etd_hal.fake.jumper import GpioWithJumper
    from etd_hal.fake.pressure_sensors import lying
    from etd_hal.fake.trace import Trace

    living = None if positions_mm is None else living_fingertip(board, positions_mm, finger)
    fake = FakeBoard(
        board,
        clock,
        living or fingertip_body(board, len(electrodes)),
        electrodes=electrodes,
        trace=Trace.to(trace) if trace is not None else None,
        sensors=sensors,
        pressing=lying if living is None else living.pressure_kpa,
        machine=machine,
    )
    ports = fake.request(line_setup(board), spi_setup(board))

    def close() -> None:
        ports.close()
        fake.close()

    backend = _on_fake(board, ports, clock, close)
    backend = dataclasses.replace(backend, scan_core=fake.world.host.scan_core)
    backend = _with_wearer(board, fake, backend)
    if board.sync_line != "absent" and board.trigger != "absent":

        def give_edge() -> None:
            fake.ask_body(fake.world.trigger)

        wired = GpioWithJumper(backend.gpio, board.sync_line, give_edge)
        backend = dataclasses.replace(backend, gpio=wired)
    if living is None:
        return backend
    take_felt = living.take_felt
    return dataclasses.replace(backend, modelled=lambda: fake.ask_body(take_felt))


def _with_wearer(board: BoardFile, fake: FakeBoard, backend: Backend) -> Backend:
    """Where there is a wearer's stop, it is tried before each arming."""
    if board.guards.wearer_stop == "absent":
        return backend
    from etd_hal.fake.wearer import GpioWithWearer

    def try_stop() -> None:
        fake.world.press("wearer_stop")
        fake.world.release("wearer_stop")

    wearing = GpioWithWearer(backend.gpio, board.guards, lambda: fake.ask_body(try_stop))
    return dataclasses.replace(backend, gpio=wearing)


def _open_board_process(board: BoardFile, path: Path, clock: BoardClock) -> Backend:
    from etd_hal.fake.remote import open_remote

    ports = open_remote(path, clock, board, line_setup(board), spi_setup(board))
    return _on_fake(board, ports, clock, ports.close)


def _on_fake(
    board: BoardFile, ports: FakePorts | RemotePorts, clock: BoardClock, close: Callable[[], None]
) -> Backend:
    """A fake backend whose real-time settings are those of the machine's own kernel."""
    from etd_hal.linux import realtime

    return Backend(
        "fake",
        *(ports.spi, ports.gpio, ports.i2c, clock, ports.marker, close),
        host_clock=clock.host,
        codec=codec_of(board.source),
        wakeups=clock.wakeups,
        set_up_realtime=realtime.set_up,
        set_up_urgent_thread=realtime.scheduling,
    )


def set_up_realtime(priority: int, core: int | None) -> tuple[str, ...]:
    """Make the calling thread real-time; returns a sentence for each thing not granted."""
    from etd_hal.linux.realtime import set_up

    return set_up(priority, core)


def system_clock() -> NotingClock:
    """CLOCK_MONOTONIC, for a process that has no board."""
    from etd_hal.linux.clock import LinuxClock

    return LinuxClock()


def thread_time_ns() -> int:
    """What the calling thread has had of the processor."""
    from etd_hal.linux import clock

    return clock.thread_time_ns()


def machine_problem(machine: MachineFile) -> str | None:
    """Why this machine file cannot stand for this machine, with what to do; None if it can."""
    from etd_hal.linux import machine as this_machine

    return this_machine.problem(machine)


def machine_facts() -> tuple[str, ...]:
    """A sentence for each setting of this machine that helps to find a cause."""
    from etd_hal.linux import machine as this_machine

    return this_machine.facts()


def scan_core() -> ScanCore:
    """What this kernel does with a real-time thread on the calling thread's core."""
    from etd_hal.linux import scan_core as this_core

    return this_core.scan_core()


def wall_time() -> datetime.datetime:
    """The time in UTC, for records with a date."""
    from etd_hal.linux import clock

    return clock.wall_time()
