"""Enter stops everything at once, whatever the program is doing.

It does not replace the switch within the wearer's reach: see docs/hardware.md.
"""

import sys
import threading

from etd import Display, Refused

with Display() as display:
    display.arm(open_to=0.6)

    def stop_on_enter() -> None:
        sys.stdin.readline()
        display.stop()  # the one call that any thread may make

    threading.Thread(target=stop_on_enter, daemon=True).start()
    print("Enter stops it", flush=True)
    try:
        display.hold({27: 0.6}, seconds=60)
    except Refused as refused:
        print("stopped:", refused.reason)
    display.clear()
