"""Net charge at the wire: what the body itself has left of it, and what is told."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Literal

import msgspec
import pytest

from charge_witness import even_skin
from engine_rig import LEASE, EngineRig
from engine_scenes import config, fully_open, only, phases, shortfalls, states
from etd.protocol.link import AskAccount
from etd_body.electrode import Contact, load
from net_witness import NetWitness

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
BOUND_UC = 10.0
#: 2.4 mA for 120 us, 100 times a second: 28.8 uA of the 30 that the site allows.
STRONG = {"current_ua": only(N, e3=2_400), "width_us": 120, "rate_hz": 100.0}


def rig_and_left(
    make_rig: MakeRig,
    contacts: Sequence[Contact] | None = None,
    balance: Literal["biphasic"] | None = None,
) -> tuple[EngineRig, NetWitness]:
    """Even skin, or with these contacts. `balance`: as the body site has it."""
    loaded = config(electrodes=N)
    site = msgspec.structs.replace(loaded.body_site, balance=balance)
    loaded = replace(loaded, body_site=site)
    body = even_skin(loaded.board, N)
    for electrode, contact in enumerate(contacts or ()):
        body.touch(0, electrode, contact)
    rig, left = make_rig(loaded=loaded, body=body), NetWitness(body)
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
    assert 0.6 * BOUND_UC < left.most_uc <= BOUND_UC


def test_biphasic_pulses_of_the_same_current_leave_next_to_nothing(make_rig: MakeRig) -> None:
    rig, left = rig_and_left(make_rig)
    asked = {**STRONG, "rate_hz": 50.0, "polarity": "biphasic"}
    assert renewed(rig, 1.0, **asked) is None
    assert left.most_uc < 0.5


def test_a_site_that_balances_shows_for_ever_what_would_pass_the_bound(make_rig: MakeRig) -> None:
    """With both phases from the first pulse on, as the reply says."""
    rig, left = rig_and_left(make_rig, balance="biphasic")
    begun_ns = rig.clock.now_ns()
    asked = {**STRONG, "rate_hz": 50.0}
    first = rig.show(ttl_ms=200, **asked)
    assert [(it.electrode, it.reason) for it in first.slowed] == [(3, "balanced")]
    assert renewed(rig, 3.0, **asked) is None
    assert left.most_uc < 0.5
    ways = [it.is_anodic for it in phases(rig, begun_ns) if it.electrode == 3]
    assert len(ways) > 100
    assert ways == [True, False] * (len(ways) // 2)
    assert shortfalls(rig) == []
    rig.run_ms(1_100)
    # The first one was replaced before its scan began.
    assert states(rig)[-1].counters["balanced"] == 30


def test_the_account_of_what_was_balanced_tells_it(make_rig: MakeRig) -> None:
    rig, _ = rig_and_left(make_rig, balance="biphasic")
    answer = rig.show(ttl_ms=200, account=True, **{**STRONG, "rate_hz": 50.0})
    assert answer.error is None
    rig.run_ms(400)
    account = rig.ask(AskAccount, lease=LEASE, seq=rig.last_seq).account
    assert account is not None
    assert [(it.electrode, it.reason) for it in account.not_fired] == [(3, "balanced")]


#: Of 27 uA at three others electrode 3 carries 19 back; an even part would be 1.8.
UNEVEN = [load(2_000.0 if electrode == 3 else 60_000.0) for electrode in range(N)]
THREE = {"current_ua": only(N, e5=1_800, e6=1_800, e7=1_800), "width_us": 100}


def test_a_return_that_conducts_best_is_the_one_that_the_frame_is_refused_for(
    make_rig: MakeRig,
) -> None:
    """The board's own leak takes half of each pulse, and counts as if it went through skin."""
    rig, left = rig_and_left(make_rig, UNEVEN)
    why = renewed(rig, 4.0, **THREE, rate_hz=50.0)
    assert why is not None
    assert why.startswith("electrode 3:")
    rig.run_ms(300)
    assert 0.4 * BOUND_UC < left.most_uc <= BOUND_UC
    assert renewed(rig, 1.0, **THREE, rate_hz=25.0, polarity="biphasic") is None


def test_what_that_return_can_stand_is_shown_for_ever(make_rig: MakeRig) -> None:
    rig, left = rig_and_left(make_rig, UNEVEN)
    (told,) = [
        it
        for it in rig.show(preview=True, **THREE, rate_hz=50.0).slowed
        if it.reason == "net_charge"
    ]
    assert told.electrode == 3
    assert renewed(rig, 4.0, **THREE, rate_hz=told.lasting_hz) is None
    assert 0.3 * BOUND_UC < left.most_uc <= BOUND_UC
    assert shortfalls(rig) == []


def polls(rig: EngineRig, **fields: object) -> int:
    """Of three seconds of a frame, when it has stood for one."""
    assert renewed(rig, 1.0, **fields) is None
    before = rig.engine.components.reporter.counters["contact_polls"]
    assert renewed(rig, 3.0, **fields) is None
    return rig.engine.components.reporter.counters["contact_polls"] - before


def test_silent_returns_are_polled_as_often_as_direct_current_comes_back_through_them(
    make_rig: MakeRig,
) -> None:
    """80 uA at ten: each of six silent ones may be near the ceiling after some 0.1 s, and is
    polled then, not twice a second.
    """
    rig, _ = rig_and_left(make_rig)
    ten = only(N, **{f"e{electrode}": 1_000 for electrode in range(10)})
    frame = {"current_ua": ten, "width_us": 100, "rate_hz": 80.0}
    assert 6 * 3 / 0.2 < polls(rig, **frame) < 6 * 3 / 0.06
    assert polls(rig, **frame, polarity="biphasic") <= 6 * 3 / 0.5
