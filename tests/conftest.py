"""For every test: machines are noisy, so no example has a deadline of its own.

Examples are drawn anew in each run, and what one finds is everybody's to mend. Where CI is set they
are always the same: what does not land there fails for what was changed, and not by chance.
"""

from __future__ import annotations

import gc
import os
import signal

from hypothesis import settings

# A shell that runs the tests in its background has them ignore Ctrl-C, and all that they start.
signal.signal(signal.SIGINT, signal.default_int_handler)

settings.register_profile("anew", deadline=None)
settings.register_profile("the-same", deadline=None, derandomize=True)
# On the command line, for what is not to be bounded by a minute: --hypothesis-profile=long
settings.register_profile("long", deadline=None, max_examples=10_000)
settings.load_profile("the-same" if os.environ.get("CI") else "anew")


# As many threads as cores, in each worker and each process that it starts, would only be in each
# other's way. Set before numpy is imported.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

#: Traces and plans are many small objects and few cycles: the usual 700 cost a tenth of the tests.
_ALLOCATIONS_A_COLLECTION = 50_000


def pytest_collection_finish() -> None:
    """What was imported and collected stays: no garbage collection need go through it again."""
    gc.collect()
    gc.freeze()
    gc.set_threshold(_ALLOCATIONS_A_COLLECTION)
