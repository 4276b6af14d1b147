"""The supply's two gates: the checks of the heartbeat's, and the advice for both.

Owns: the order, and the advice when a gate does not act. Must not know: how a supply is measured.
"""

from __future__ import annotations

from collections.abc import Callable

from etd.selftest.fixture import Fixture

#: The heartbeat is stopped at both levels: neither may keep the supply on.
_LEVELS = (0, 1)
ENABLE_ADVICE = (
    "cut the supply: the enable line does not switch it, or its capacitor has no bleeder"
)
GATE_ADVICE = (
    "check the monostable, its coupling, and its connection to the supply. If it acts with the line"
    " at the other level, the line is not AC-coupled"
)
LATCH_ADVICE = (
    "the gate needs a latch that only the enable line clears: otherwise a program that hangs and"
    " continues switches the supply on again"
)


def check_heartbeat(
    fixture: Fixture,
    goes: Callable[[int], bool],
    stays_away: Callable[[], bool],
    rises: Callable[[str], bool],
) -> None:
    """Starts with the supply on, and ends so if all is good.

    `goes`: ends the beats at this level and checks that the supply falls. `stays_away`: checks that
    new beats do not restore it. `rises`: switches it on and checks it, under this name.
    """
    for level in _LEVELS:
        if level != _LEVELS[0] and not _rises_anew(fixture, rises, "rise_between_heartbeats"):
            return
        if not goes(level):
            return
    fixture.beats.begin()
    if stays_away():
        _rises_anew(fixture, rises, "rise_after_heartbeat")


def _rises_anew(fixture: Fixture, rises: Callable[[str], bool], name: str) -> bool:
    """Off and on with the enable line, which clears the gate's latch."""
    fixture.board.supply_off()
    fixture.wait_ms(1)
    return rises(name)


def standing(level: int) -> str:
    """At which level the beats ended, for reports."""
    return f"with the line at {level}"
