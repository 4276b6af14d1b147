"""The hard ceilings: what no file, person, frame, law or gateway can raise.

Owns: these constants, each with its source. A test holds their literal values. Must not know:
files, boards, persons, what is made of a request for more.

The loaders of board, machine and body-site files refuse what is above them, and the maxima in force
are the smallest of these, the board's and the site's.
"""

from __future__ import annotations

from typing import Final

#: The most of what the paper asks for: 1 to 10 mA on electrodes of 1 mm, 50 to 200 us (Kajimoto,
#: Electro-tactile Display). A board whose source can do more is cut to it.
CURRENT_UA: Final = 10_000
WIDTH_US: Final = 200
#: Of one phase: what both of these make together. 0.5 uC is Shannon's line at k = 1.5 for a disk of
#: 1 mm; 2 uC at k = 2.7. Current and width alone bound no charge that a smaller electrode may get.
CHARGE_NC: Final = 2_000
#: Of one electrode: by design, above the 120 of the shipped sites.
RATE_HZ: Final = 200
#: Of one electrode, from the start of a pulse to that of the next. A membrane charges for tenths of
#: a millisecond (sensory chronaxies of an arm are 0.35 to 1.17 ms): closer pulses are one.
INTERVAL_US: Final = 500
#: Of one electrode in any second, all phases counted positive: 10 mA, 200 us, 60 times a second.
MEAN_CURRENT_UA: Final = 120
#: Of all electrodes together, likewise: by design, four times what the shipped fingertip allows.
ARRAY_MEAN_CURRENT_UA: Final = 8_000
#: What pulses of one polarity leave on an electrode, as a return too, with a leak of a second: so
#: 15 uA of direct current that does not end. By design, below the 15.8 uA that pulses left before
#: there was a bound (decision 0077); under a disk of 1 mm that is 1.9 mA/cm2.
NET_CHARGE_NC: Final = 15_000
#: What follows from them for the time with current in any second: two phases, at the highest rate;
#: and for the array, a scan that rests at least a fifth of the time.
ON_US_PER_S: Final = 2 * WIDTH_US * RATE_HZ
ARRAY_ON_US_PER_S: Final = 800_000
#: Outside ARMED, and of what measures contact: by design, together a tenth of Shannon's line for a
#: disk of 1 mm.
PROBE_CURRENT_UA: Final = 1_000
PROBE_WIDTH_US: Final = 50
#: Of a machine: how far over its plan a message may be before that halts. It is what the stopper
#: waits for, which cuts such a message off; 10 mA for as long are 10 uC, by a fault.
HALT_EXCESS_US: Final = 1_000
#: Of a machine: what is no fault yet, of the mean of all messages and of a single one. By design,
#: what a virtual machine needs for the kernel tests: thirty times a Pi's.
DRIFT_US: Final = 50
SPREAD_US: Final = 200
