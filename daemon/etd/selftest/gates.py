"""The supply's two gates, the enable line and the heartbeat: what is tried of the second, in order.

Owns: the order, and what to do when a gate does not act. Must not know: how a supply is looked at.
"""

from __future__ import annotations

from collections.abc import Callable

from etd.selftest.fixture import Fixture

#: Where the heartbeat stops: a gate that one of them holds on must not pass.
_LEVELS = (0, 1)
ENABLE_ADVICE = (
    "the enable line does not switch the supply, or its store has no bleeder: cut the supply"
)
GATE_ADVICE = (
    "the gate does not act: the monostable, its coupling, and the way from it to the supply. If it"
    " acts with the line at the other level, the line is not AC-coupled"
)
LATCH_ADVICE = (
    "the gate needs a latch that the enable's end clears: a program that hung and goes on would"
    " have its supply back unasked"
)


def check_heartbeat(
    fixture: Fixture,
    goes: Callable[[int], bool],
    stays_away: Callable[[], bool],
    rises: Callable[[str], bool],
) -> None:
    """With the supply on, and on again at its end if all is good.

    `goes`: the beats end at this level, and the supply with them. `stays_away`: it does not come
    back with new beats. `rises`: it is switched on, and judged under this name.
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
    """By way of the enable line, which clears the gate's latch."""
    fixture.board.supply_off()
    fixture.wait_ms(1)
    return rises(name)


def standing(level: int) -> str:
    """At which level the beats ended, for people."""
    return f"the line standing at {level}"
