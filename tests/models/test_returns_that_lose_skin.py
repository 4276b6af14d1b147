"""Returns that lose the skin while a frame stands: in any order, no other carries too much."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from judged_story import (
    ELECTRODES,
    HALF_BRIDGE_SLOT_NS,
    WIDE_OPEN,
    Step,
    electrodes,
    judged,
    stories,
)
from story_teller import Setting, Teller


@stories
@given(
    caps_ua=st.tuples(*[st.sampled_from([300, 1_000, 3_000])] * ELECTRODES),
    active=st.sets(electrodes, min_size=1, max_size=2),
    staying=st.sets(electrodes, min_size=1, max_size=2),
    is_at_once=st.booleans(),
    pause_ms=st.sampled_from([10, 2_000]),
    is_probe_first=st.booleans(),
)
def test_returns_that_lose_the_skin_while_a_frame_stands_make_no_other_return_carry_too_much(
    caps_ua: tuple[int, ...],
    active: set[int],
    staying: set[int],
    is_at_once: bool,
    pause_ms: int,
    is_probe_first: bool,
) -> None:
    teller = Teller(
        Setting("kajimoto-hv507", ELECTRODES, WIDE_OPEN, HALF_BRIDGE_SLOT_NS, is_probe_first)
    )
    current_ua = tuple(3_000 if electrode in active else 0 for electrode in range(ELECTRODES))
    frame = {
        "fields": {"current_ua": current_ua, "width_us": 100, "rate_hz": 60.0},
        "is_streamed": False,
        "repeats": 14,
        "pause_ms": 100,
    }
    told = [Step("frame", frame), Step("wait", {"duration_ms": pause_ms})]
    for other in sorted(set(range(ELECTRODES)) - active - staying):
        told.append(Step("lift", {"electrode": other}))
        if not is_at_once:
            told.append(Step("frame", {**frame, "repeats": 3}))
    told.append(Step("frame", {**frame, "repeats": 18}))
    judged(teller, caps_ua, told)
