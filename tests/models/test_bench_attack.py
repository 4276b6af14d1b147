"""The benchmark of a gateway under attack: what it judges, and that its strangers reach one."""

from __future__ import annotations

import dataclasses
from typing import Any

from bench import attack

GOOD = attack.Figures("flood", 200, 0, 30.0, 90.0, 1.0, 19.0, 2.0, 49.0, 90.0, 290)


def test_each_figure_above_its_bound_is_not_met() -> None:
    assert all(bound.is_met for bound in attack.bounds(GOOD))
    worse: dict[str, Any] = {
        "lost": 1,
        "heard_p99_ms": 20.1,
        "answered_p99_ms": 50.1,
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
    assert found.most_descriptors > 0
