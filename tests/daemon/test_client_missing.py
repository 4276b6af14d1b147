"""What is missing of a presentation, electrode by electrode, from the accounts of its frames."""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.client.daemon_clock import DaemonClock
from etd.client.presented import Cut, presented_of
from scripted_engine import account

WANTED_UA = (2_000, 2_000, 2_000, 0)
MS = 1_000_000


def why_not(
    pulses: tuple[int, ...],
    *,
    seconds: float = 1.0,
    cuts: tuple[Cut, ...] = (),
    rate_hz: object = None,
    **changes: Any,
) -> tuple[str, ...]:
    fields = {} if rate_hz is None else {"rate_hz": rate_hz}
    told = account(
        1, pulses=pulses, wanted_ua=WANTED_UA, least_ua=WANTED_UA, most_ua=WANTED_UA, **changes
    )
    return presented_of([told], fields, seconds, cuts, DaemonClock(is_here=True)).why_not


def test_an_electrode_that_got_half_its_pulses_is_named() -> None:
    assert why_not((60, 30, 60, 0)) == ("electrode 1: 30 of about 60 pulses",)
    assert why_not((60, 60, 59, 0)) == ()


def test_what_late_scans_took_from_all_is_told_once() -> None:
    (why,) = why_not((30, 30, 29, 0))
    assert why.startswith("30 of about 60 pulses were fired: scans came late")
    late, named = why_not((30, 15, 30, 0))
    assert late.startswith("30 of about 60")
    assert named == "electrode 1: 15 of about 60 pulses"


def test_electrodes_with_rates_of_their_own_are_held_against_these() -> None:
    rates_hz = [60.0, 20.0, 30.0, 60.0]
    assert why_not((60, 20, 30, 0), rate_hz=rates_hz) == ()
    assert why_not((60, 10, 30, 0), rate_hz=rates_hz) == ("electrode 1: 10 of about 20 pulses",)


def test_electrodes_of_a_burst_are_held_against_one_another() -> None:
    assert why_not((180, 180, 177, 0)) == ()
    assert why_not((180, 180, 90, 0)) == ("electrode 2: 90 of about 180 pulses",)


@pytest.mark.parametrize("cut", ["replaced", "ended", "refused"])
def test_what_was_cut_short_is_held_against_the_time_that_it_had(cut: Cut) -> None:
    """By the engine's clock; an older daemon does not tell."""
    (why,) = why_not((18, 18, 18, 0), cuts=(cut,), begun_ns=5 * MS, ended_ns=305 * MS)
    assert why.endswith("after 0.3 s")
    named, _ = why_not((18, 9, 18, 0), cuts=(cut,), begun_ns=5 * MS, ended_ns=305 * MS)
    assert named == "electrode 1: 9 of about 18 pulses"
    (why,) = why_not((18, 18, 18, 0), cuts=(cut,))
    assert "after" not in why


@given(
    seconds=st.floats(0.05, 30.0),
    phases=st.lists(st.floats(0.0, 0.99), min_size=3, max_size=3),
    slower=st.lists(st.sampled_from([1.0, 0.9, 0.5, 0.1]), min_size=2, max_size=2),
    begun=st.floats(0.0, 1.0),
)
def test_pulses_at_their_times_are_never_said_to_be_missing(
    seconds: float, phases: list[float], slower: list[float], begun: float
) -> None:
    """Wherever in a scan an electrode's place is, and where the frame's end cuts the last one."""
    scans = int(60.0 * seconds - begun) + 1
    shares = [1.0, *slower]
    pulses = tuple(
        # Not rested in the first scan: its turn comes a share at a time.
        max(1, int(phase + share * scans) if share < 1.0 else scans - (phase > 0.5))
        for phase, share in zip(phases, shares, strict=True)
    )
    rates_hz = [*(60.0 * share for share in shares), 60.0]
    assert why_not((*pulses, 0), seconds=seconds, rate_hz=rates_hz) == ()
