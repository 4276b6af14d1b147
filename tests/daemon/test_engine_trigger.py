"""A frame that waits for an edge of the trigger, held against the wires."""

from __future__ import annotations

from collections.abc import Callable

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import (
    MS,
    armed,
    calibration,
    config,
    fully_open,
    halts,
    moves,
    only,
    open_calibrated,
    opened_to,
    phases,
    shown,
)
from etd.protocol.frame import Frame
from etd.protocol.link import Answer, ArmBoard, AskAccount, KeepLease, NewFrame, StopNow
from etd.protocol.outcome import Account
from etd_hal.boardfile import EdgeInput
from etd_hal.fake.machines import PI4
from etd_hal.fake.processor import COMPILED_STAGES_NS, STAGES_NS, Stage, StagedTime
from trace_decoder import Phase

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
KIT = "kajimoto-hv507"
#: Computing takes no time here: what is left is the poll's period and the calls of a scan's begin.
MOST_NS = 1_000_000
PROBE_UA = 300


def strong(rig: EngineRig, since_ns: int = 0) -> list[Phase]:
    """What was fired of a frame: contact polls are no stronger than a probe."""
    return [phase for phase in phases(rig, since_ns) if phase.current_ua > PROBE_UA + 1]


def waiting(rig: EngineRig, **fields: object) -> Answer:
    wanted = {"current_ua": only(N, e3=1_000), "rate_hz": 50.0, "account": True, **fields}
    answer = rig.show(on_trigger=True, **wanted)
    assert answer.error is None, answer.reason
    return answer


def account_of(rig: EngineRig, seq: int | None = None) -> Account:
    answer = rig.ask(AskAccount, lease=LEASE, seq=rig.last_seq if seq is None else seq)
    assert answer.account is not None, answer.reason
    return answer.account


# --- the edge -------------------------------------------------------------------------------------


@settings(deadline=None, max_examples=25, suppress_health_check=[HealthCheck.too_slow])
@given(
    board=st.sampled_from([KIT, "reference-hv507"]),
    edges_us=st.lists(st.integers(-5_000, 120_000), max_size=4),
    ttl_ms=st.sampled_from([20, 60, 100]),
    wanted=st.lists(st.sampled_from([0, 0, 600, 1_000]), min_size=N, max_size=N),
)
def test_the_first_pulse_comes_after_an_edge_and_never_without_one(
    board: str, edges_us: list[int], ttl_ms: int, wanted: list[int]
) -> None:
    wanted[5] = 800
    rig = fully_open(engine_rig.make(loaded=config(board)), 1_000)
    rig.is_sensing = False
    rig.run_ms(6)
    told_ns = rig.clock.now_ns() + 5 * MS
    for edge_us in edges_us:
        rig.fake.world.trigger(told_ns + edge_us * 1_000, lasts_ns=100_000)
    rig.run_ms(5)
    sent_ns = rig.clock.now_ns()
    waiting(rig, current_ua=wanted, ttl_ms=ttl_ms)
    stood_ns = rig.clock.now_ns()
    rig.run_ms(140)
    fired = strong(rig, sent_ns)
    edges_ns = [t_ns for t_ns, level in moves(rig, "TRIGGER") if level == 1]
    # While the frame is planned, and in the poll in which it ends, an edge may count or not.
    sure = [t for t in edges_ns if stood_ns <= t < sent_ns + (ttl_ms - 2) * MS]
    perhaps = [t for t in edges_ns if sent_ns - MS <= t < sent_ns + (ttl_ms + 1) * MS]
    begun = [frame for frame in shown(rig) if frame.seq == rig.last_seq]
    if sure:
        assert fired
    if not fired:
        assert begun == []
        (refused,) = [report.refused for report in rig.reports if report.refused is not None]
        assert (refused.error, refused.seq) == ("expired", rig.last_seq)
        assert "before an edge of the trigger came" in refused.reason
    else:
        told_ns = begun[-1].trigger_ns or 0
        assert any(abs(told_ns - t) < 10_000 for t in perhaps), "by the edge's own time"
        assert told_ns >= sent_ns
        assert 0 < fired[0].from_ns - told_ns < MOST_NS
        assert begun[-1].first_ns == pytest.approx(fired[0].from_ns, abs=100_000)
        assert fired[-1].to_ns < sent_ns + (ttl_ms + 5) * MS
        assert account_of(rig).trigger_ns == told_ns
    assert rig.close() == ()


