"""The calibrated constants of one SPI message, and the pulse shape that a width asks for.

Owns: the model `duration = message + (words - 1) x word + sum(delay + extra)`, its calibration on
the machine itself at DAC code 0, and its plausible bounds. Must not know: currents, switches.

A pulse is `[I, cs_change] Z(d1) ... Z(dn) [0]` or, with a sample near its end,
`[I, cs_change] Z... [I, cs_change] [0]`; with a prepulse in front, `[P, cs_change] Z...`, which is
one more word. The DAC follows the rise of chip select, so the width is
one `word` (two with the sample) and the delays: just the two slopes of the model above. Delays
are at most 10 us: the kernel busy-waits up to 10 us and sleeps above (spi_delay_exec).
"""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable
from dataclasses import dataclass, replace

from etd_hal.boardfile import Bounds, MachineFile
from etd_hal.chips.codec import Codec
from etd_hal.errors import BoardFault
from etd_hal.ports import Message, Transfer

LONGEST_DELAY_US = 10
_DELAY_COUNTS = tuple(range(0, 41, 5))
_WORD_COUNTS = tuple(range(2, 9))
_REPEATS = 7
#: Smallest width gained by one more delay transfer: the guard assumes its worst overhead.
_CLOSER_US = 0.25


@dataclass(frozen=True, slots=True)
class Shape:
    """The delays of a pulse and what they make.

    Never wider than requested, and narrower by less than 1 us; only where a single word fits is the
    pulse narrower by up to the overhead of a delay. The same holds for a prepulse, whose word is
    followed by its own delays; `prepulse_us` 0: there is none.
    """

    delays_us: tuple[int, ...]
    has_end_sample: bool
    width_us: float
    duration_us: float
    prepulse_delays_us: tuple[int, ...] = ()
    prepulse_us: float = 0.0


@dataclass(frozen=True, slots=True)
class Timing:
    """The constants found on this machine, in us."""

    word_us: float
    delay_extra_us: float
    message_us: float
    spread_us: float

    def shape(self, width_us: int) -> Shape:
        """The widest pulse that is not wider than `width_us`; with an end sample if that fits.

        Raises: BoardFault if one word alone takes longer.
        """
        words = 2 if width_us >= 2 * self.word_us + max(1.0, self.delay_extra_us) else 1
        delays, held_us = self._held(width_us, words)
        return Shape(delays, words == 2, held_us, self.message_us + held_us)

    def two_steps(self, prepulse_us: int, width_us: int) -> Shape:
        """The same, with a prepulse that is not wider than `prepulse_us`. Raises: BoardFault."""
        pulse = self.shape(width_us)
        delays, held_us = self._held(prepulse_us, 1)
        return replace(
            pulse,
            duration_us=pulse.duration_us + held_us,
            prepulse_delays_us=delays,
            prepulse_us=held_us,
        )

    def _held(self, width_us: int, words: int) -> tuple[tuple[int, ...], float]:
        """The delays between so many words, and the width of both together. Raises: BoardFault."""
        left_us = width_us - words * self.word_us
        if left_us < 0:
            raise BoardFault(
                "shortest pulse", f"{self.word_us:.1f} us for one word", f"{width_us} us or less"
            )
        delays = self._delays(left_us)
        return delays, words * self.word_us + sum(delays) + len(delays) * self.delay_extra_us

    def _delays(self, left_us: float) -> tuple[int, ...]:
        """The fewest delays that can fill `left_us`, together as long as whole us allow; one more
        where that comes closer by a quarter of a microsecond: its overhead is no whole number.
        As even as can be, because one of 0 us would not have the overhead that was calibrated.
        """
        count = math.ceil(left_us / (LONGEST_DELAY_US + self.delay_extra_us))
        held_us, more_us = (
            math.floor(left_us - delays * self.delay_extra_us) for delays in (count, count + 1)
        )
        if more_us > count and more_us + self.delay_extra_us >= held_us + _CLOSER_US:
            count, held_us = count + 1, more_us
        if held_us < 0:
            return ()
        each_us, longer = divmod(held_us, max(1, count))
        return (each_us + 1,) * longer + (each_us,) * (count - longer)


