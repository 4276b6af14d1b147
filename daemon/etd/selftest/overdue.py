"""Stage 5: the stopper beside the test is tried out, and stays beside it until its end.

Owns: whether it cuts a message that is overdue, and how soon. Must not know: how it cuts, what it
is (`etd_hal.stopper`).

From here on electrodes are connected. Without it, the current of a message that the machine holds
up would flow for as long; and a test that is killed would leave its outputs as they are.
"""

from __future__ import annotations

from etd.selftest.fixture import MS, Fixture
from etd.selftest.log import CheckLog
from etd_hal.stopper import OVERDUE_NS

#: After a message is overdue. It checks each half millisecond; a busy machine lets it wait.
_WITHIN_MS = 5.0
_WAITED_MS = 500.0
_LOOK_NS = MS // 10
_ADVICE = (
    "allow real-time scheduling (docs/install.md), and end what else runs on this machine: a"
    " message that is held up would not be cut off in time"
)


def check(fixture: Fixture, log: CheckLog) -> None:
    """Begins and ends with the board safe. Raises: BusError (the stopper does not come up)."""
    stopper = fixture.start_stopper()
    # What was not granted to it may not matter: how late it comes does.
    refusals = stopper.refusals
    stopper.watch(is_needed=True)
    took_ms = _cut_after_ms(fixture)
    problems = fixture.board.safe_off()
    found = "nothing was cut" if took_ms is None else f"cut {took_ms:.1f} ms after it was due"
    most_ms = OVERDUE_NS / MS + _WITHIN_MS
    log.judge(
        "stopper",
        took_ms is not None and took_ms <= most_ms and not problems,
        "; ".join((found, *problems, *refusals)),
        f"a message that is overdue is cut off within {most_ms:.0f} ms",
        _ADVICE,
    )


def _cut_after_ms(fixture: Fixture) -> float | None:
    """No message is sent: it is told of one that is due now."""
    cut, clock = fixture.board.cut, fixture.clock
    due_ns = clock.now_ns()
    cut.expect(due_ns)
    try:
        while not cut.is_cut and clock.now_ns() < due_ns + _WAITED_MS * MS:
            clock.doze_until_ns(clock.now_ns() + _LOOK_NS)
        return (clock.now_ns() - due_ns) / MS if cut.is_cut else None
    finally:
        cut.expect(0)
