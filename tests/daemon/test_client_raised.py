"""What `present` says where laws or answers raised a pulse above what was asked."""

from __future__ import annotations

import pytest

from etd.client.daemon_clock import DaemonClock
from etd.client.presented import presented_of
from etd.protocol.outcome import Shortfall
from scripted_engine import account

WANTED_UA = (2_000, 1_000, 0, 0)


def told(least_ua: tuple[int, ...], most_ua: tuple[int, ...], *not_fired: Shortfall) -> str:
    made = account(
        1,
        pulses=(6, 6, 0, 0),
        wanted_ua=WANTED_UA,
        least_ua=least_ua,
        most_ua=most_ua,
        not_fired=not_fired,
    )
    presented = presented_of([made], {}, 0.1, [], DaemonClock(is_here=True))
    assert presented.as_asked == (not not_fired), "nothing was less"
    _, _, said = str(presented).partition("60.0 Hz: ")
    return said


@pytest.mark.parametrize(
    ("most_ua", "raised"),
    [
        ((1_998, 998, 0, 0), ""),
        ((2_009, 1_004, 0, 0), ""),
        ((1_998, 1_011, 0, 0), "1.01"),
        ((2_100, 1_000, 0, 0), "1.05"),
        ((2_100, 1_101, 0, 0), "1.10"),
        ((2_402, 1_101, 0, 0), "1.20"),
    ],
)
def test_by_how_much_the_most_that_it_was(most_ua: tuple[int, ...], raised: str) -> None:
    said = told((1_998, 998, 0, 0), most_ua)
    how_far = f"; raised up to {raised} times by a law or an answer" if raised else ""
    assert said == f"as asked{how_far}"


def test_what_was_less_is_told_beside_it() -> None:
    missed = Shortfall(electrode=1, reason="ledger", pulses=3)
    assert told((1_998, 998, 0, 0), (2_632, 998, 0, 0), missed) == (
        "electrode 1: 3 pulses were not fired (ledger); raised up to 1.32 times by a law or an"
        " answer"
    )
