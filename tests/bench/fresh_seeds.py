"""The fingers that a release is judged on: drawn at the release, and tuned on by nobody.

Owns: these seeds, and those that were tuned on or looked at. Must not know: what is played.

The rule: when a release is judged, each bench gets the next seeds of a hundred that no file of the
project names; here those from 7301, 7601 and 7401 on. They are played once, when nothing is tuned
any more, and what comes out is written. Whoever changes a figure after that has looked at them:
they go to `LOOKED_AT`, and the next judgement has the next seeds.
"""

from __future__ import annotations

from typing import Final

#: Of `make bench-felt`, the same where a body's drift is common to all electrodes, and of
#: `make bench-steady` in its whole form.
FELT: Final = tuple(range(7418, 7430))
FELT_COMMON: Final = tuple(range(8001, 8101))
STEADY: Final = (7401, 7402)
#: What the tests play, which everybody looks at.
TESTED: Final = (31,)
#: Tuned on (the estimate and the rules of answers; the fit of k), or judged by and published before
#: something was changed after it.
LOOKED_AT: Final = frozenset(
    {*range(1, 21), *TESTED, 41, 42, 43, 44, 901, 902, 911, 912, 913, 914, 921, 922}
    | set(range(7301, 7401))
    | set(range(7403, 7418))
    | set(range(7500, 7560))
    | set(range(7601, 8001))
)
