"""One electrode, felt for half a second.

With `etd run --board fake` in another terminal it runs as it is. On a Pi elsewhere:
ETD_HOST=pi@display.local python hello.py
"""

from etd import Display

with Display() as display:
    display.arm(open_to=0.6)  # rises to it over a second or two: no start is felt as a jolt
    shown = display.present({27: 0.6}, seconds=0.5)
    print("felt at", shown.first_at, "-", shown.why_not or "as asked")
