"""Ports that lead to no wire: a touched electrode answers every pulse, and nothing ever fails.

Owns: what such ports answer, and two clocks for them: one on which a call takes no time of the
processor's, and one on which it takes the time of a real one. With the first the processor's own
time is measured, with the second the loop as it will run. Must not know: what is measured.

They are not the fake board: there is no guard to test against them, no trace and no skin.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Literal, Protocol

from etd_hal.boardfile import BoardFile, MachineFile
from etd_hal.chips.codec import Codec
from etd_hal.errors import BoardFault
from etd_hal.ports import Changes, Edge, Message, Wait, WakingClock

#: A call, or its end: a rest is waited for, lines are set, a message begins, it has ended.
Mark = Literal["rest", "set", "message", "ended"]
#: Of a message: its largest code, its duration in ns, and what comes back with the outputs live and
#: with them blanked.
_Made = tuple[int, int, tuple[bytes, ...], tuple[bytes, ...]]
#: The skin's part of a touched electrode at rest, beside the leak.
_SKIN_OHM = 50_000.0


class SpendingClock(WakingClock, Protocol):
    def spend_ns(self, duration_ns: int) -> None:
        """A call takes so long."""
        ...


class MovedClock:
    """Time that calls and sleeps move, and nothing else: computing takes none."""

    def __init__(self) -> None:
        self.t_ns = 1_000_000_000

    def now_ns(self) -> int:
        return self.t_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.t_ns = max(self.t_ns, deadline_ns)

    def doze_until_ns(self, deadline_ns: int) -> None:
        self.sleep_until_ns(deadline_ns)

    def doze_until_woken(self, deadline_ns: int, wait: Wait) -> None:
        if not wait(0.0):
            self.doze_until_ns(deadline_ns)

    def spend_ns(self, duration_ns: int) -> None:
        self.t_ns += duration_ns


class BusyClock:
    """A real clock, on which a call keeps the processor as busy as the kernel's driver does."""

    def __init__(self, real: WakingClock) -> None:
        self.now_ns = real.now_ns
        self.sleep_until_ns = real.sleep_until_ns
        self.doze_until_ns = real.doze_until_ns
        self.doze_until_woken = real.doze_until_woken

    def spend_ns(self, duration_ns: int) -> None:
        end_ns = self.now_ns() + duration_ns
        while self.now_ns() < end_ns:
            pass


class MarkedClock:
    """Another clock, with a mark at each rest that is waited for."""

    def __init__(self, clock: SpendingClock, mark: Callable[[Mark, int], None]) -> None:
        self.now_ns = clock.now_ns
        self.doze_until_ns = clock.doze_until_ns
        self.doze_until_woken = clock.doze_until_woken
        self.spend_ns = clock.spend_ns
        self._clock = clock
        self._mark = mark

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._mark("rest", deadline_ns)
        self._clock.sleep_until_ns(deadline_ns)


class UnwiredSpi:
    """The Spi port. A mark has the DAC's largest code of its message, so that one can tell the
    pulses from messages at code 0.
    """

    def __init__(
        self,
        clock: SpendingClock,
        board: BoardFile,
        machine: MachineFile,
        codec: Codec,
        gpio: UnwiredGpio,
        mark: Callable[[Mark, int], None],
    ) -> None:
        source = board.source
        self._clock = clock
        self._gpio = gpio
        self._machine = machine
        self._source = source
        #: Weaker than any probe and as short: the check of the latch, with no electrode selected.
        #: A pulse of the soft start is as weak, and longer.
        self._unloaded_ua = board.maxima.probe_current_ua / 2
        self._unloaded_us = board.maxima.probe_width_us
        self._mark = mark
        self._code_of = {codec.word(code): code for code in range(source.codes)}
        #: The bytes of each sample, by the codec that will read them.
        self._samples = _samples(codec, source.adc_codes)

    def prepare(self, message: Message) -> None:
        if self not in message.made:
            message.made[self] = self._made(message)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        self.prepare(message)
        made: _Made = message.made[self]
        code, duration_ns, live, blanked = made
        self._mark("message", code)
        self._clock.spend_ns(duration_ns)
        self._mark("ended", code)
        return blanked if self._gpio.is_blanked else live

    def _made(self, message: Message) -> _Made:
        codes = [self._code_of[transfer.tx] for transfer in message.transfers if transfer.tx]
        code, zero = max(codes), self._samples[0]
        held_us = sum(transfer.delay_us for transfer in message.transfers)
        is_check = held_us < self._unloaded_us and self._source.current_of(code) < self._unloaded_ua
        leak = self._samples[self._held_code(code, 0.0)]
        held = leak if is_check else self._samples[self._held_code(code, 1.0 / _SKIN_OHM)]
        live, blanked = ((zero, *(it,) * (len(codes) - 1)) for it in (held, leak))
        return code, self._duration_ns(message, len(codes)), live, blanked

    def _held_code(self, code: int, skin_s: float) -> int:
        """Where the leak, and what is beside it, holds the node."""
        source = self._source
        volts = source.current_of(code) / 1e6 / (1.0 / source.leak_ohm + skin_s)
        return min(source.adc_codes - 1, int(volts / source.node_uv_per_code * 1e6))

    def _duration_ns(self, message: Message, words: int) -> int:
        """By the middle of the bounds that the machine file gives."""
        machine = self._machine
        pauses = len(message.transfers) - words
        held_us = sum(transfer.delay_us for transfer in message.transfers)
        duration_us = (
            _middle(machine.message_us.low, machine.message_us.high)
            + (words - 1) * _middle(machine.word_us.low, machine.word_us.high)
            + pauses * _middle(machine.delay_extra_us.low, machine.delay_extra_us.high)
            + held_us
        )
        return int(duration_us * 1_000)


class UnwiredGpio:
    """The Gpio port: all stop lines are closed, no input ever changes, and outputs are as set."""

    def __init__(
        self,
        clock: SpendingClock,
        board: BoardFile,
        machine: MachineFile,
        mark: Callable[[Mark, int], None],
    ) -> None:
        self._clock = clock
        self._call_ns = int(machine.gpio_call_us * 1_000)
        self._mark = mark
        line = board.used_lines()["BL"]
        self._blanking, self._live = (line, 0), (line, 1)
        #: No electrode is behind what is sent.
        self.is_blanked = True
        self._levels: dict[int, int] = {}

    def set(self, changes: Changes) -> None:
        self._mark("set", len(changes))
        self._clock.spend_ns(self._call_ns)
        self._levels.update(changes)
        if self._live in changes:
            self.is_blanked = False
        elif self._blanking in changes:
            self.is_blanked = True

    def get(self, line: int) -> int:
        self._clock.spend_ns(self._call_ns)
        return self._levels.get(line, 1)

    def edges(self) -> tuple[Edge, ...]:
        return ()


class NoMarker:
    """Discards marks: there is no trace, as on real buses."""

    def mark(self, event: Literal["frame", "mark"], seq: int, tag: int | str | None) -> None:
        pass


def _samples(codec: Codec, codes: int) -> dict[int, bytes]:
    """The bytes that the codec reads as each sample: found by reading, whatever the chip."""
    found: dict[int, bytes] = {}
    for word in range(1 << 16):
        received = word.to_bytes(2, "big")
        try:
            found.setdefault(codec.code_of(received), received)
        except BoardFault:
            continue
        if len(found) == codes:
            break
    return found


def _middle(low: float, high: float) -> float:
    return (low + high) / 2
