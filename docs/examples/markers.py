"""What other equipment needs to know, and may say: when each stimulus began, by edges on two wires.

`sync` puts an edge on the board's SYNC line with the frame, where it has one; `mark` does at any
time. With `on_trigger` a stimulus waits for an edge on TRIGGER: here for that of a mark, by a wire
between pins 32 and 33, which the fake board has. Times are of CLOCK_MONOTONIC on the daemon's
machine, and of the wall clock here.
"""

import time

from etd import Display

with Display() as display, display.kept():
    display.arm(open_to=0.6)
    for trial in range(3):
        marked = display.mark(f"trial {trial}")
        shown = display.present({27: 0.6}, seconds=0.2, sync=True, tag=100 + trial)
        edge = "with an edge on SYNC" if marked.sync else "without one: this board has no SYNC"
        print(f"trial {trial}: marked at {marked.marked_ns} ns {edge};", end=" ")
        print(f"first pulse at {shown.first_ns} ns, {shown.first_at}")
        time.sleep(0.2)
    waiting = display.begin({27: 0.6}, seconds=0.2, on_trigger=True, wait_s=5)
    time.sleep(0.3)
    display.mark(tag=3)
    shown = waiting.wait()
    if shown.latency_ns is not None:
        print(f"triggered: first pulse {shown.latency_ns / 1000:.0f} us after the edge")
