"""The account of a frame, held against the wires; and a preview, which shows nothing."""

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
    fully_open,
    only,
    open_calibrated,
    opened_to,
    phases,
    scans,
)
from etd.engine.accounts import OpenAccount
from etd.protocol.frame import Frame
from etd.protocol.link import (
    MOST_ACCOUNTS,
    Answer,
    ArmBoard,
    AskAccount,
    CloseLease,
    KeepLease,
    NewFrame,
    StopNow,
)
from etd.protocol.outcome import Account
from trace_decoder import Phase

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16


def account_of(rig: EngineRig, seq: int) -> Account:
    answer = rig.ask(AskAccount, lease=LEASE, seq=seq)
    assert answer.account is not None, answer.reason
    return answer.account


def check_against_wires(account: Account, fired: list[Phase]) -> None:
    """`fired`: what flowed while the frame was shown; looks are at electrodes it leaves silent."""
    mine = [phase for phase in fired if account.wanted_ua[phase.electrode or 0]]
    times_ns = [phase.from_ns for phase in mine]
    for told_ns, flowed_ns in (
        (account.first_ns, min(times_ns, default=None)),
        (account.last_ns, max(times_ns, default=None)),
    ):
        # A pulse is timed from the message, a phase from the DAC's word in it.
        assert (told_ns is None) == (flowed_ns is None)
        assert told_ns is None or flowed_ns is None or abs(flowed_ns - told_ns) < 100_000
    for electrode in range(N):
        flowed_ua = [phase.current_ua for phase in mine if phase.electrode == electrode]
        assert account.pulses[electrode] == len(flowed_ua)
        assert account.least_ua[electrode] == pytest.approx(min(flowed_ua, default=0), abs=1)
        assert account.most_ua[electrode] == pytest.approx(max(flowed_ua, default=0), abs=1)


# --- what it says ---------------------------------------------------------------------------------

frames = st.tuples(
    st.sampled_from([0.0, 0.3, 20.0]),
    st.lists(st.sampled_from([0, 0, 300, 1_000, 2_400]), min_size=N, max_size=N),
    st.sampled_from([20, 120, 400]),
    st.sampled_from([20.0, 60.0]),
)


@settings(deadline=None, max_examples=12, suppress_health_check=[HealthCheck.too_slow])
@given(script=st.lists(frames, min_size=1, max_size=4))
def test_the_account_of_any_frame_is_what_flowed(
    script: list[tuple[float, list[int], int, float]],
) -> None:
    rig = engine_rig.make(electrodes=N)
    made = calibration(rig, [3_000] * N)
    for pause_s, current_ua, ttl_ms, rate_hz in script:
        rig.run_ms(1_000 * pause_s)
        if rig.engine.supervisor.lease is None:
            assert open_calibrated(rig, made).error is None
            assert rig.ask(ArmBoard).error is None
        since_ns = rig.clock.now_ns()
        answer = rig.show(current_ua=current_ua, ttl_ms=ttl_ms, rate_hz=rate_hz, account=True)
        assert answer.error is None, answer.reason
        account = account_of(rig, rig.last_seq)
        check_against_wires(account, phases(rig, since_ns))
        assert account.wanted_ua == tuple(current_ua)
        assert account.ended == "expired"
        taken = {clamp.electrode for clamp in account.clamped}
        for electrode, wanted_ua in enumerate(current_ua):
            if account.pulses[electrode] and electrode not in taken:
                assert wanted_ua - 3 <= account.least_ua[electrode] <= wanted_ua
    assert rig.close() == ()


def test_the_account_of_a_frame_that_stands_comes_when_it_is_over(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N))
    begun_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e3=2_000), ttl_ms=300, rate_hz=50.0, account=True, tag=7)
    account = account_of(rig, rig.last_seq)
    assert rig.clock.now_ns() - begun_ns >= 300 * MS
    assert (account.ended, account.tag, account.rate_hz) == ("expired", 7, 50.0)
    assert account.pulses == only(N, e3=15)
    assert account.delivered_ua == pytest.approx(scans(rig)[-1].fired.delivered_ua, abs=1)
    assert account_of(rig, rig.last_seq) == account, "as often as it is asked for"


