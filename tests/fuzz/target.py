"""What is fuzzed: a decoder of bytes from outside, and what must hold for any bytes.

Owns: the type of a target, and the bounds on time and memory that one input is held to. Must not
know: which targets there are, where inputs come from.
"""

from __future__ import annotations

import resource
from collections.abc import Callable, Iterable
from dataclasses import dataclass

#: What a process may grow by for one input, its largest size so far apart.
MOST_GROWN_KB = 96 * 1024


@dataclass(frozen=True)
class Target:
    """`play` raises for what must not be: an AssertionError, or an error that should have been told
    as one of the project's own.
    """

    name: str
    about: str
    play: Callable[[bytes], None]
    #: Whole and valid inputs, from which others are made.
    seeds: Callable[[], Iterable[bytes]]
    #: Of the sources, from the root of the clone, what decodes here.
    decoders: tuple[str, ...]
    most_bytes: int = 4_096
    #: Of processor time, for one input, instrumented.
    most_s: float = 5.0
    #: How many shares it gets of the time.
    shares: int = 1
    #: What is instrumented, to guide the fuzzer: a whole engine would take ten times as long.
    guiding: tuple[str, ...] = ("etd", "etd_hal")


class OverBound(AssertionError):
    """An input took more time or memory than its target allows."""


def processor_s() -> float:
    """What this process has used so far."""
    usage = resource.getrusage(resource.RUSAGE_SELF)
    return usage.ru_utime + usage.ru_stime


def play(target: Target, data: bytes) -> None:
    """One input, held to the bounds. Raises: whatever the target does not allow."""
    begun_s, begun_kb = processor_s(), _largest_kb()
    target.play(data)
    taken_s, grown_kb = processor_s() - begun_s, _largest_kb() - begun_kb
    if taken_s > target.most_s:
        raise OverBound(f"{taken_s:.1f} s for {len(data)} bytes: at most {target.most_s} s")
    if grown_kb > MOST_GROWN_KB:
        raise OverBound(f"{grown_kb} kB for {len(data)} bytes: at most {MOST_GROWN_KB} kB")


def _largest_kb() -> int:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
