"""How long a client shows, and waits: above nothing, and with a bound."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import pytest

from etd import Display, Refused
from gateway_rig import ServedRig


@pytest.fixture
def rig() -> Iterator[ServedRig]:
    with ServedRig() as rig:
        yield rig


def display(rig: ServedRig) -> Display:
    return Display(address=rig.address, max_current_ua=3000, width_us=100, client="me")


@pytest.mark.parametrize("show", ["hold", "present", "begin"])
@pytest.mark.parametrize(
    "seconds",
    [float("nan"), float("inf"), -math.inf, -1, 0, "1", None, True, 1e308, 604_801, 10**400],
    ids=lambda given: str(given)[:10],
)
def test_a_frame_for_no_duration_is_refused_and_nothing_is_sent(
    rig: ServedRig, seconds: Any, show: str
) -> None:
    with display(rig) as d:
        d.arm()
        with pytest.raises(Refused, match="seconds=") as caught:
            getattr(d, show)([0, 0, 0, 1], seconds=seconds)
    assert len(str(caught.value)) < 200
    assert list(rig.engine.frames) == []


@pytest.mark.parametrize("timeout_s", [math.nan, math.inf, -1.0, 0.0, 1e308])
def test_nothing_is_waited_for_without_a_bound(rig: ServedRig, timeout_s: float) -> None:
    with display(rig) as d:
        for wait in (d.arm, d.measure):
            with pytest.raises(Refused, match="timeout_s="):
                wait(timeout_s=timeout_s)
        if not timeout_s <= 0:  # as much as at once
            with d.telemetry("halt") as reports, pytest.raises(Refused, match="timeout_s="):
                reports.receive(timeout_s)
    with pytest.raises(Refused, match="timeout_s="):
        Display(address=rig.address, timeout_s=timeout_s)
