"""The lease and the gateway on the engine's clock: whoever is not there is silent."""

from __future__ import annotations

import socket
from collections.abc import Callable

import pytest

from engine_rig import LEASE, EngineRig, turn
from engine_scenes import (
    MS,
    armed,
    calibration,
    ended_leases,
    fully_open,
    only,
    open_calibrated,
    phases,
    states,
)
from etd.protocol.link import (
    Alive,
    Answer,
    ArmBoard,
    Channel,
    CloseLease,
    DisarmBoard,
    EngineHello,
    KeepLease,
    MeasureContact,
    NewFrame,
    OpenLease,
    SetMark,
    ToEngine,
    ToGateway,
)
from etd.protocol.messages import Limits

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
ALL = (1_000,) * N
LIMITS = Limits(max_current_ua=1_000, width_us=100)


def test_a_lease_lapses_after_one_second_and_the_board_is_safe(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.ask(KeepLease, lease=LEASE)
    kept_ns = rig.clock.now_ns()
    rig.run_ms(990)
    assert rig.state == "ARMED"
    rig.run_ms(15)
    assert rig.state == "SAFE"
    (ended,) = ended_leases(rig)
    assert (ended.lease, ended.reason) == (LEASE, "lapsed")
    assert rig.clock.now_ns() - kept_ns < 1_020 * MS
    assert states(rig)[-1].holder is None
    assert states(rig)[-1].last_disarm == "lapsed"


def test_keep_renews_the_lease(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    for _ in range(4):
        rig.run_ms(700)
        assert rig.ask(KeepLease, lease=LEASE).error is None
    assert rig.state == "ARMED"


def test_an_accepted_frame_renews_the_lease(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    for _ in range(4):
        rig.run_ms(700)
        assert rig.show(current_ua=ALL).error is None
    assert rig.state == "ARMED"


def test_a_frame_that_is_refused_for_what_it_asks_renews_it_too(make_rig: MakeRig) -> None:
    """Its client lives: what is refused now may be taken in a second, without a new lease."""
    rig = armed(make_rig(electrodes=N))
    for _ in range(4):
        rig.run_ms(700)
        assert rig.show(current_ua=(9_000,) * N).error == "over_maximum"
    assert rig.state == "ARMED"


@pytest.mark.parametrize(
    ("asked", "error"),
    [
        ({"sent_ns": 1}, "expired"),
        ({"lease": "foreign"}, "other_lease"),
        ({"seq": 9}, "old_seq"),
        ({"current_ua": (100,)}, "bad_frame"),
    ],
)
def test_a_frame_that_is_late_malformed_or_another_client_s_does_not(
    make_rig: MakeRig, asked: dict[str, object], error: str
) -> None:
    rig = armed(make_rig(electrodes=N))
    assert rig.show(seq=9, current_ua=ALL).error is None
    rig.run_ms(900)
    assert rig.show(**{"seq": 10, "current_ua": ALL, **asked}).error == error
    rig.run_ms(120)
    assert rig.state == "SAFE"


@pytest.mark.parametrize("command", [KeepLease, CloseLease, DisarmBoard, MeasureContact, SetMark])
@pytest.mark.parametrize(("lease", "error"), [("foreign", "other_lease"), (LEASE, None)])
def test_what_needs_the_lease_is_refused_to_all_others(
    make_rig: MakeRig, command: type[KeepLease], lease: str, error: str | None
) -> None:
    rig = make_rig(electrodes=N)
    rig.open()
    assert rig.ask(command, lease=lease).error == error


def test_a_frame_with_a_foreign_lease_is_refused_and_changes_nothing(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.show(current_ua=only(N, e3=900), ttl_ms=500)
    since_ns = rig.clock.now_ns()
    assert rig.show(lease="foreign", seq=999, current_ua=ALL).error == "other_lease"
    rig.run_ms(100)
    assert {phase.electrode for phase in phases(rig, since_ns)} == {3}


def test_a_second_lease_is_refused_and_told_who_holds_it(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    rig.open()
    answer = rig.ask(OpenLease, lease="b", client="second", limits=LIMITS)
    assert answer.error == "other_lease"
    assert "'test'" in answer.reason


def test_a_lease_without_limits_is_refused(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    answer = rig.ask(OpenLease, lease="b", client="second")
    assert answer.error == "limits_missing"
    assert rig.engine.supervisor.lease is None


def test_limits_above_the_uncalibrated_bound_are_refused_at_open(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    limits = Limits(max_current_ua=3_001, width_us=100)
    answer = rig.ask(OpenLease, lease="b", client="second", limits=limits)
    assert answer.error == "over_maximum"
    assert "3000 uA" in answer.reason
    assert rig.engine.supervisor.lease is None


def test_a_calibration_for_another_array_is_refused_at_open(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    answer = open_calibrated(rig, calibration(rig, [2_000] * N, array="grid-8x8"))
    assert answer.error == "bad_calibration"
    assert rig.engine.supervisor.lease is None


def test_closing_a_lease_makes_safe_and_lets_the_next_one_in(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.show(current_ua=ALL, ttl_ms=1_000)
    rig.run_ms(20)
    assert rig.ask(CloseLease, lease=LEASE).error is None
    since_ns = rig.clock.now_ns()
    rig.run_ms(50)
    assert phases(rig, since_ns) == []
    assert (rig.state, rig.fake.dac_code) == ("SAFE", 0)
    assert ended_leases(rig)[-1].reason == "closed"
    rig.open()


def test_disarming_keeps_the_lease(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    assert rig.ask(DisarmBoard, lease=LEASE).error is None
    assert rig.state == "SAFE"
    assert rig.engine.supervisor.lease is not None
    assert rig.ask(ArmBoard).error is None
    assert rig.state == "ARMED"


# --- the gateway ----------------------------------------------------------------------------------


def test_a_gateway_silent_for_a_quarter_second_ends_the_lease(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.show(current_ua=ALL, ttl_ms=1_000)
    silent_from_ns = rig.clock.now_ns()
    rig.commands.send(Alive())
    rig.is_gateway_alive = False
    rig.run_ms(230)
    assert rig.state == "ARMED"
    rig.run_ms(30)
    assert rig.state == "SAFE"
    assert ended_leases(rig)[-1].reason == "the gateway is silent"
    rig.run_ms(300)
    assert silent_from_ns + 230 * MS < phases(rig)[-1].to_ns < silent_from_ns + 252 * MS


def test_anything_the_gateway_says_counts_as_life(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.is_gateway_alive = False
    for _ in range(4):
        rig.run_ms(200)
        rig.commands.send(KeepLease(ref=0, lease=LEASE))
    assert rig.state == "ARMED"


def test_frames_alone_do_not_count_as_life(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.is_gateway_alive = False
    for _ in range(8):
        rig.send(current_ua=ALL)
        rig.run_ms(50)
    assert rig.state == "SAFE"


def test_a_gateway_that_is_gone_ends_the_lease_at_once(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.show(current_ua=ALL, ttl_ms=1_000)
    rig.run_ms(20)
    rig.commands.close()
    rig.is_gateway_alive = False
    since_ns = rig.clock.now_ns()
    for _ in range(20):
        turn(rig.engine)
    assert rig.state == "SAFE"
    assert rig.engine.supervisor.lease is None
    assert not rig.engine.has_gateway
    assert [phase for phase in phases(rig, since_ns) if phase.from_ns > since_ns + MS] == []
    assert rig.fake.dac_code == 0


def test_nonsense_on_the_link_is_a_gateway_that_is_gone(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.commands.send({"type": "Fire", "current_ua": 10_000})
    rig.run_ms(5)
    assert rig.state == "SAFE"
    assert not rig.engine.has_gateway
    assert rig.engine.supervisor.lease is None


def test_nonsense_among_the_frames_is_a_gateway_that_is_gone(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.frames.send(Alive())
    rig.run_ms(5)
    assert rig.state == "SAFE"
    assert not rig.engine.has_gateway


def test_the_next_gateway_is_greeted_and_starts_in_safe(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.commands.close()
    rig.frames.close()
    for _ in range(3):
        turn(rig.engine)
    pairs = [socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET) for _ in range(2)]
    rig.engine.attach(Channel(pairs[0][0], ToEngine), Channel(pairs[1][0], NewFrame))
    rig.commands, rig.frames = Channel(pairs[0][1], ToGateway), Channel(pairs[1][1], ToGateway)
    rig.others.clear()
    rig.reports.clear()
    rig.run_ms(5)
    (engine_hello,) = rig.others
    assert isinstance(engine_hello, EngineHello)
    assert engine_hello.array.electrodes == N
    assert states(rig)[0].state == "SAFE"
    rig.open()
    rig.commands.close()
    for _ in range(3):
        turn(rig.engine)
    assert not rig.engine.has_gateway


def test_without_a_gateway_nothing_is_armed(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    assert rig.ask(ArmBoard).error == "no_lease"
    assert rig.state == "SAFE"


def test_the_greeting_says_what_there_is_to_drive(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    rig.run_ms(2)
    (engine_hello,) = rig.others
    assert isinstance(engine_hello, EngineHello)
    assert engine_hello.board.name == "kajimoto-hv507"
    assert engine_hello.board.absent_guards == rig.engine.components.loaded.board.absent_guards
    assert (engine_hello.body_site, engine_hello.default_width_us) == ("fingertip", 100)
    assert engine_hello.maxima.current_ua == 8_000


def test_the_state_is_told_every_second(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    rig.run_ms(3_050)
    assert 3 <= len(states(rig)) <= 5


def test_an_answer_that_nobody_takes_is_counted(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    for _ in range(3_000):
        rig.commands.send(KeepLease(ref=7, lease=LEASE))
        turn(rig.engine)
    assert rig.engine.components.reporter.counters["answers_dropped"] > 0
    rig.listen()
    assert isinstance(rig.answers[7], Answer)
