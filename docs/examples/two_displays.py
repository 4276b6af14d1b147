"""Two daemons, one for each hand: `etd run --board fake --name left`, and `--name right`.

Each has its own board, lease and limits. A thread of its own for each lets both begin at once.
"""

import sys
from concurrent.futures import ThreadPoolExecutor

from etd import Display

NAMES = sys.argv[1:] or ["left", "right"]


def present(name: str) -> int:
    with Display(name) as display:
        display.arm(open_to=0.6)
        shown = display.present({27: 0.6}, seconds=0.5)
        if shown.first_ns is None:
            raise SystemExit(f"{name}: nothing was fired: {shown.why_not}")
        return shown.first_ns


with ThreadPoolExecutor() as pool:
    first_ns = list(pool.map(present, NAMES))
# Of two fakes each has a clock of its own, which lags while the computer is busy.
print(f"first pulses {abs(first_ns[0] - first_ns[-1]) / 1e6:.1f} ms apart")
