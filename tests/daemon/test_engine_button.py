"""The wearer's button that says too strong, held against the wires."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from engine_rig import EngineRig
from engine_scenes import MS, clamps, config, fully_open, only, phases, states
from etd.stabilize.said_electrode import AT_ONCE_TIMES, LOWERED_BY
from etd_hal.boardfile import EdgeInput

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
KIT = "kajimoto-hv507"
CURRENT_UA = 1_500


def hold(rig: EngineRig, duration_ms: float, rate_hz: float = 20.0) -> None:
    rig.hold(duration_ms, current_ua=only(N, e4=CURRENT_UA), rate_hz=rate_hz, ttl_ms=1_000)


def with_button(make_rig: MakeRig, edge: str = "falling") -> EngineRig:
    """Its electrode 4 felt for half a second."""
    button = EdgeInput(line=6, edge=edge)  # type: ignore[arg-type]
    rig = fully_open(make_rig(loaded=config(KIT, too_strong=button)), CURRENT_UA)
    hold(rig, 500)
    return rig


def last_ua(rig: EngineRig) -> float:
    return [phase.current_ua for phase in phases(rig) if phase.electrode == 4][-1]


@pytest.mark.parametrize("edge", ["rising", "falling"])
def test_a_press_lowers_the_next_pulse_and_is_told(make_rig: MakeRig, edge: str) -> None:
    rig = with_button(make_rig, edge)
    assert last_ua(rig) == pytest.approx(CURRENT_UA, abs=5)
    rig.fake.world.say_too_strong()
    hold(rig, 200)
    assert last_ua(rig) == pytest.approx((1 - LOWERED_BY) * CURRENT_UA, abs=5)
    assert clamps(rig)[-1].reason == "felt"
    told = states(rig)[-1].felt
    assert told is not None
    assert (told.answers, told.answer, told.electrodes) == (1, "too_strong", None)
    assert told.lowers_only


def test_a_press_that_bounces_counts_once_and_the_next_press_again(make_rig: MakeRig) -> None:
    rig = with_button(make_rig)
    now_ns = rig.clock.now_ns()
    for at_ms in (1, 3, 8, 90):
        rig.fake.world.say_too_strong(now_ns + at_ms * MS, lasts_ns=MS // 2)
    hold(rig, 300)
    assert last_ua(rig) == pytest.approx((1 - LOWERED_BY) * CURRENT_UA, abs=5)
    rig.fake.world.say_too_strong()
    hold(rig, 200)
    lowered = (1 - LOWERED_BY) * (1 - AT_ONCE_TIMES * LOWERED_BY)
    assert last_ua(rig) == pytest.approx(lowered * CURRENT_UA, abs=5), (
        "said again, four times as much"
    )


def test_a_press_while_nothing_can_be_felt_says_nothing(make_rig: MakeRig) -> None:
    rig = make_rig(loaded=config(KIT, too_strong=EdgeInput(line=6, edge="falling")))
    rig.fake.world.say_too_strong()
    rig.run_ms(50)
    fully_open(rig, CURRENT_UA)
    hold(rig, 500)
    assert last_ua(rig) == pytest.approx(CURRENT_UA, abs=5)
    assert states(rig)[-1].felt is None


def test_what_it_took_comes_back_by_the_holders_word_alone(make_rig: MakeRig) -> None:
    """The button never raises: not by its release, and not by time."""
    rig = with_button(make_rig)
    rig.fake.world.say_too_strong(lasts_ns=50 * MS)
    hold(rig, 10_000, rate_hz=5.0)
    assert last_ua(rig) == pytest.approx((1 - LOWERED_BY) * CURRENT_UA, abs=5)


def test_a_board_without_one_has_nothing_to_press(make_rig: MakeRig) -> None:
    with pytest.raises(ValueError, match="kajimoto-hv507 has no too_strong"):
        make_rig(loaded=config(KIT)).fake.world.say_too_strong()
