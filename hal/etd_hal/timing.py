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
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

from etd_hal.boardfile import Bounds, MachineFile
from etd_hal.chips.codec import Codec
from etd_hal.errors import BoardFault
from etd_hal.ports import Message, Transfer

LONGEST_DELAY_US = 10
_DELAY_COUNTS = tuple(range(0, 41, 5))
_WORD_COUNTS = tuple(range(2, 9))
#: (words, delays) of the messages of a round.
_KINDS = (*((2, delays) for delays in _DELAY_COUNTS), *((words, 0) for words in _WORD_COUNTS))
#: What they took, in us.
Round = list[float]
#: So many that are alike are enough. After the most there must be the fewest.
_ROUNDS, _MOST_ROUNDS, _FEWEST_ALIKE = 7, 28, 4
#: (words, delays) of the message by which a timing is recognized, and how often it is sent.
_LIKE_A_PULSE, _GLANCES = (3, 10), 5
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


def calibrate(
    duration_ns: Callable[[Message], int],
    machine: MachineFile,
    codec: Codec,
    too_few: list[list[Round]] | None = None,
) -> tuple[Timing, ...]:
    """Time messages at DAC code 0, and check what is found against the machine file.

    `duration_ns` sends a message and returns how long the call took. Messages are timed in rounds
    of a few milliseconds, one of each kind. What is fitted is the median of rounds that are alike:
    a round in which something else ran is left out, and so is one in which the clocks changed.
    Returns the timing that holds now, then those of other speeds that the clocks had meanwhile.
    `too_few` keeps groups of rounds that are too small for a timing until the next calibration.
    Raises: BoardFault, naming the constant that is not plausible; BusError.
    """
    messages = _round(codec)
    groups = [] if too_few is None else too_few[-_MOST_ROUNDS:]
    for _ in range(_MOST_ROUNDS):
        taken_us = [duration_ns(message) / 1_000 for message in messages]
        group = _alike(groups, taken_us, machine.spread_us)
        group.append(taken_us)
        if len(group) == _ROUNDS:
            break
    by_size = sorted(groups, key=len, reverse=True)
    if too_few is not None:
        too_few[:] = [group for group in groups if len(group) < _FEWEST_ALIKE]
    if len(by_size[0]) < _FEWEST_ALIKE:
        everything = [taken_us for group in groups for taken_us in group]
        found_us = max(max(kind) - min(kind) for kind in zip(*everything, strict=True))
        _check("spread of a message", found_us, Bounds(low=0.0, high=machine.spread_us))
    now, *others = (_fit(group) for group in by_size if len(group) >= _FEWEST_ALIKE)
    check(now, machine)
    return now, *others


def fitted(duration_ns: Callable[[Message], int], codec: Codec) -> Timing:
    """The constants that fit such messages best, plausible or not. Raises: BusError."""
    messages = _round(codec)
    return _fit([[duration_ns(message) / 1_000 for message in messages] for _ in range(_ROUNDS)])


def _round(codec: Codec) -> list[Message]:
    return [_silent(codec, words, delays) for words, delays in _KINDS]


def check(timing: Timing, machine: MachineFile) -> None:
    """Raises: BoardFault, naming the first constant that the machine file does not allow."""
    for what, found_us, bounds in constants(timing, machine):
        _check(what, found_us, bounds)


def constants(timing: Timing, machine: MachineFile) -> tuple[tuple[str, float, Bounds], ...]:
    """Each by its name, as it was found, and what the machine file allows."""
    return (
        ("one word", timing.word_us, machine.word_us),
        ("overhead of a delay", timing.delay_extra_us, machine.delay_extra_us),
        ("overhead of a message", timing.message_us, machine.message_us),
        ("spread of a message", timing.spread_us, Bounds(low=0.0, high=machine.spread_us)),
    )


def _alike(groups: list[list[Round]], taken_us: Round, most_us: float) -> list[Round]:
    """The group that this round belongs to; a new one if it is like none."""
    for group in groups:
        if all(abs(us - first) <= most_us for us, first in zip(taken_us, group[0], strict=True)):
            return group
    groups.append([])
    return groups[-1]


def _fit(rounds: list[Round]) -> Timing:
    """`spread_us` is that of the rounds, or how far their medians are off the fit."""
    kinds = [sorted(kind) for kind in zip(*rounds, strict=True)]
    medians_us = [statistics.median(kind) for kind in kinds]
    spread_us = max(
        kind[int(0.9 * (len(kind) - 1))] - median_us
        for kind, median_us in zip(kinds, medians_us, strict=True)
    )
    by_delays, by_words = medians_us[: len(_DELAY_COUNTS)], medians_us[len(_DELAY_COUNTS) :]
    delay_us, at_no_delay_us = statistics.linear_regression(_DELAY_COUNTS, by_delays)
    word_us, at_no_word_us = statistics.linear_regression(_WORD_COUNTS, by_words)
    fit_us = [at_no_delay_us + delay_us * count for count in _DELAY_COUNTS]
    fit_us += [at_no_word_us + word_us * count for count in _WORD_COUNTS]
    off_us = max(abs(us - fit) for us, fit in zip(medians_us, fit_us, strict=True))
    return Timing(
        word_us=word_us,
        delay_extra_us=delay_us - LONGEST_DELAY_US,
        message_us=at_no_word_us + word_us,
        spread_us=round(max(spread_us, off_us), 6),
    )


def recognize(
    duration_ns: Callable[[Message], int],
    known: Iterable[Timing],
    machine: MachineFile,
    codec: Codec,
) -> Timing | None:
    """Which of the known timings holds now, by a few messages of less than a millisecond; None if
    none does. Raises: BusError.
    """
    message = _silent(codec, *_LIKE_A_PULSE)
    taken_us = statistics.median(duration_ns(message) / 1_000 for _ in range(_GLANCES))
    return nearest(taken_us, known, machine)


def nearest(taken_us: float, known: Iterable[Timing], machine: MachineFile) -> Timing | None:
    """The timing by which a message like a pulse takes so long; None if none is so near that
    messages would not be taken to have drifted.
    """
    found = min(known, key=lambda timing: abs(like_a_pulse_us(timing) - taken_us), default=None)
    if found is None or abs(like_a_pulse_us(found) - taken_us) > machine.drift_us:
        return None
    return found


def like_a_pulse_us(timing: Timing) -> float:
    """What the message takes by which timings are told apart."""
    words, delays = _LIKE_A_PULSE
    held_us = delays * (LONGEST_DELAY_US + timing.delay_extra_us)
    return timing.message_us + (words - 1) * timing.word_us + held_us


def _silent(codec: Codec, words: int, delays: int) -> Message:
    """A message at DAC code 0."""
    zero = codec.word(0)
    silent = Transfer(zero, cs_change=True)
    holds = (Transfer(delay_us=LONGEST_DELAY_US),) * delays
    return Message((silent,) * (words - 1) + holds + (Transfer(zero),))


def _check(what: str, found_us: float, bounds: Bounds) -> None:
    # A hundredth of a microsecond is below the clock's resolution.
    if not bounds.low - 0.01 <= found_us <= bounds.high + 0.01:
        raise BoardFault(
            f"timing calibration, {what}", f"{found_us:.2f} us", f"{bounds.low} to {bounds.high} us"
        )
