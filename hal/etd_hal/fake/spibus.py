"""The SPI bus: the kernel's way with a message, and the DAC and ADC on one chip select.

Owns: the order and time of every step of a message, and its faults.
Must not know: lines, switches, what the current does.
"""

from __future__ import annotations

from collections.abc import Generator

from etd_hal.boardfile import Source
from etd_hal.errors import BusError
from etd_hal.fake.ad5452 import Ad5452
from etd_hal.fake.ad7276 import Ad7276
from etd_hal.fake.currentpath import CurrentPath
from etd_hal.fake.faults import (
    ClockSteps,
    HoldShort,
    LostSync,
    MisoFlipped,
    MisoStuck,
    MosiFlipped,
    MosiStuck,
    SlowWords,
    SpiError,
    SpiMode,
    SpiShort,
    SpiStall,
)
from etd_hal.fake.faults_due import Faults
from etd_hal.fake.layouts import check_size
from etd_hal.fake.machines import MachineModel
from etd_hal.fake.timeline import Timeline
from etd_hal.fake.trace import Trace
from etd_hal.ports import Message, SpiSetup, Transfer

_NS_PER_MS = 1_000_000

#: What a message read, one entry for each transfer with data, and when it ended.
Played = tuple[tuple[bytes, ...], int]


class SpiBus:
    def __init__(
        self,
        source: Source,
        path: CurrentPath,
        faults: Faults,
        timeline: Timeline,
        trace: Trace,
        machine: MachineModel,
    ) -> None:
        self._device = source.spi
        self._path = path
        self._faults = faults
        self._timeline = timeline
        self._trace = trace
        self._full_speed = machine
        #: By factor.
        self._slowed: dict[float, MachineModel] = {}
        self._setup: SpiSetup | None = None
        self._dac = Ad5452(path.set_code, timeline.complain)
        self._adc = Ad7276()

    def open(self, setup: SpiSetup) -> None:
        """Raises: BusError (`absent`, `invalid`). The chips keep what they hold."""
        if setup.device != self._device:
            raise BusError("absent", setup.device, "open", "the board is on another device")
        if setup.mode not in (0, 1, 2, 3):
            raise BusError("invalid", setup.device, "open", f"there is no mode {setup.mode}")
        self._setup = setup

    def close(self) -> None:
        self._setup = None

    def play(self, t_ns: int, message: Message) -> Generator[int, None, Played]:
        """Play a message; yields the times until which it stands still, as a stall does.

        Meanwhile others may act. The message itself goes on whatever they do.
        Raises: BusError; where some of it was sent, time has passed to the timeline's `now_ns`.
        """
        setup = self._open_setup()
        check_size(message, self._device)
        t_ns = self._timeline.start(t_ns)
        self._trace.spi_message(t_ns, len(message.transfers))
        faults = self._faults.spi_message()
        failed = next((fault for fault in faults if isinstance(fault, SpiError)), None)
        reads: list[bytes] = []
        sent_bytes = 0
        last = len(message.transfers) - 1
        t_ns += self._faults.spi_late_us() * 1_000
        t_ns = self._select(t_ns + self._at(t_ns).message_before_ns)
        for index, transfer in enumerate(message.transfers):
            for fault in faults:
                if isinstance(fault, SpiStall) and fault.at_transfer == index:
                    t_ns = self._timeline.end(t_ns) + fault.stall_us * 1_000
                    yield t_ns
                    t_ns = self._timeline.start(t_ns)
            if failed is not None and failed.at_transfer == index:
                break
            read, t_ns = self._clock(t_ns, transfer, setup)
            t_ns += self._at(t_ns).delay_ns(transfer.delay_us)
            sent_bytes += len(transfer.tx)
            if transfer.tx:
                reads.append(read)
            if transfer.cs_change and index != last:
                t_ns = self._select(self._deselect(t_ns) + self._at(t_ns).cs_change_ns)
        if message.transfers and message.transfers[-1].cs_change and failed is None:
            self._timeline.complain(t_ns, "cs_change on the last transfer: its word is not taken")
        else:
            t_ns = self._deselect(t_ns)
        self._trace.spi_done(t_ns, sent_bytes)
        end_ns = self._timeline.end(t_ns + self._at(t_ns).message_after_ns)
        self._raise_failure(failed, any(isinstance(fault, SpiShort) for fault in faults))
        return tuple(reads), end_ns

    def _at(self, t_ns: int) -> MachineModel:
        """The machine, as fast as it runs at this time."""
        if self._faults.are_there:
            for steps in self._faults.of(ClockSteps):
                if t_ns // (steps.every_ms * _NS_PER_MS) % 2:
                    return self._slowed.setdefault(
                        steps.factor, self._full_speed.slowed(steps.factor)
                    )
        return self._full_speed

    def _raise_failure(self, failed: SpiError | None, short: bool) -> None:
        if failed is not None:
            detail = f"transfer {failed.at_transfer} failed; the rest was not sent"
            raise BusError(failed.kind, self._device, "transfer", detail)
        if short:
            detail = "fewer bytes than the message has were reported"
            raise BusError("short", self._device, "transfer", detail)

    def _open_setup(self) -> SpiSetup:
        if self._setup is None:
            raise BusError("gone", self._device, "transfer", "the device is not open")
        return self._setup

    def _select(self, t_ns: int) -> int:
        """Chip select falls: the ADC samples."""
        t_ns += self._at(t_ns).cs_fall_ns
        self._trace.spi_cs(t_ns, True)
        self._dac.select()
        self._adc.select(self._path.node_code(t_ns))
        return t_ns

    def _clock(self, t_ns: int, transfer: Transfer, setup: SpiSetup) -> tuple[bytes, int]:
        read = b""
        if transfer.tx:
            t_ns += self._at(t_ns).cs_to_clock_ns + self._at(t_ns).clocking_ns(
                len(transfer.tx), setup.speed_hz
            )
            mode, sent = setup.mode, transfer.tx
            if self._faults.are_there:
                t_ns += sum(slow.extra_us * 1_000 for slow in self._faults.of(SlowWords))
                mode = next((fault.mode for fault in self._faults.of(SpiMode)), mode)
                sent = self._faults.word(MosiFlipped, sent)
                for mosi in self._faults.of(MosiStuck):
                    sent = _all_at(mosi.level, len(sent))
            self._dac.shift(sent, mode, bool(self._faults.of(HoldShort)))
            read = self._adc.shift(len(sent), mode)
            if self._faults.are_there:
                read = self._faults.word(MisoFlipped, read)
                for miso in self._faults.of(MisoStuck):
                    read = _all_at(miso.level, len(sent))
        else:
            t_ns += self._at(t_ns).empty_transfer_ns
        self._trace.spi_transfer(t_ns, transfer.tx, read, transfer.delay_us, transfer.cs_change)
        return read, t_ns

    def _deselect(self, t_ns: int) -> int:
        """Chip select rises: the DAC executes its word."""
        t_ns += self._at(t_ns).cs_rise_ns
        self._trace.spi_cs(t_ns, False)
        if not self._faults.edge_is_wrong(LostSync):
            self._dac.deselect(t_ns)
        self._adc.deselect()
        return t_ns


def _all_at(level: int, length: int) -> bytes:
    """What is read off a line that does not move."""
    return (b"\xff" if level else b"\x00") * length
