"""A bar that moves across the skin at so many mm a second, whatever the array.

Levels follow the distance from the bar, so that it moves smoothly between electrodes.
"""

import time

from etd import Display

SPEED_MM_S = 20.0
WIDTH_MM = 2.5
SWEEPS = 2

with Display() as display:
    array = display.array
    display.arm(open_to=0.8)
    least, most = min(array.x_mm), max(array.x_mm)
    begun = time.monotonic()
    while (travelled := (time.monotonic() - begun) * SPEED_MM_S) < SWEEPS * (most - least):
        bar_mm = least + travelled % (most - least)
        nearness = [max(0.0, 1 - abs(x_mm - bar_mm) / WIDTH_MM) for x_mm in array.x_mm]
        # Many electrodes at once may not fit at their rate.
        display.show([0.8 * near for near in nearness], allow_slower=True)
        time.sleep(0.04)
