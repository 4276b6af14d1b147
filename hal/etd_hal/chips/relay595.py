"""74HC595 with two photorelays an electrode: one to the source, one to ground.

Owns: break before make, and that no word ever closes both relays of one electrode.
Must not know: currents, timing of pulses, electrodes.

Shift on SRCLK rising (CLK), copy to the outputs on RCLK rising (LE). OE is tied low on the
boards, so the outputs are random until the first copy: the supply stays off until `clear`.
"""

from __future__ import annotations

from etd_hal.boardfile import Relays
from etd_hal.chips.chain import Chain
from etd_hal.ports import Changes, Clock, Gpio
from etd_hal.selection import Selection


class RelaySwitch:
    """Any set on the source, any other set on ground, the rest open."""

    states: tuple[str, ...] = ("ANODE", "CATHODE", "OPEN", "SHORT")
    can_choose_returns = True

    def __init__(self, gpio: Gpio, clock: Clock, switch: Relays, readback: int | None) -> None:
        self._gpio = gpio
        self._clock = clock
        self._switch = switch
        lines = switch.lines
        stages = switch.outputs * switch.bits_per_electrode
        self._chain = Chain(gpio, stages, lines.DATA, lines.CLK, readback)
        self._copy: Changes = ((lines.LE, 1),)
        self._copied: Changes = ((lines.LE, 0),)
        self._latched: int | None = None
        self._is_whole = False

    def word(self, on_source: int, on_ground: int) -> int:
        """The chain's word for two sets of outputs, given as bit sets.

        Raises: ValueError if an output is in both: that would short the supply.
        """
        if on_source & on_ground:
            raise ValueError("an output cannot be on source and ground at once")
        word = 0
        for output in range(self._switch.outputs):
            stage = output * self._switch.bits_per_electrode
            word |= (on_source >> output & 1) << (stage + self._switch.on_bit)
            word |= (on_ground >> output & 1) << (stage + self._switch.return_bit)
        return word

    def reset(self) -> None:
        """After an error, and after safe_off."""
        self._chain.reset()
        self._latched = None

    def prepare(self, selection: Selection, whole: bool) -> None:  # noqa: ARG002
        """The electrode before rests through its closed relays, so nothing can move yet."""
        self._is_whole = self._is_whole or whole

    def connect(self, selection: Selection, is_anodic: bool) -> None:
        """Open everything, wait for that, close the two sets, wait for that."""
        self._open_all()
        self._latch(self.word(selection.source(is_anodic), selection.ground(is_anodic)))
        self._wait_us(self._switch.ton_us)

    def flip(self, selection: Selection, is_anodic: bool) -> None:
        """The same way: (1, 0) to (0, 1) goes through all open."""
        self.connect(selection, is_anodic)

    def discharge(self) -> None:
        """The skin discharges through the closed relays and the leak, the DAC being at zero."""

    def release(self) -> None:
        self._open_all()

    def isolate(self, whole: bool) -> None:
        self._is_whole = self._is_whole or whole
        self._open_all()

    def clear(self) -> None:
        """All relays open, from a register of which nothing is known."""
        self.reset()
        self._open_all()

    def loop_back(self, sent: int) -> int:
        """Through the registers and back; nothing is copied to the relays."""
        return self._chain.loop_back(sent)

    def _open_all(self) -> None:
        if self._latched == 0 and not self._is_whole:
            return
        if self._is_whole:
            self._chain.rewrite(0)
            self._is_whole = False
        self._latch(0)
        self._wait_us(self._switch.toff_us)

    def _latch(self, word: int) -> None:
        self._chain.write(word)
        if self._latched is None:
            # A call that failed may have left LE high, and the rise would copy nothing.
            self._gpio.set(self._copied)
        self._latched = None
        self._gpio.set(self._copy)
        self._gpio.set(self._copied)
        self._latched = word

    def _wait_us(self, wait_us: int) -> None:
        self._clock.sleep_until_ns(self._clock.now_ns() + wait_us * 1_000)
