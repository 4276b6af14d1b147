"""What a record costs: the engine, which tells every pulse, and the gateway, which writes it.

Owns: scans with and without a record in turn, on ports that cost nothing, and the two ratios. Must
not know: what else an engine is measured for (`processor.py`).

Both are a thread's own time of the processor. The engine's is by pulse, everything included that
the loop does for it; the gateway's is by second of 64 electrodes at 60 Hz.
"""

from __future__ import annotations

import random
import statistics
import sys
import tempfile
from pathlib import Path
from time import thread_time_ns  # noqa: TID251 (processor time, no clock)

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

from bench import modelled, processor  # noqa: E402
from bench.modelled import ELECTRODES  # noqa: E402
from etd.gateway.last_frames import LastFrames  # noqa: E402
from etd.gateway.lease import LeaseView  # noqa: E402
from etd.gateway.record_store import RecordStore  # noqa: E402
from etd.gateway.recorder import Recorder  # noqa: E402
from etd.protocol.link import PulseBatch  # noqa: E402
from etd.protocol.pulse_row import OWN, SAME  # noqa: E402
from etd.stabilize.settings import NO_STABILIZERS, Settings  # noqa: E402

#: Of the engine's time for a pulse.
MOST_OF_A_PULSE = 0.03
_ROUNDS, _SCANS = 8, 60
_RATE_HZ = 60
_BATCH_ROWS = 128


def engine_us(stabilize: Settings = NO_STABILIZERS, rounds: int = _ROUNDS) -> tuple[float, float]:
    """A pulse without a record, and with one: the lower quartiles of scans that take turns, since
    whatever else the machine does only adds.
    """
    taken: dict[bool, list[float]] = {False: [], True: []}
    # By chance, since reports have periods of some scans themselves.
    chance = random.Random(1)
    for _ in range(rounds):
        _round(stabilize, taken, chance)
    return statistics.quantiles(taken[False])[0], statistics.quantiles(taken[True])[0]


def _round(stabilize: Settings, taken: dict[bool, list[float]], chance: random.Random) -> None:
    clock = processor.FreeClock()
    gpio = processor.FreeGpio()
    spi = processor.FreeSpi(clock, gpio)
    engine, gateway, ends = processor.armed(clock, spi, gpio, stabilize)
    for number in range(processor.WARM_UP + _SCANS):
        is_on = chance.random() < 0.5
        engine.components.pulse_log.turn(is_on)
        begun_ns = thread_time_ns()
        processor.play_one(engine, gateway, processor.FIRST_SEQ + number)
        engine.components.pulse_log.send_off()
        if number >= processor.WARM_UP:
            taken[is_on].append((thread_time_ns() - begun_ns) / 1_000 / ELECTRODES)
        _empty(gateway)
        clock.t_ns += int(1e9 / processor.RATE_HZ)
    engine.supervisor.end()
    for channel in ends:
        channel.close()


def _empty(gateway: processor.Ends) -> None:
    for channel in gateway:
        while channel.receive() is not None:
            pass


def gateway_part(seconds: int = 10) -> float:
    """Of a processor: reading rows and handing their lines to the thread that writes them."""
    row = SAME.pack(2, 0, 0, -1, 2_000, 1_998, 0, 99.33, 199_800) + OWN.pack(
        *(10**14, 10**14, 7, 0, 3, 1_500, 40_000), *(0.0, 40.12, 60.34, 0.0, 0.0, 0.0)
    )
    batch = PulseBatch(rows=row * _BATCH_ROWS)
    with tempfile.TemporaryDirectory() as folder:
        recorder = Recorder(
            "bench",
            RecordStore(Path(folder)),
            LeaseView(),
            LastFrames(),
            lambda: (0, 0, 0),
            lambda _: True,
        )
        recorder.start("bench", None, None, None)
        begun_ns = thread_time_ns()
        for _ in range(seconds * _RATE_HZ * ELECTRODES // _BATCH_ROWS):
            recorder.heard(batch, 0)
        taken_ns = thread_time_ns() - begun_ns
        recorder.stop("stopped", 0)
    return taken_ns / seconds / 1e9


def main() -> int:
    for name, settings in (("plain", NO_STABILIZERS), ("with stabilizers", modelled.STABILIZED)):
        off_us, on_us = engine_us(settings)
        part = on_us / off_us - 1.0
        print(
            f"a pulse, {name}: {off_us:.1f} us, recorded {on_us:.1f} us ({part:+.1%}; at most"
            f" {MOST_OF_A_PULSE:.0%} is asked for)"
        )
    print(f"the gateway: {gateway_part():.1%} of a processor, 64 electrodes at {_RATE_HZ} Hz")
    return 0


if __name__ == "__main__":
    sys.exit(main())
