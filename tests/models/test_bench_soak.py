"""`make soak`: a few seconds of it with a real daemon, and that it can say no."""

from __future__ import annotations

from rich.console import Console
from rich.progress import Progress

from bench.soak import Look, Restarted, Soaked, bounds_of, restart, soak, summary


def looked(mb: list[float], descriptors: list[int] | None = None) -> Soaked:
    counts = descriptors or [30] * len(mb)
    looks = [Look(float(at), mb[at], counts[at], 5.0, 4.0) for at in range(len(mb))]
    return Soaked(float(len(mb)), looks, state="ARMED")


def not_met(soaked: Soaked, restarted: Restarted | None = None) -> list[str]:
    held = bounds_of(soaked, restarted or Restarted())
    return [bound.what for bound in held if not bound.is_met]


def test_memory_that_grows_after_the_warm_up_is_found_and_before_it_is_not() -> None:
    assert not_met(looked([50.0 + it for it in range(10)] + [60.0] * 30)) == []
    assert not_met(looked([50.0 + it for it in range(40)])) == ["memory grown, MB"]


def test_descriptors_losses_and_halts_are_found() -> None:
    steady = [60.0] * 40
    assert not_met(looked(steady, [30 + it for it in range(40)])) == ["descriptors grown"]
    lost = looked(steady)
    lost.refused.append("no lease stands (no_lease)")
    lost.state = "HALTED"
    assert not_met(lost) == ["frames refused or lost", "not ARMED at the end"]
    missed = looked(steady)
    missed.halt = "rail: 12 V"
    assert not_met(missed) == ["halts, a missed beat among them"]
    assert not_met(Soaked(0.0), Restarted([1.0], [1.0], ["start 0: ended with 1"])) == [
        "restarts that went wrong"
    ]


def test_a_daemon_plays_beside_a_hog_and_starts_again() -> None:
    with Progress(console=Console(quiet=True)) as progress:
        soaked, restarted = soak(4.0, progress), restart(1, progress)
    assert soaked.refused == []
    assert soaked.halt is None
    assert soaked.state == "ARMED"
    assert soaked.counters["frames_shown"] > 20
    assert len(soaked.looks) >= 2
    found = summary(soaked, restarted)
    assert found["restarts"] == 1
    assert {"frame_ms", "status_ms", "started_ms", "mb", "descriptors"} <= set(found)
