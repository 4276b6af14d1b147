"""Whatever is sent, touched, pressed or asked for: nobody gets more than was allowed, and all that
was taken away is told. The judge is the oracle, by the wires.
"""

from __future__ import annotations

from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.files.body_site import SiteMaxima
from etd.protocol.frame import PHASES, Ring
from etd.pulse.request import PulseRequest
from judged_story import (
    ELECTRODES,
    HALF_BRIDGE_SLOT_NS,
    RELAY_SLOT_NS,
    SLOTS,
    WIDE_OPEN,
    Step,
    electrodes,
    judged,
    stories,
)
from story_teller import Setting, Teller

pytestmark = pytest.mark.slow


def maxima() -> st.SearchStrategy[SiteMaxima]:
    """From wide open to so tight that hardly anything fits."""
    return st.builds(
        SiteMaxima,
        uncalibrated_current_ua=st.just(3_000),
        current_ua=st.sampled_from([400, 3_000, 8_000]),
        width_us=st.sampled_from([100, 200]),
        charge_nc=st.sampled_from([20, 100, 500]),
        rate_hz=st.sampled_from([15, 40, 120]),
        interval_us=st.sampled_from([500, 2_000, 5_000]),
        mean_current_ua=st.sampled_from([1, 4, 30]),
        array_mean_current_ua=st.sampled_from([3, 20, 2_000]),
        on_us_per_s=st.sampled_from([1_000, 3_000, 24_000]),
        array_on_us_per_s=st.sampled_from([3_000, 500_000]),
        net_charge_nc=st.sampled_from([100, 1_000, 15_000]),
    )