def pulse_message(codec: Codec, code: int, shape: Shape, prepulse_code: int = 0) -> Message:
    """The message that plays `code` in `shape` and ends at zero; `prepulse_code` before it, if the
    shape has a prepulse.
    """
    on = Transfer(codec.word(code), cs_change=True)
    sample = (on,) if shape.has_end_sample else ()
    return Message(
        (
            *_prepulse(codec, prepulse_code, shape),
            on,
            *_holds(shape.delays_us),
            *sample,
            Transfer(codec.word(0)),
        )
    )


def _prepulse(codec: Codec, code: int, shape: Shape) -> tuple[Transfer, ...]:
    if not shape.prepulse_us:
        return ()
    return (Transfer(codec.word(code), cs_change=True), *_holds(shape.prepulse_delays_us))


def _holds(delays_us: tuple[int, ...]) -> tuple[Transfer, ...]:
    return tuple(Transfer(delay_us=delay) for delay in delays_us)


def zero_message(codec: Codec) -> Message:
    """DAC to zero, one word."""
    return Message((Transfer(codec.word(0)),))


def calibrate(duration_ns: Callable[[Message], int], machine: MachineFile, codec: Codec) -> Timing:
    """Time messages at DAC code 0, and check what is found against the machine file.

    `duration_ns` sends a message and returns how long the call took. Raises: BoardFault, naming the
    constant that is not plausible; BusError.
    """
    timing = fitted(duration_ns, codec)
    check(timing, machine)
    return timing


def fitted(duration_ns: Callable[[Message], int], codec: Codec) -> Timing:
    """The constants that fit such messages best, plausible or not. Raises: BusError."""
    zero = codec.word(0)
    by_delays = [_timed(duration_ns, zero, 2, count) for count in _DELAY_COUNTS]
    by_words = [_timed(duration_ns, zero, count, 0) for count in _WORD_COUNTS]
    delay_us, _ = statistics.linear_regression(_DELAY_COUNTS, [median for median, _ in by_delays])
    word_us, at_no_word_us = statistics.linear_regression(
        _WORD_COUNTS, [median for median, _ in by_words]
    )
    return Timing(
        word_us=word_us,
        delay_extra_us=delay_us - LONGEST_DELAY_US,
        message_us=at_no_word_us + word_us,
        spread_us=max(spread for _, spread in (*by_delays, *by_words)),
    )


def check(timing: Timing, machine: MachineFile) -> None:
    """Raises: BoardFault, naming the first constant that the machine file does not allow."""
    _check("one word", timing.word_us, machine.word_us)
    _check("overhead of a delay", timing.delay_extra_us, machine.delay_extra_us)
    _check("overhead of a message", timing.message_us, machine.message_us)
    _check("spread of a message", timing.spread_us, Bounds(low=0.0, high=machine.spread_us))


def _timed(
    duration_ns: Callable[[Message], int], zero: bytes, words: int, delays: int
) -> tuple[float, float]:
    """(median, 90th percentile less median) of a few repeats, in us."""
    silent = Transfer(zero, cs_change=True)
    holds = (Transfer(delay_us=LONGEST_DELAY_US),) * delays
    message = Message((silent,) * (words - 1) + holds + (Transfer(zero),))
    taken_us = sorted(duration_ns(message) / 1_000 for _ in range(_REPEATS))
    median_us = statistics.median(taken_us)
    return median_us, taken_us[int(0.9 * (_REPEATS - 1))] - median_us


def _check(what: str, found_us: float, bounds: Bounds) -> None:
    # A hundredth of a microsecond is below the clock's resolution.
    if not bounds.low - 0.01 <= found_us <= bounds.high + 0.01:
        raise BoardFault(
            f"timing calibration, {what}", f"{found_us:.2f} us", f"{bounds.low} to {bounds.high} us"
        )
