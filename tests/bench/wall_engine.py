"""The real engine in a process of its own, on ports that take the time of real ones.

Owns: those ports, on the real clock, and the process (`python wall_engine.py FOLDER`).
Must not know: what is measured.

The fake's live clock stands still while the engine computes, so that a latency measured by it
would leave the computing out. Here computing takes the time it takes; only what the system takes
from a process in the middle of a message is left out, and given back with the next sleep.
"""

from __future__ import annotations

import sys
from dataclasses import replace
from pathlib import Path

_CLONE = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(_CLONE / "tests")]

import msgspec  # noqa: E402

from bench.modelled import loaded_with  # noqa: E402
from bench.processor import FreeGpio, answers, message_ns  # noqa: E402
from etd.engine.process import run_engine  # noqa: E402
from etd.files.configuration import LoadedConfig  # noqa: E402
from etd_hal.backend import Backend  # noqa: E402
from etd_hal.compose import codec_of  # noqa: E402
from etd_hal.linux import realtime  # noqa: E402
from etd_hal.linux.clock import LinuxClock  # noqa: E402
from etd_hal.ports import Message, Wait  # noqa: E402
from etd_hal.unwired import NoMarker  # noqa: E402

_REST_US = 200
_MACHINE = "rig"
#: Whoever shares the processor with a flood is interrupted for milliseconds. There is no skin here:
#: what would halt a display is to be measured.
_FORGIVING = {"halt_excess_us": 90_000.0, "drift_us": 90_000.0}


class WallClock:
    """CLOCK_MONOTONIC, less what was taken from messages since the last sleep."""

    def __init__(self) -> None:
        self.real = LinuxClock()
        self.behind_ns = 0
        #: While a message lasts, time ends with it: nobody shall see it overdue.
        self.message_ends_ns: int | None = None

    def now_ns(self) -> int:
        ends_ns, now_ns = self.message_ends_ns, self.real.now_ns() - self.behind_ns
        return now_ns if ends_ns is None else min(ends_ns, now_ns)

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self.real.sleep_until_ns(deadline_ns)
        self.behind_ns = max(0, min(self.behind_ns, self.real.now_ns() - deadline_ns))

    def doze_until_ns(self, deadline_ns: int) -> None:
        self.real.doze_until_ns(deadline_ns)
        self.behind_ns = max(0, min(self.behind_ns, self.real.now_ns() - deadline_ns))

    def doze_until_woken(self, deadline_ns: int, wait: Wait) -> None:
        self.real.doze_until_woken(deadline_ns, wait)
        self.behind_ns = max(0, min(self.behind_ns, self.real.now_ns() - deadline_ns))


class WallSpi:
    """Busy for as long as the message lasts, as the kernel is."""

    def __init__(self, clock: WallClock, gpio: FreeGpio) -> None:
        self._clock = clock
        self._gpio = gpio

    def prepare(self, message: Message) -> None:
        pass

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        clock = self._clock
        clock.message_ends_ns = end_ns = clock.now_ns() + message_ns(message)
        while clock.now_ns() < end_ns:
            pass
        clock.behind_ns = clock.real.now_ns() - end_ns
        clock.message_ends_ns = None
        return answers(message)[self._gpio.is_blanked]


def main() -> int:
    clock, gpio, loaded = WallClock(), FreeGpio(), _loaded()
    backend = Backend(
        "fake",
        *(WallSpi(clock, gpio), gpio, None, clock, NoMarker(), lambda: None),
        host_clock=clock,
        codec=codec_of(loaded.board.source),
        set_up_realtime=realtime.set_up,
        set_up_urgent_thread=realtime.scheduling,
    )
    folder = Path(sys.argv[1])
    # Nobody has tested it; a fake is armed all the same.
    untested = folder / "selftest.json"
    return run_engine(loaded, backend, folder, untested, lambda: print("ready", flush=True))


def _loaded() -> LoadedConfig:
    loaded = loaded_with(_REST_US, _MACHINE)
    return replace(loaded, machine=msgspec.structs.replace(loaded.machine, **_FORGIVING))


if __name__ == "__main__":
    sys.exit(main())
