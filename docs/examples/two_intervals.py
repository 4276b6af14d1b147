"""Which of two intervals was stronger? An adaptive staircase, a file with every trial, and a record
of every pulse on the daemon's disk (`etd record show`).

The reference is level 0.4 at electrode 27; the comparison comes nearer after two right answers and
goes away after a wrong one (2 down, 1 up: it settles where 71 % are right). Without a keyboard a
simulated person answers.
"""

import csv
import math
import random
import sys
import time

from etd import Display

ELECTRODE, REFERENCE = 27, 0.4
TRIALS = int(sys.argv[1]) if len(sys.argv) > 1 else 12
PAUSE_S = float(sys.argv[2]) if len(sys.argv) > 2 else 0.3
RECORD = time.strftime("two-intervals-%Y%m%d-%H%M%S")
chance = random.Random(1)


def answer(first: float, second: float) -> int:
    """1 or 2."""
    if sys.stdin.isatty():
        return 2 if input("Which was stronger, 1 or 2? ").strip() == "2" else 1
    felt = [level * math.exp(chance.gauss(0, 0.08)) for level in (first, second)]
    return 1 if felt[0] > felt[1] else 2


# A person may think for ten minutes; then the lease lapses, and the board is disarmed.
with (
    Display() as display,
    display.kept(at_most_s=600),
    display.record(RECORD),
    open("trials.csv", "w", newline="") as file,
):
    table = csv.writer(file)
    table.writerow(
        ["trial", "comparison", "stronger", "answer", "first_ns", "second_ns", "as_asked"]
    )
    display.arm(open_to=1.0)
    difference, right = 0.4, 0
    for trial in range(TRIALS):
        stronger = chance.choice((1, 2))
        levels = [REFERENCE, REFERENCE + difference]
        if stronger == 1:
            levels.reverse()
        shown = []
        for level in levels:
            time.sleep(PAUSE_S)  # the lease is kept; the frame before has ended
            shown.append(display.present({ELECTRODE: level}, seconds=0.3))
        said = answer(*levels)
        as_asked = all(interval.as_asked for interval in shown)
        onsets = [interval.first_ns for interval in shown]
        table.writerow([trial, levels[stronger - 1], stronger, said, *onsets, as_asked])
        right = right + 1 if said == stronger else 0
        if said != stronger:
            difference = min(0.6, difference * 1.5)
        elif right == 2:
            difference, right = difference / 1.5, 0
    print(f"after {TRIALS} trials the difference is {difference:.3f}; they are in trials.csv,")
    print(f"and their pulses in the record {RECORD}")
