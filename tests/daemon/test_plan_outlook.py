"""What a frame's reply tells: the clamps of the pulses that would be fired now."""

from __future__ import annotations

from collections.abc import Collection

import pytest

from engine_parts import currents, frame, planner
from etd.planning.outlook import Outlook
from etd.protocol.errors import Refused

N = 16


def caps(**only: int) -> list[int]:
    """3000 uA everywhere but at the named ones."""
    return [only.get(f"e{electrode}", 3_000) for electrode in range(N)]


def outlook(
    part: float = 1.0 / N,
    ceiling_ua: int = 8_000,
    recontacts_ua: dict[int, int] | None = None,
    is_open: Collection[int] = (),
) -> Outlook:
    """All others are returns, and the one with the smallest cap carries this part."""
    return Outlook(
        lambda path: path.with_returns(path.return_ua / part, path.return_electrode),
        ceiling_ua,
        recontacts_ua or {},
        [electrode not in is_open for electrode in range(N)],
        lambda electrode, current_ua, period_ns: (electrode + current_ua) * period_ns,
    )


def test_through_all_others_a_return_carries_its_share() -> None:
    made = planner(caps_ua=caps(e3=300))
    (clamp,) = made.plan(frame(current_ua=currents(e2=900)), outlook(0.5)).clamped
    assert (clamp.allowed_ua, clamp.reason, clamp.limited_by) == (600, "return_cap", 3)
    assert not made.plan(frame(current_ua=currents(e2=900)), outlook(0.3)).clamped


def test_before_anything_is_known_of_them_all_others_carry_the_same() -> None:
    made = planner(caps_ua=caps(e3=60))
    (clamp,) = made.plan(frame(current_ua=currents(e2=1_000))).clamped
    assert (clamp.allowed_ua, clamp.reason, clamp.limited_by) == (60 * (N - 1), "return_cap", 3)


def test_the_weakest_of_all_is_not_its_own_return() -> None:
    made = planner(caps_ua=caps(e3=500, e4=600))
    (clamp,) = made.plan(frame(current_ua=currents(e3=2_900)), outlook(1.0)).clamped
    assert (clamp.allowed_ua, clamp.limited_by) == (500, 3)
    path = made.plan(frame(current_ua=currents(e3=100))).schedule[0].path
    assert (path.cap_ua, path.return_ua, path.return_electrode) == (500, 600, 4)


@pytest.mark.parametrize(
    ("known", "allowed_ua", "reason", "ends_in_ms"),
    [
        (outlook(ceiling_ua=650), 650, "soft_start", (2 + 900) * 50),
        (outlook(ceiling_ua=650, recontacts_ua={2: 100}), 100, "recontact", (2 + 900) * 50),
        (outlook(is_open={2}), 300, "contact_open", None),
    ],
)
def test_what_would_be_fired_now_is_told_and_when_it_would_be_all(
    known: Outlook, allowed_ua: int, reason: str, ends_in_ms: int | None
) -> None:
    asked = {"current_ua": currents(e2=900, e5=200), "rate_hz": 20.0}
    made = planner()
    assert not made.plan(frame(**asked), outlook()).clamped
    (clamp,) = made.plan(frame(**asked), known).clamped
    assert (clamp.electrode, clamp.allowed_ua, clamp.reason) == (2, allowed_ua, reason)
    assert clamp.ends_in_ms == ends_in_ms
    with pytest.raises(Refused, match=f"900 uA and would get {allowed_ua} uA"):
        made.plan(frame(strict=True, **asked), known)


def test_strict_refuses_what_would_be_clamped() -> None:
    made = planner(caps_ua=caps(e2=700))
    with pytest.raises(Refused) as caught:
        made.plan(frame(current_ua=currents(e2=900), strict=True))
    refusal = caught.value
    assert (refusal.code, refusal.electrode) == ("over_limit", 2)
    assert "900 uA" in refusal.reason
    assert "700 uA" in refusal.reason
    made.plan(frame(current_ua=currents(e2=700), strict=True))


# --- does it fit ----------------------------------------------------------------------------------
