"""The benchmark of a gateway under attack: what it judges, and that its strangers reach one."""

from __future__ import annotations

import dataclasses
from typing import Any

from bench import attack

GOOD = attack.Figures(
    load="flood",
    stops=200,
    lost=0,
    connected_p50_ms=30.0,
    connected_p99_ms=90.0,
    heard_p50_ms=1.0,
    heard_p99_ms=19.0,
    answered_p50_ms=2.0,
    answered_p99_ms=49.0,
    commands=20,
    command_failed=0,
    command_p50_ms=90.0,
    command_most_ms=180.0,
    most_mb=90.0,
    most_descriptors=290,
)


def test_each_figure_above_its_bound_is_not_met() -> None:
    assert all(bound.is_met for bound in attack.bounds(GOOD))
    worse: dict[str, Any] = {
        "lost": 1,
        "heard_p99_ms": 20.1,
        "answered_p99_ms": 50.1,
        "command_failed": 1,
        "most_mb": 100.1,
        "most_descriptors": 301,
    }
    for name, value in worse.items():
        found = attack.bounds(dataclasses.replace(GOOD, **{name: value}))
        assert [bound.is_met for bound in found].count(False) == 1, name


def test_a_stop_is_heard_while_somebody_asks_for_slow_things() -> None:
    found = attack.measure("slow", ("ask_for_slow_things",), 5)
    assert (found.stops, found.lost) == (5, 0)
    assert 0.0 < found.heard_p50_ms <= found.heard_p99_ms
    assert (found.commands, found.command_failed) == (1, 0)
    assert found.command_p50_ms > found.answered_p50_ms
    assert found.most_descriptors > 0


def test_users_who_take_the_places_take_them() -> None:
    found = attack.measure("places", ("hold_places", "churn_places"), 5)
    assert (found.stops, found.lost, found.command_failed) == (5, 0, 0)
    assert found.most_descriptors > 60