def caps(most_ua: int) -> st.SearchStrategy[tuple[int, ...]]:
    generous = st.integers(most_ua // 2, most_ua)
    return st.one_of(
        st.tuples(*[st.integers(50, most_ua)] * ELECTRODES), st.tuples(*[generous] * ELECTRODES)
    )


@st.composite
def return_sets(draw: st.DrawFn) -> tuple[tuple[int, ...], ...]:
    """Two returns at least: of one against one, the wires cannot say who is stimulated."""

    def others(electrode: int) -> st.SearchStrategy[list[int]]:
        return st.lists(electrodes.filter(lambda it: it != electrode), min_size=2, unique=True)

    return tuple(tuple(draw(others(electrode))) for electrode in range(ELECTRODES))


@st.composite
def frames(draw: st.DrawFn, most: SiteMaxima, can_choose_returns: bool) -> Step:
    """Any frame that passes the gateway. Most ask for what is allowed, or for little more."""
    fields: dict[str, Any] = {
        "ttl_ms": draw(st.sampled_from([1, 20, 120, 300])),
        "allow_slower": draw(st.sampled_from([True, True, False])),
        "strict": draw(st.sampled_from([False, False, False, True])),
        "pulses": draw(st.sampled_from([None, None, 1, 3])),
    }
    if draw(st.sampled_from([False, False, False, True])):
        levels = st.sampled_from([0.0, 0.2, 1.0])
        fields["level"] = draw(st.tuples(*[levels] * ELECTRODES))
    else:
        fields |= draw(currents(most))
        if can_choose_returns:
            fields["returns"] = draw(
                st.one_of(st.none(), st.just(Ring(ring_mm=5.0)), return_sets())
            )
    return Step(
        "frame",
        {
            "fields": {key: value for key, value in fields.items() if value is not None},
            "is_streamed": draw(st.booleans()),
            "repeats": draw(st.sampled_from([1, 1, 2, 8])),
            "pause_ms": draw(st.sampled_from([1, 15, 100, 150])),
        },
    )


@st.composite
def currents(draw: st.DrawFn, most: SiteMaxima) -> dict[str, Any]:
    """Around what the maxima leave for one electrode at some width and rate."""
    width_us = draw(st.sampled_from([20, 50, 100, most.width_us]))
    rate_hz = draw(st.sampled_from([5.0, 15.0, 40.0, 120.0]))
    polarity = draw(st.sampled_from(list(PHASES)))
    pulse_us_per_s = width_us * min(rate_hz, most.rate_hz) * len(PHASES[polarity])
    room_ua = int(
        min(
            most.current_ua,
            most.charge_nc * 1_000 / width_us,
            most.mean_current_ua * 1e6 / pulse_us_per_s,
            most.array_mean_current_ua * 1e6 / pulse_us_per_s,
        )
    )
    asked = st.one_of(st.just(0), st.just(0), st.integers(100, max(101, room_ua)))
    current_ua = draw(st.tuples(*[asked] * ELECTRODES))
    if draw(st.sampled_from([False] * 7 + [True])):
        current_ua = (8_000, *current_ua[1:])
    return {
        "current_ua": current_ua,
        "width_us": width_us,
        "polarity": polarity,
        "rate_hz": rate_hz
        if draw(st.sampled_from([False] * 7 + [True]))
        else min(rate_hz, float(most.rate_hz)),
    }


def step(verb: str, **choices: st.SearchStrategy[Any]) -> st.SearchStrategy[Step]:
    return st.builds(Step, st.just(verb), st.fixed_dictionaries(choices))


def steps(board: str, most: SiteMaxima) -> st.SearchStrategy[Step]:
    lines = st.sampled_from(["wearer_stop", "emergency_stop"])
    frame = frames(most, can_choose_returns=board == "feetthrough-relay")
    others = [
        step("lift", electrode=electrodes),
        step("touch", electrode=electrodes),
        step("wait", duration_ms=st.sampled_from([1, 30, 300])),
        step("stall", duration_ms=st.sampled_from([20, 150, 240, 400])),
        *(step(verb) for verb in ("arm", "disarm", "close", "measure", "stop", "clear")),
        step("press", line=lines),
        step("release", line=lines),
    ]
    if board == "reference-hv507":
        factors, times_ms = st.sampled_from([0.3, 0.95, 1.2]), st.sampled_from([5, 200])
        others.append(step("disturb_rail", factor=factors, duration_ms=times_ms))
    person = step("new_person", caps_ua=caps(most.current_ua))
    return st.integers(0, 9).flatmap(
        lambda kind: frame if kind < 6 else person if kind == 6 else st.one_of(*others)
    )


@st.composite
def whole_stories(draw: st.DrawFn, board: str) -> tuple[Setting, tuple[int, ...], list[Step]]:
    most = draw(maxima())
    setting = Setting(board, ELECTRODES, most, SLOTS[board], draw(st.booleans()))
    lifted = draw(st.sets(electrodes, max_size=ELECTRODES - 2))
    told = [Step("lift", {"electrode": electrode}) for electrode in sorted(lifted)]
    told.append(Step("new_person", {"caps_ua": draw(caps(most.current_ua))}))
    told += draw(st.lists(steps(board, most), min_size=1, max_size=14))
    return setting, draw(caps(most.current_ua)), told


@pytest.mark.parametrize("board", list(SLOTS))
def test_nobody_ever_gets_more_than_allowed_and_all_that_is_taken_away_is_told(board: str) -> None:
    @stories
    @given(story=whole_stories(board))
    def any_story(story: tuple[Setting, tuple[int, ...], list[Step]]) -> None:
        setting, caps_ua, told = story
        judged(Teller(setting), caps_ua, told)

    any_story()


requests = st.lists(
    st.builds(PulseRequest, st.integers(0, 200_000), st.integers(20, 400)), min_size=1, max_size=5
)


@stories
@given(story=whole_stories("kajimoto-hv507"), asked=requests)
def test_a_stabilizer_may_ask_for_anything_and_widens_no_limit(
    story: tuple[Setting, tuple[int, ...], list[Step]], asked: list[PulseRequest]
) -> None:
    setting, caps_ua, told = story
    judged(Teller(setting, asked), caps_ua, told)


@pytest.mark.parametrize(
    "behind",
    [PulseRequest(3, 20), PulseRequest(0, 20), PulseRequest(290, 20), PulseRequest(200_000, 400)],
    ids=str,
)
def test_behind_a_probe_a_stabilizer_may_ask_for_anything_as_well(behind: PulseRequest) -> None:
    """For one electrode at 300 uA: its probes are as strong."""
    current_ua = tuple(301 if electrode == 7 else 0 for electrode in range(ELECTRODES))
    frame = {
        "fields": {"current_ua": current_ua, "width_us": 50, "rate_hz": 15.0, "ttl_ms": 300},
        "is_streamed": False,
        "repeats": 3,
        "pause_ms": 150,
    }
    setting = Setting("kajimoto-hv507", ELECTRODES, WIDE_OPEN, HALF_BRIDGE_SLOT_NS, True)
    oracle = judged(
        Teller(setting, [PulseRequest(400, 50), behind]),
        (1_500,) * ELECTRODES,
        [Step("frame", frame)],
    )
    fired = [visit for visit in oracle.visits if visit.state == "ARMED"]
    assert fired
    assert all(visit.phases[0].is_weak for visit in fired)


def test_a_look_goes_back_through_all_others_whatever_returns_its_frame_chose() -> None:
    """Asked because the ledger has no room; and a cap of its own share holds for each return."""
    tight = SiteMaxima(
        uncalibrated_current_ua=3_000,
        current_ua=3_000,
        width_us=100,
        charge_nc=20,
        rate_hz=15,
        interval_us=500,
        mean_current_ua=1,
        array_mean_current_ua=3,
        on_us_per_s=1_000,
        array_on_us_per_s=3_000,
        net_charge_nc=15_000,
    )
    others = (
        (6, 2, 1, 5, 4, 3, 7),
        (2, 6),
        (5, 7, 1, 3),
        (7, 0, 6, 4, 2, 1, 5),
        (1, 0, 2),
        (7, 3, 6, 4),
        (1, 2, 4, 0),
        (5, 4, 2, 3, 0, 1, 6),
    )
    frame = {
        "fields": {
            "current_ua": (0, 0, 0, 0, 129, 184, 0, 0),
            "width_us": 20,
            "rate_hz": 15.0,
            "allow_slower": True,
            "ttl_ms": 120,
            "returns": others,
        },
        "is_streamed": True,
        "repeats": 1,
        "pause_ms": 15,
    }
    teller = Teller(Setting("feetthrough-relay", ELECTRODES, tight, RELAY_SLOT_NS))
    told = [
        *(Step("lift", {"electrode": electrode}) for electrode in (0, 1, 2)),
        Step("new_person", {"caps_ua": (164, 50, 152, 50, 1_324, 1_667, 75, 2_111)}),
        *(Step("frame", frame) for _ in range(3)),
        Step("wait", {"duration_ms": 300}),
    ]
    oracle = judged(teller, (1_500,) * ELECTRODES, told)
    assert any(visit.is_look for visit in oracle.visits)
