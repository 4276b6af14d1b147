"""The oracle itself: told of tighter limits than the engine knew, each of its judgments fails."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import cache

import msgspec
import pytest

from engine_oracle import Oracle, Story
from etd.files.body_site import SiteMaxima
from etd.protocol.link import Report
from story_teller import Setting, Teller
from trace_decoder import Record

MAXIMA = SiteMaxima(
    uncalibrated_current_ua=3_000,
    current_ua=3_000,
    width_us=200,
    charge_nc=500,
    rate_hz=120,
    interval_us=2_000,
    mean_current_ua=3,
    array_mean_current_ua=2_000,
    on_us_per_s=24_000,
    array_on_us_per_s=500_000,
    net_charge_nc=15_000,
)
CAPS_UA = (300, *(2_000,) * 7)


@cache
def told() -> tuple[Story, list[Record]]:
    """Two electrodes for a while, one of them above its cap; then too often for the ledger."""
    teller = Teller(Setting("reference-hv507", 8, MAXIMA, 1_500_000))
    teller.open(CAPS_UA)
    teller.arm()
    fields = {"current_ua": (500, 700, *(0,) * 6), "width_us": 100, "rate_hz": 40.0, "ttl_ms": 150}
    teller.frame(fields, is_streamed=False, repeats=12, pause_ms=120)
    return teller.story, teller.end()


Lie = Callable[[Story], Story]


def with_bound(**values: int) -> Lie:
    return lambda story: replace(story, bounds=replace(story.bounds, **values))


def with_frames(ttl_ms: int) -> Lie:
    return lambda story: replace(
        story, frames={seq: replace(sent, ttl_ms=ttl_ms) for seq, sent in story.frames.items()}
    )


def with_caps(*caps_ua: int) -> Lie:
    return lambda story: replace(story, caps=[(t_ns, caps_ua) for t_ns, _ in story.caps])


def without(**empty: tuple[()]) -> Lie:
    """Reports from which something was left out."""

    def lie(story: Story) -> Story:
        reports = [
            report
            if report.scan is None
            else msgspec.structs.replace(report, scan=msgspec.structs.replace(report.scan, **empty))
            for report in story.reports
        ]
        return replace(story, reports=reports)

    return lie


def without_states(story: Story) -> Story:
    return replace(story, reports=[report for report in story.reports if report.state is None])


def with_an_arming_between(story: Story) -> Story:
    """As if what was fired in the first half had been before the arming."""
    armed = next(
        report.state for report in story.reports if report.state and report.state.state == "ARMED"
    )
    half = len(story.reports) // 2
    reports = story.reports[half:]
    now_ns = next(report.scan.now_ns for report in reports if report.scan is not None)
    between = [
        Report(state=msgspec.structs.replace(armed, state=state, now_ns=now_ns))
        for state in ("SAFE", "ARMED")
    ]
    return replace(story, reports=[*story.reports[:half], *between, *reports])


def with_an_early_press(story: Story) -> Story:
    first = next(iter(story.frames.values()))
    return replace(story, presses=[*story.presses, first.expires_ns])


def test_the_story_as_it_was_is_within_all_judgments() -> None:
    story, trace = told()
    oracle = Oracle(story, trace)
    oracle.check_all()
    assert {visit.state for visit in oracle.visits} == {"PROBE", "ARMED"}
    assert any(scan.clamped for scan in oracle.scans)
    assert any(scan.not_fired for scan in oracle.scans)


@pytest.mark.parametrize(
    ("judgment", "lie"),
    [
        ("check_states", without_states),
        ("check_states", with_bound(probe_current_ua=200)),
        ("check_states", with_bound(probe_width_us=30)),
        ("check_caps", with_caps(200, *CAPS_UA[1:])),
        ("check_caps", with_caps(*CAPS_UA[:-1], 10)),
        ("check_charges", with_bound(charge_pc=40_000)),
        ("check_windows", with_bound(mean_current_ua=2)),
        ("check_windows", with_bound(rate_hz=30)),
        ("check_windows", with_bound(on_us_per_s=3_000)),
        ("check_windows", with_bound(array_mean_current_ua=3)),
        ("check_windows", with_bound(array_on_us_per_s=5_000)),
        ("check_expiry", with_frames(ttl_ms=60)),
        ("check_opening", with_an_arming_between),
        ("check_stops", with_an_early_press),
        ("check_clamps_are_told", without(clamped=())),
        ("check_thinning_is_told", without(clamped=(), not_fired=())),
    ],
)
def test_a_judgment_fails_when_more_was_given_than_it_is_told(judgment: str, lie: Lie) -> None:
    story, trace = told()
    oracle = Oracle(lie(story), trace)
    with pytest.raises(AssertionError):
        getattr(oracle, judgment)()
