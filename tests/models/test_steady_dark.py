"""What is dark between two scans is not felt: the benchmark counts it, in scans of nothing."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

from bench.steady_run import Scans

MS = 1_000_000


def test_a_gap_is_filled_with_scans_of_nothing_and_the_scan_before_it_is_kept() -> None:
    felt: list[tuple[tuple[float], tuple[float]]] = []
    body = SimpleNamespace(take_felt=lambda: felt.pop() if felt else ((0.0,), (0.0,)))
    now = SimpleNamespace(ns=0)
    made: Any = SimpleNamespace(body=body)
    clock: Any = SimpleNamespace(now_ns=lambda: now.ns)
    marker: Any = SimpleNamespace(mark=lambda *_: None)
    scans = Scans(marker, made, clock)
    for seq, at_ms in enumerate((0, 100)):
        now.ns = at_ms * MS
        scans.mark("frame", seq, None)
    felt.append(((1.5,), (0.5,)))
    now.ns = 290 * MS
    scans.dark()
    assert [at_ns // MS for at_ns, _, _ in scans.found] == [0]
    now.ns = 1_000 * MS
    scans.dark()
    scans.mark("frame", 2, None)
    assert [at_ns // MS for at_ns, _, _ in scans.found] == [0, *range(100, 900, 100)]
    assert [was for _, (was,), _ in scans.found] == [0.0, 1.5, *[0.0] * 7]