@pytest.mark.parametrize(("stages_ns", "most_us"), [(STAGES_NS, 450), (COMPILED_STAGES_NS, 380)])
def test_on_a_modelled_pi_4_it_follows_within_half_a_millisecond(
    make_rig: MakeRig, stages_ns: dict[Stage, int], most_us: int
) -> None:
    processor = StagedTime(PI4.slowness, stages_ns)
    rig = fully_open(make_rig(loaded=config(KIT, 64), processor=processor, machine=PI4), 1_000)
    latencies_ns = []
    for turn in range(12):
        rig.run_ms(60)
        waiting(rig, current_ua=only(64, e3=800), ttl_ms=100)
        at_ns = rig.clock.now_ns() + 5 * MS + turn * 777_000
        rig.fake.world.trigger(at_ns)
        account = account_of(rig)
        assert account.first_ns is not None
        assert account.trigger_ns == at_ns
        assert account.first_ns == pytest.approx(strong(rig, at_ns)[0].from_ns, abs=100_000)
        latencies_ns.append(account.first_ns - at_ns)
    assert min(latencies_ns) > 0
    assert max(latencies_ns) <= most_us * 1_000


def test_its_sync_and_its_mark_come_with_the_edge_and_not_before(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(loaded=config(KIT)), 1_000)
    waiting(rig, sync=True, ttl_ms=200)
    stood_ns = rig.clock.now_ns()
    rig.fake.world.trigger(stood_ns + 50 * MS)
    rig.run_ms(100)
    (up_ns, _), _ = moves(rig, "SYNC", stood_ns)
    marked_ns = [entry["t_ns"] for entry in rig.records if entry.get("seq") == rig.last_seq]
    for t_ns in (up_ns, marked_ns[0]):
        assert 50 * MS <= t_ns - stood_ns < 50 * MS + MOST_NS


def test_a_falling_edge_counts_where_the_board_file_says_so(make_rig: MakeRig) -> None:
    trigger = EdgeInput(line=6, edge="falling")
    rig = fully_open(make_rig(loaded=config(KIT, trigger=trigger)), 1_000)
    waiting(rig)
    at_ns = rig.clock.now_ns() + 20 * MS
    rig.fake.world.trigger(at_ns, lasts_ns=30 * MS)
    assert account_of(rig).trigger_ns == at_ns
    assert [level for _, level in moves(rig, "TRIGGER")] == [0, 1]


def test_a_board_without_a_trigger_refuses_with_a_sentence(make_rig: MakeRig) -> None:
    rig = armed(make_rig(loaded=config(KIT, trigger="absent")))
    for _ in range(3):
        answer = rig.show(current_ua=only(N, e3=500), on_trigger=True)
        # Nor does its client lose the lease by it.
        assert answer.error == "board_cannot"
        rig.run_ms(700)
    assert "kajimoto-hv507 names no trigger" in answer.reason


@pytest.mark.parametrize("key", ["renews", "lasts_ms"])
def test_what_belongs_to_waiting_is_refused_without_it(make_rig: MakeRig, key: str) -> None:
    rig = armed(make_rig(loaded=config(KIT)))
    answer = rig.show(current_ua=only(N, e3=500), **{key: 1})
    assert answer.error == "bad_frame"
    assert f"{key} is for frames that wait" in answer.reason


# --- how long -------------------------------------------------------------------------------------


def test_it_lasts_from_the_edge_on_and_never_beyond_its_ttl(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(loaded=config(KIT)), 1_000)
    for edge_ms, lasts_ms in ((100, 60), (160, 40)):
        waiting(rig, ttl_ms=200, lasts_ms=60)
        sent_ns = rig.clock.now_ns()
        rig.fake.world.trigger(sent_ns + edge_ms * MS)
        account = account_of(rig)
        assert account.ended == "expired"
        fired = strong(rig, sent_ns)
        ends_ns = sent_ns + (edge_ms + lasts_ms) * MS
        assert ends_ns - 22 * MS < fired[-1].from_ns < ends_ns + MS
        assert account.pulses[3] == len(fired)


