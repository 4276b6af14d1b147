"""What other equipment needs to know: when each stimulus began, and an edge on a wire.

`sync` puts an edge on the board's SYNC line with the frame, where it has one; `mark` does at any
time. Times are of CLOCK_MONOTONIC on the daemon's machine, and of the wall clock here.
"""

import time

from etd import Display

with Display() as display, display.kept():
    display.arm(open_to=0.6)
    for trial in range(3):
        marked = display.mark(tag=trial)
        shown = display.present({27: 0.6}, seconds=0.2, sync=True, tag=100 + trial)
        edge = "with an edge on SYNC" if marked.sync else "without one: this board has no SYNC"
        print(f"trial {trial}: marked at {marked.marked_ns} ns {edge};", end=" ")
        print(f"first pulse at {shown.first_ns} ns, {shown.first_at}")
        time.sleep(0.2)
