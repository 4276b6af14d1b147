"""Net charge at the wire: what the body itself has left of it, and what is told."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest

from charge_witness import even_skin
from engine_rig import EngineRig
from engine_scenes import config, fully_open, only, shortfalls
from etd.safety.net_charge import LEAK_NS
from etd_body.minimal import MinimalBody

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
BOUND_UC = 10.0
#: 2.4 mA for 120 us, 100 times a second: 28.8 uA of the 30 that the site allows.
STRONG = {"current_ua": only(N, e3=2_400), "width_us": 120, "rate_hz": 100.0}


class Left:
    """What the body got, and what a leak of a second leaves of it, electrode by electrode."""

    def __init__(self, body: MinimalBody) -> None:
        self._body = body
        self._before_pc = [0.0] * N
        self._at_ns = 0
        self.pc = [0.0] * N
        self.most_uc = 0.0

    def look(self, now_ns: int) -> None:
        decay = math.exp(-(now_ns - self._at_ns) / LEAK_NS)
        got_pc = [self._body.charge_pc(electrode) for electrode in range(N)]
        each = zip(self.pc, got_pc, self._before_pc, strict=True)
        self.pc = [pc * decay + got - before for pc, got, before in each]
        self._before_pc, self._at_ns = got_pc, now_ns
        self.most_uc = max(self.most_uc, *(abs(pc) / 1e6 for pc in self.pc))


def rig_and_left(make_rig: MakeRig) -> tuple[EngineRig, Left]:
    loaded = config(electrodes=N)
    body = even_skin(loaded.board, N)
    rig, left = make_rig(loaded=loaded, body=body), Left(body)
    rig.meanwhile = left.look
    fully_open(rig)
    assert renewed(rig, 2.0, current_ua=(0,) * N) is None
    left.most_uc = 0.0
    return rig, left


def renewed(rig: EngineRig, seconds: float, **fields: object) -> str | None:
    """Shown and renewed as a client does; the reason of the first refusal."""
    for _ in range(int(seconds / 0.1)):
        answer = rig.show(ttl_ms=200, **fields)
        if answer.error is not None:
            return answer.reason
        rig.run_ms(100)
    return None


def test_direct_current_ends_in_a_refusal_before_the_body_has_its_bound(make_rig: MakeRig) -> None:
    rig, left = rig_and_left(make_rig)
    first = rig.show(ttl_ms=200, **STRONG)
    (told,) = [it for it in first.slowed if it.reason == "net_charge"]
    assert told.electrode == 3
    why = renewed(rig, 2.0, **STRONG)
    assert why is not None
    assert "net charge" in why
    rig.run_ms(300)
    assert 0.7 * BOUND_UC < left.most_uc <= BOUND_UC
    assert shortfalls(rig) == []


def test_what_lasts_is_shown_for_ever_and_stays_below_the_bound(make_rig: MakeRig) -> None:
    rig, left = rig_and_left(make_rig)
    first = rig.show(preview=True, **STRONG)
    (told,) = [it for it in first.slowed if it.reason == "net_charge"]
    assert renewed(rig, 3.0, **{**STRONG, "rate_hz": told.lasting_hz}) is None
    assert 0.8 * BOUND_UC < left.most_uc <= BOUND_UC


def test_biphasic_pulses_of_the_same_current_leave_next_to_nothing(make_rig: MakeRig) -> None:
    rig, left = rig_and_left(make_rig)
    asked = {**STRONG, "rate_hz": 50.0, "polarity": "biphasic"}
    assert renewed(rig, 1.0, **asked) is None
    assert left.most_uc < 0.5