def test_it_waits_as_long_as_it_is_renewed(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(loaded=config(KIT)), 1_000)
    begun_ns, seqs = rig.clock.now_ns(), []
    waiting(rig, pulses=3, ttl_ms=150)
    for _ in range(30):
        seqs.append(rig.last_seq)
        rig.run_ms(50)
        assert waiting(rig, pulses=3, ttl_ms=150, renews=rig.last_seq).trigger_ns is None
    assert strong(rig, begun_ns) == []
    waited = rig.last_seq
    at_ns = rig.clock.now_ns() + 10 * MS
    rig.fake.world.trigger(at_ns)
    rig.run_ms(12)
    assert waiting(rig, pulses=3, ttl_ms=150, renews=waited).trigger_ns == at_ns
    rig.run_ms(300)
    assert waiting(rig, pulses=3, ttl_ms=150, renews=waited).trigger_ns == at_ns, "once for all"
    rig.run_ms(300)
    assert len(strong(rig, begun_ns)) == 3, "it is not fired again"
    account = account_of(rig, waited)
    assert (account.ended, account.pulses[3], account.clamped) == ("pulses", 3, ())


@pytest.mark.parametrize("stages_ns", [None, STAGES_NS], ids=["at once", "interpreted"])
def test_no_edge_is_lost_while_it_is_renewed(
    make_rig: MakeRig, stages_ns: dict[Stage, int] | None
) -> None:
    """Before, while, and after the renewal is planned: once, and by the edge's own time."""
    processor = None if stages_ns is None else StagedTime(PI4.slowness, stages_ns)
    rig = fully_open(make_rig(loaded=config(KIT), processor=processor), 1_000)
    begun_by = set()
    for edge_us in range(0, 2_400, 80):
        rig.run_ms(30)
        waiting(rig, pulses=2, ttl_ms=400, rate_hz=100.0)
        first = rig.last_seq
        rig.run_ms(5)
        since_ns = rig.clock.now_ns()
        at_ns = since_ns + edge_us * 1_000
        rig.fake.world.trigger(at_ns, lasts_ns=20_000)
        rig.step()
        told_ns = waiting(rig, pulses=2, ttl_ms=400, rate_hz=100.0, renews=first).trigger_ns
        rig.run_ms(40)
        assert len(strong(rig, since_ns)) == 2
        begun = first if told_ns else rig.last_seq
        assert account_of(rig, begun).trigger_ns == at_ns
        assert told_ns in (None, at_ns)
        begun_by.add(begun == first)
    assert begun_by == {True, False}


def test_a_frame_that_renews_nothing_waits_for_an_edge_of_its_own(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(loaded=config(KIT)), 1_000)
    waiting(rig, ttl_ms=400)
    rig.fake.world.trigger()
    rig.run_ms(30)
    since_ns = rig.clock.now_ns()
    assert waiting(rig, ttl_ms=100).trigger_ns is None
    rig.run_ms(200)
    assert strong(rig, since_ns + 20 * MS) == [], "the frame before ended when it came"


# --- what is as with every frame ------------------------------------------------------------------


def test_the_frame_before_is_silent_at_once_and_one_after_begins_at_once(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(loaded=config(KIT)), 1_000)
    rig.show(current_ua=(900,) * N, ttl_ms=500, rate_hz=20.0)
    rig.run_ms(120)
    waiting(rig, ttl_ms=500)
    stood_ns = rig.clock.now_ns()
    rig.run_ms(100)
    assert strong(rig, stood_ns + MS) == []
    sent_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e7=900), ttl_ms=100)
    rig.run_ms(50)
    first = strong(rig, sent_ns)[0]
    assert (first.electrode, first.from_ns - sent_ns < 3 * MS) == (7, True)
    rig.fake.world.trigger()
    rig.run_ms(100)
    assert {phase.electrode for phase in strong(rig, sent_ns)} == {7}, "it waits no more"


def test_it_replaces_a_scan_of_relays_half_way(make_rig: MakeRig) -> None:
    """Such a scan is long, and another frame would wait for its end."""
    rig = armed(make_rig(loaded=config("feetthrough-relay", 32)))
    opened_to(rig, 900)
    rig.send(current_ua=(900,) * 32, rate_hz=2.0, ttl_ms=1_000)
    for _ in range(20):
        rig.engine.step()
    assert strong(rig)
    rig.send(current_ua=only(32, e3=900), rate_hz=20.0, ttl_ms=900, on_trigger=True)
    active = rig.engine.components.active
    for _ in range(20):
        rig.engine.step()
        if active.is_waiting:
            break
    assert active.is_waiting
    assert active.scanning is not None, "half-way"
    stood_ns = rig.clock.now_ns()
    rig.run_ms(100)
    assert strong(rig, stood_ns) == []
    rig.fake.world.trigger()
    rig.run_ms(10)
    assert [phase.electrode for phase in strong(rig, stood_ns)] == [3]