def test_the_account_of_a_frame_that_waits_for_the_scan_under_way_comes_too(
    make_rig: MakeRig,
) -> None:
    """A scan of relays is long: frames are planned meanwhile, and shown at its end."""
    rig = armed(make_rig(board="feetthrough-relay", electrodes=32))
    opened_to(rig, 500)
    rig.send(current_ua=(500,) * 32, rate_hz=2.0, ttl_ms=1_000)
    for _ in range(20):
        rig.engine.step()
    rig.send(current_ua=(500,) * 32, ttl_ms=900, rate_hz=2.0, account=True)
    active = rig.engine.components.active
    for _ in range(5):
        rig.engine.step()
        if active.stands(rig.last_seq):
            break
    assert active.stands(rig.last_seq)
    assert active.schedule is not None
    assert active.schedule.plan.frame.seq < rig.last_seq, "it waits"
    assert account_of(rig, rig.last_seq).pulses[3] > 0


@pytest.mark.parametrize(
    ("ending", "ended"),
    [
        (lambda rig: rig.run_ms(200), "expired"),
        (lambda rig: rig.show(current_ua=(0,) * N), "replaced"),
    ],
)
def test_it_says_how_the_frame_ended(
    make_rig: MakeRig, ending: Callable[[EngineRig], object], ended: str
) -> None:
    rig = fully_open(make_rig(electrodes=N))
    rig.show(current_ua=only(N, e3=1_000), ttl_ms=150, rate_hz=50.0, account=True)
    seq = rig.last_seq
    rig.run_ms(50)
    ending(rig)
    assert account_of(rig, seq).ended == ended


def test_a_frame_that_had_its_pulses_says_so(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N))
    rig.show(current_ua=only(N, e3=1_000), pulses=3, ttl_ms=500, rate_hz=50.0, account=True)
    account = account_of(rig, rig.last_seq)
    assert (account.ended, account.pulses[3]) == ("pulses", 3)


def test_what_a_limit_took_stands_in_it_with_the_least_that_it_left(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.show(current_ua=only(N, e3=2_000), ttl_ms=300, rate_hz=50.0, account=True)
    account = account_of(rig, rig.last_seq)
    (clamp,) = account.clamped
    assert (clamp.electrode, clamp.wanted_ua, clamp.reason) == (3, 2_000, "soft_start")
    assert clamp.allowed_ua == 0, "the first pulse of all"
    assert 0 < account.least_ua[3] < account.most_ua[3] < 2_000, "it rises"


def test_it_has_the_lowest_and_the_highest_of_an_electrodes_pulses(make_rig: MakeRig) -> None:
    """As a law may make them, or a return that loses its contact."""
    rig = fully_open(make_rig(electrodes=N))
    rig.show(current_ua=only(N, e3=1_000), rate_hz=50.0)
    rig.run_ms(30)
    schedule = rig.engine.components.active.schedule
    assert schedule is not None
    made = OpenAccount(schedule.plan, 0)
    for commanded_ua in (900, 700, 1_000, 800):
        made.fired(3, commanded_ua, commanded_ua, commanded_ua - 100)
    account = made.closed("expired", 4_000, N)
    assert (account.least_ua[3], account.most_ua[3], account.delivered_ua[3]) == (700, 1_000, 750)
    assert (account.first_ns, account.last_ns, account.ended_ns) == (900, 800, 4_000)


# --- there is none --------------------------------------------------------------------------------


def refused(rig: EngineRig, seq: int, lease: str = LEASE) -> Answer:
    return rig.ask(AskAccount, lease=lease, seq=seq)


def test_a_frame_that_was_sent_without_or_never_began_has_none(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N))
    rig.show(current_ua=only(N, e3=1_000), rate_hz=50.0)
    rig.run_ms(300)
    assert refused(rig, rig.last_seq).error == "not_found"
    rig.show(current_ua=(1_000,) * N, rate_hz=20.0)
    rig.run_ms(3)
    rig.send(current_ua=only(N, e3=1_000), rate_hz=50.0, account=True)
    replaced = rig.last_seq
    rig.show(current_ua=(0,) * N)
    rig.run_ms(300)
    answer = refused(rig, replaced)
    assert answer.error == "not_found"
    assert "never begun" in answer.reason


def test_accounts_outlast_their_lease_until_another_is_opened(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N))
    rig.show(current_ua=only(N, e3=1_000), rate_hz=50.0, account=True)
    seq = rig.last_seq
    assert refused(rig, seq, lease="another").error == "other_lease"
    account = account_of(rig, seq)
    assert account.pulses[3]
    rig.ask(CloseLease, lease=LEASE)
    assert account_of(rig, seq) == account
    assert refused(rig, seq, lease="another").error == "no_lease"
    never_sent = refused(rig, 77)
    assert never_sent.error == "no_lease"
    assert "nothing is known of frame 77" in never_sent.reason
    rig.open()
    assert refused(rig, seq).error == "not_found"


