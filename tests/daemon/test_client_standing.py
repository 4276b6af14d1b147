"""Since when a frame of a pattern counts as shown, told by reports."""

from __future__ import annotations

from dataclasses import replace

import pytest

from etd.client.standing import Standing
from etd.client.steps import Step
from etd.protocol.errors import Refused
from etd.protocol.messages import Fired, Scan, Shown
from etd.protocol.outcome import Clamp

MS = 1_000_000
BEGUN_NS = 1_000 * MS
STRONG = Step(
    kind="current_ua", numbers=(2_000,), options={"tag": 3}, duration_ms=100, largest_ua=2_000
)


def standing(step: Step = STRONG) -> Standing:
    return Standing(step, {7}, BEGUN_NS, BEGUN_NS + 350 * MS)


def report(
    after_ms: float,
    *,
    ceiling_ua: int,
    fired_ms: float | None = None,
    is_clamped: bool = False,
    seq: int = 7,
) -> Scan:
    """So long after the frame has begun; its last pulse was then."""
    last_ns = None if fired_ms is None else BEGUN_NS + int(fired_ms * MS)
    clamp = Clamp(
        electrode=0, wanted_ua=2_000, allowed_ua=ceiling_ua, reason="soft_start", limited_by=0
    )
    return Scan(
        now_ns=BEGUN_NS + int(after_ms * MS),
        shown=(
            Shown(
                seq=seq,
                tag=3,
                begun_ns=BEGUN_NS,
                first_ns=None if last_ns is None else BEGUN_NS,
                last_ns=last_ns,
                ended=False,
            ),
        ),
        seq=seq,
        tag=3,
        scans=1,
        fired=Fired(
            wanted_ua=(), current_ua=(), delivered_ua=(), width_us=(), voltage_v=(),
            resistance_ohm=(), contact=(),
        ),
        clamped=(clamp,) if is_clamped else (),
        not_fired=(),
        ceiling_ua=ceiling_ua,
        dropped_reports=0,
    )  # fmt: skip


def held(standing: Standing) -> bool:
    """Held, and not counted as begun."""
    return standing.is_held and standing.begun_ns is None


def heard(standing: Standing, *scans: Scan) -> Standing:
    for scan in scans:
        standing.hear(scan, scan.now_ns)
    return standing


def test_a_frame_of_which_nothing_is_taken_counts_from_its_first_scan() -> None:
    one = heard(standing(), report(5, ceiling_ua=3_000, fired_ms=1))
    assert (one.begun_ns, one.is_held, one.held_ms) == (BEGUN_NS, False, 0.0)
    assert one.due_ns == BEGUN_NS + 100 * MS


def test_a_report_before_its_first_pulse_tells_nothing_yet() -> None:
    one = heard(standing(), report(0, ceiling_ua=500))
    assert one.begun_ns is None
    heard(one, report(33, ceiling_ua=900, fired_ms=20, is_clamped=True))
    assert one.is_held


def test_a_frame_without_a_pulse_counts_all_the_same() -> None:
    assert heard(standing(), report(0, ceiling_ua=0), report(120, ceiling_ua=0)).begun_ns == (
        BEGUN_NS
    )
    silent = replace(STRONG, numbers=(0,), largest_ua=0)
    assert heard(standing(silent), report(0, ceiling_ua=0)).begun_ns == BEGUN_NS


def test_a_frame_that_the_opening_takes_from_counts_from_when_it_does_not() -> None:
    one = heard(
        standing(),
        report(1, ceiling_ua=500, fired_ms=0.5, is_clamped=True),
        report(300, ceiling_ua=1_990, fired_ms=290, is_clamped=True),
    )
    assert held(one)
    heard(one, report(333, ceiling_ua=2_400, fired_ms=330))
    assert (one.begun_ns, one.is_held, one.held_ms) == (BEGUN_NS + 333 * MS, False, 333.0)


def test_a_report_that_came_before_the_strong_pulse_is_taken_back() -> None:
    one = heard(standing(), report(1, ceiling_ua=500, fired_ms=0.5))
    assert one.begun_ns == BEGUN_NS
    heard(one, report(34, ceiling_ua=700, fired_ms=33, is_clamped=True))
    assert held(one)


def test_reports_between_its_pulses_release_nothing() -> None:
    one = heard(standing(), report(1, ceiling_ua=500, fired_ms=0.5, is_clamped=True))
    for after_ms in range(34, 200, 33):
        heard(one, report(after_ms, ceiling_ua=500, fired_ms=0.5))
    assert one.is_held


def test_a_frame_that_other_limits_hold_below_the_ceiling_is_released() -> None:
    """Its cap is 1 mA: the opening will never be as high as what it asks for."""
    one = heard(
        standing(),
        report(1, ceiling_ua=500, fired_ms=0.5, is_clamped=True),
        report(150, ceiling_ua=1_400, fired_ms=140),
        report(183, ceiling_ua=1_500, fired_ms=180),
    )
    assert one.begun_ns == BEGUN_NS + 183 * MS


def test_it_is_held_once_at_the_most() -> None:
    one = heard(
        standing(),
        report(1, ceiling_ua=500, fired_ms=0.5, is_clamped=True),
        report(100, ceiling_ua=2_000, fired_ms=99),
        report(133, ceiling_ua=2_000, fired_ms=130, is_clamped=True),
    )
    assert not one.is_held
    assert one.begun_ns == BEGUN_NS + 100 * MS


def test_an_opening_that_does_not_rise_is_refused() -> None:
    one = heard(standing(), report(1, ceiling_ua=500, fired_ms=0.5, is_clamped=True))
    heard(one, report(14_000, ceiling_ua=600, fired_ms=13_000, is_clamped=True))
    heard(one, report(28_000, ceiling_ua=600, fired_ms=27_000, is_clamped=True))
    with pytest.raises(Refused, match="stays at 600 uA, below the 2000 uA of frame 3"):
        heard(one, report(29_100, ceiling_ua=600, fired_ms=29_000, is_clamped=True))


def test_reports_of_other_frames_say_nothing_of_it() -> None:
    one = heard(standing(), report(5, ceiling_ua=3_000, fired_ms=1, is_clamped=True, seq=6))
    assert (one.begun_ns, one.is_held) == (None, False)
