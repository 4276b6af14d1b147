"""The scene beside a load: what its figures are judged as."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bench import wall_scan
from bench.wall_scene import Found, verdict

MS = 1_000_000
#: A second, with a stall of 1 ms; a lock that is never waited for.
QUIET = Found(
    1.0, stalls_ns=[(100 * MS, 101 * MS)], figures={wall_scan.LOCK_WAITS: {"p99.9": 20.0}}
)


def test_a_halt_is_the_hosts_within_5_ms_of_a_stall_and_not_else() -> None:
    assert verdict(QUIET, with_threads=False) == 0
    for halt_ms, status in ((100, 0), (106, 0), (107, 1), (99, 1)):
        halted = replace(QUIET, halts=[(halt_ms * MS, "why")])
        assert verdict(halted, with_threads=False) == status, halt_ms


def test_a_scan_that_waits_for_the_lock_fails_and_threads_must() -> None:
    waits = replace(QUIET, figures={wall_scan.LOCK_WAITS: {"p99.9": 60.0}})
    assert verdict(waits, with_threads=False) == 1
    assert verdict(waits, with_threads=True) == 0
    assert verdict(QUIET, with_threads=True) == 1


def test_time_that_two_stalls_excuse_counts_once() -> None:
    found = replace(QUIET, stalls_ns=[(500 * MS, 510 * MS), (2 * MS, 3 * MS), (0, 1 * MS)])
    assert found.excused_share() == pytest.approx(0.008 + 0.015)


@pytest.mark.parametrize("with_threads", [False, True])
def test_on_a_host_that_excuses_a_tenth_of_the_time_nothing_is_shown(
    capsys: pytest.CaptureFixture[str], with_threads: bool
) -> None:
    busy = replace(QUIET, stalls_ns=[(10 * n * MS, (10 * n + 1) * MS) for n in range(17)])
    assert verdict(busy, with_threads) == 3
    assert "nothing is shown" in capsys.readouterr().out
    quieter = replace(busy, stalls_ns=busy.stalls_ns[:16])
    assert verdict(quieter, with_threads) != 3