@pytest.mark.parametrize("ending", ["stop", "lease", "stop line"])
def test_what_silences_a_frame_silences_one_that_waits(make_rig: MakeRig, ending: str) -> None:
    rig = fully_open(make_rig(loaded=config("reference-hv507")), 1_000)
    waiting(rig, ttl_ms=1_000)
    since_ns = rig.clock.now_ns()
    if ending == "stop":
        rig.ask(StopNow, client="me")
    elif ending == "lease":
        rig.is_gateway_alive = False
        rig.run_ms(300)
    else:
        at_ns = rig.clock.now_ns() + 5 * MS
        rig.fake.world.press("wearer_stop", at_ns)
        rig.fake.world.trigger(at_ns)
    rig.run_ms(10)
    rig.fake.world.trigger()
    rig.run_ms(100)
    assert strong(rig, since_ns) == []
    assert rig.state == ("SAFE" if ending == "lease" else "HALTED")
    assert len(halts(rig)) == (ending != "lease")


def test_it_rises_through_what_is_fired_and_not_while_it_waits(make_rig: MakeRig) -> None:
    rig = armed(make_rig(loaded=config(KIT)))
    opened_to(rig, 400)
    waiting(rig, current_ua=only(N, e3=2_000), ttl_ms=600)
    rig.run_ms(500)
    rig.fake.world.trigger()
    account = account_of(rig)
    assert {clamp.reason for clamp in account.clamped} == {"soft_start"}
    assert account.clamped[0].allowed_ua == 900, "0.5 mA more, however long nothing is fired"


def test_what_its_returns_carry_stays_known_while_it_waits(make_rig: MakeRig) -> None:
    """Contacts are known for a second; polls keep them known, or the first pulses were weaker."""
    rig = make_rig(loaded=config(KIT))
    made = calibration(rig, [*[2_400] * (N - 1), 300])
    assert open_calibrated(rig, made).error is None
    assert rig.ask(ArmBoard).error is None
    opened_to(rig, 2_400)
    rig.hold(300, current_ua=only(N, e0=20), rate_hz=20.0)
    waiting(rig, current_ua=only(N, e3=1_200, e9=1_200), ttl_ms=400)
    since_ns = rig.clock.now_ns()
    for _ in range(12):
        rig.run_ms(250)
        waiting(rig, current_ua=only(N, e3=1_200, e9=1_200), ttl_ms=400, renews=rig.last_seq)
    polled = phases(rig, since_ns)
    assert {phase.electrode for phase in polled} == set(range(N)), "those to be stimulated, too"
    assert max(phase.current_ua for phase in polled) <= PROBE_UA
    rig.fake.world.trigger()
    account = account_of(rig)
    assert account.clamped == ()
    assert account.least_ua[3] == pytest.approx(1_200, abs=3)


def test_the_board_is_not_asked_for_edges_where_no_frame_waits(make_rig: MakeRig) -> None:
    """On a kit without stops: then nothing is read between two pulses."""
    rig = fully_open(make_rig(loaded=config(KIT)), 1_000)
    rig.fake.world.trigger()
    rig.hold(100, current_ua=only(N, e3=800))
    board = rig.engine.components.board
    assert board.stop_edges() == ()
    assert board.take_triggers() == []
    assert board.stop_edges(with_trigger=True) == ()
    assert len(board.take_triggers()) == 1, "it was left in the kernel's queue"


def test_a_streamed_frame_waits_too(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(loaded=config(KIT)), 1_000)
    frame = Frame(lease=LEASE, seq=9_000, current_ua=only(N, e3=900), on_trigger=True, ttl_ms=300)
    rig.frames.send(NewFrame(ref=0, frame=frame))
    rig.run_ms(20)
    rig.fake.world.trigger()
    rig.run_ms(20)
    rig.ask(KeepLease, lease=LEASE)
    assert shown(rig)[-1].trigger_ns is not None