def test_a_halt_leaves_the_account_of_what_it_cut_short(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N))
    rig.run_ms(250)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e3=1_000), ttl_ms=1_000, rate_hz=50.0, account=True)
    rig.run_ms(100)
    rig.ask(StopNow, client="operator")
    account = account_of(rig, rig.last_seq)
    assert account.ended == "silenced"
    check_against_wires(account, phases(rig, since_ns))
    assert refused(rig, rig.last_seq, lease="another").error == "halted"
    assert refused(rig, rig.last_seq + 1).error == "halted"


def test_levels_below_the_rate_of_their_calibration_say_so(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    open_calibrated(rig, calibration(rig, (2_000,) * N))
    rig.arm()
    for rate_hz, calibrated_hz in ((60.0, None), (20.0, 60.0)):
        answer = rig.show(level=only(N, e3=1), rate_hz=rate_hz, pulses=1, ttl_ms=100, account=True)
        assert (answer.rate_hz, answer.calibrated_hz) == (rate_hz, calibrated_hz)
        account = account_of(rig, rig.last_seq)
        assert (account.rate_hz, account.calibrated_hz) == (rate_hz, calibrated_hz)


def test_who_awaits_an_account_gets_it_at_a_halt(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N))
    rig.show(current_ua=only(N, e3=1_000), ttl_ms=1_000, rate_hz=50.0, account=True)
    ref = rig.next_ref()
    rig.commands.send(AskAccount(ref=ref, lease=LEASE, seq=rig.last_seq))
    rig.run_ms(50)
    rig.ask(StopNow, client="operator")
    account = rig.wait_for(ref).account
    assert account is not None
    assert (account.ended, account.pulses[3] > 0) == ("silenced", True)


def test_no_more_are_awaited_than_a_gateway_has_requests(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N))
    rig.show(current_ua=only(N, e3=1_000), ttl_ms=1_000, rate_hz=50.0, account=True)
    for _ in range(MOST_ACCOUNTS):
        rig.commands.send(AskAccount(ref=rig.next_ref(), lease=LEASE, seq=rig.last_seq))
    told = rig.ask(AskAccount, lease=LEASE, seq=rig.last_seq)
    assert told.error == "busy"


# --- a preview ------------------------------------------------------------------------------------


def test_a_preview_says_what_would_be_clamped_and_fires_nothing(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    since_ns = rig.clock.now_ns()
    (clamp,) = rig.show(current_ua=only(N, e3=2_000), rate_hz=50.0, preview=True).clamped
    assert (clamp.electrode, clamp.reason) == (3, "soft_start")
    rig.run_ms(300)
    assert not phases(rig, since_ns)


def test_a_preview_leaves_the_frame_that_stands(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N))
    rig.show(current_ua=only(N, e3=1_000), ttl_ms=400, rate_hz=50.0)
    rig.show(current_ua=only(N, e5=1_000), rate_hz=50.0, preview=True)
    since_ns = rig.clock.now_ns()
    rig.run_ms(200)
    assert {phase.electrode for phase in phases(rig, since_ns)} == {3}


def test_a_streamed_preview_is_refused(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    frame = Frame(lease=LEASE, seq=1, current_ua=(0,) * N, preview=True)
    rig.frames.send(NewFrame(ref=0, frame=frame))
    rig.run_ms(20)
    refusals = [report.refused for report in rig.reports if report.refused is not None]
    assert [refusal.error for refusal in refusals] == ["bad_frame"]


def test_after_a_preview_silent_frames_tell_what_the_returns_carry(make_rig: MakeRig) -> None:
    """Caps that are unlike: a strict frame after a silence waits for nothing but looks."""
    rig = make_rig(electrodes=N)
    made = calibration(rig, [3_000] + [400] * (N - 1))
    assert open_calibrated(rig, made).error is None
    assert rig.ask(ArmBoard).error is None
    asked = {"current_ua": only(N, e0=1_500), "rate_hz": 50.0}
    opened_to(rig, 1_500)
    for _ in range(4):
        rig.run_ms(500)
        assert rig.ask(KeepLease, lease=LEASE).error is None
    (clamp,) = rig.show(**asked, preview=True).clamped
    assert clamp.reason == "return_cap"
    assert rig.show(**asked, strict=True).error == "over_limit"
    rig.show(current_ua=(0,) * N)
    rig.run_ms(50)
    assert rig.show(**asked, strict=True).error is None
