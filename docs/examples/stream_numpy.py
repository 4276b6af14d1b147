"""100 frames a second from numpy: a wave over the rows of the array.

Streamed frames have no answer and the newest wins, so a program that is ahead is not held up. A
refusal comes as telemetry.
"""

import time

import numpy as np

from etd import Display

SECONDS, RATE_HZ = 2.0, 100

with Display() as display, display.telemetry("refused") as refusals:
    rows, columns = display.array.shape or (1, display.electrodes)
    display.arm(open_to=0.6)
    begun = time.monotonic()
    for number in range(int(SECONDS * RATE_HZ)):
        phase = 2 * np.pi * (np.arange(rows) / rows - number / RATE_HZ)
        wave = np.clip(np.sin(phase), 0, 1)[:, np.newaxis] * np.ones(columns)
        display.stream(0.6 * wave, allow_slower=True)
        time.sleep(max(0.0, begun + (number + 1) / RATE_HZ - time.monotonic()))
    while (refused := refusals.receive()) is not None:
        print("refused:", refused[1])
