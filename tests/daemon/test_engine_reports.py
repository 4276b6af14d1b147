"""What the engine tells over its link, under a rate cap, with drops, and in a flood."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable

import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import MS, armed, config, fully_open, only, phases, scans, shown
from etd.protocol.frame import Frame
from etd.protocol.link import NewFrame, SetMark

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16


def marks(rig: EngineRig) -> list[tuple[int, int | None]]:
    """(seq, tag) of each frame remark in the trace, repeats left out."""
    found: list[tuple[int, int | None]] = []
    for entry in rig.records:
        if entry["bus"] == "engine" and entry["event"] == "frame":
            remark = (entry["seq"], entry["tag"])
            if not found or found[-1] != remark:
                found.append(remark)
    return found


def ended(rig: EngineRig) -> Counter[int]:
    return Counter(frame.seq for frame in shown(rig) if frame.ended)


def test_every_frame_begun_is_told_once_as_ended_although_reports_are_capped(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    for tag in range(60):
        rig.send(current_ua=only(N, e3=400), rate_hz=100.0, tag=tag)
        rig.run_ms(11)
    rig.run_ms(300)
    begun = marks(rig)
    assert len(begun) > 55
    assert ended(rig) == Counter(seq for seq, _ in begun)
    told = {frame.seq: frame.tag for frame in shown(rig)}
    assert all(told[seq] == tag for seq, tag in begun)


def test_reports_of_scans_come_at_most_thirty_times_a_second(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    rig.reports.clear()
    since_ns = rig.clock.now_ns()
    rig.hold(1_000, current_ua=only(N, e3=400), rate_hz=100.0)
    seconds = (rig.clock.now_ns() - since_ns) / 1e9
    assert 20 < len(scans(rig)) <= 30 * seconds + 1
    assert sum(scan.scans for scan in scans(rig)) > 90


def test_the_times_told_are_those_of_the_first_and_last_pulse_on_the_wire(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    rig.run_ms(250)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e3=400, e7=400), pulses=3, tag=9)
    rig.run_ms(200)
    fired = phases(rig, since_ns)
    mine = next(frame for frame in shown(rig) if frame.tag == 9 and frame.ended)
    assert mine.first_ns is not None
    assert mine.last_ns is not None
    assert 0 <= fired[0].from_ns - mine.first_ns < 100_000
    assert 0 <= fired[-1].from_ns - mine.last_ns < 100_000


def test_what_was_fired_is_what_went_over_the_wire(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.run_ms(250)
    since_ns = rig.clock.now_ns()
    rig.show(current_ua=only(N, e3=777, e7=444), width_us=90, pulses=1, tag=9)
    rig.run_ms(200)
    fired = [scan for scan in scans(rig) if scan.tag == 9][-1].fired
    for phase in phases(rig, since_ns):
        assert phase.electrode is not None
        assert abs(fired.current_ua[phase.electrode] - phase.current_ua) <= 1
        assert abs(fired.width_us[phase.electrode] - phase.width_us) < 0.5
    assert sum(1 for electrode in fired.current_ua if electrode) == 2
    assert fired.resistance_ohm[3] is not None
    assert 20_000 < fired.resistance_ohm[3] < 100_000


def test_a_full_report_queue_drops_counts_and_loses_no_frame(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    rig.is_listening = False
    for tag in range(2_000):
        if rig.engine.components.reporter.counters["reports_dropped"] > 5:
            break
        rig.send(current_ua=only(N, e3=400), rate_hz=100.0, tag=tag)
        rig.run_ms(35)
    assert rig.engine.components.reporter.counters["reports_dropped"] > 5
    assert rig.state == "ARMED"
    rig.is_listening = True
    rig.run_ms(400)
    assert ended(rig) == Counter(seq for seq, _ in marks(rig))
    assert scans(rig)[-1].dropped_reports > 5


def test_without_a_gateway_no_report_is_lost(make_rig: MakeRig) -> None:
    rig = make_rig("kajimoto-hv507")
    rig.commands.close()
    rig.frames.close()
    rig.run_ms(3_000)
    assert not rig.engine.has_gateway
    assert rig.engine.components.reporter.counters["reports_dropped"] == 0


def test_a_streamed_frame_that_is_refused_is_reported_at_once(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.frames.send(NewFrame(ref=0, frame=Frame(lease=LEASE, seq=5, current_ua=only(N, e3=9_000))))
    rig.run_ms(3)
    (refused,) = [report.refused for report in rig.reports if report.refused is not None]
    assert (refused.error, refused.seq, refused.electrode) == ("over_maximum", 5, 3)
    assert refused.count == 1
    assert rig.engine.components.reporter.counters["frames_refused"] == 1


def test_an_accepted_streamed_frame_is_answered_by_nothing(make_rig: MakeRig) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.frames.send(NewFrame(ref=0, frame=Frame(lease=LEASE, seq=5, current_ua=(400,) * N)))
    rig.run_ms(30)
    assert rig.answers == {}
    assert shown(rig)[-1].seq == 5


def test_of_streamed_frames_that_lie_there_together_the_newest_is_shown_and_the_rest_counted(
    make_rig: MakeRig,
) -> None:
    rig = fully_open(make_rig(electrodes=N), 500)
    rig.run_ms(30)
    for seq in range(1_000, 1_040):
        rig.frames.send(
            NewFrame(ref=0, frame=Frame(lease=LEASE, seq=seq, current_ua=only(N, e3=400)))
        )
    rig.run_ms(40)
    assert [seq for seq, _ in marks(rig) if seq >= 1_000] == [1_039]
    assert rig.engine.components.reporter.counters["frames_superseded"] == 39


def test_which_frame_was_shown_until_a_frame_began_is_told(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.run_ms(300)

    def begun(**fields: object) -> int | None:
        wanted = {"current_ua": only(N, e3=500), "rate_hz": 50.0, "ttl_ms": 150, **fields}
        assert rig.show(**wanted).error is None
        rig.run_ms(40)
        return shown(rig)[-1].replaces

    assert begun() is None
    first = rig.last_seq
    assert begun() == first
    rig.run_ms(300)
    assert begun() is None, "the one before had expired"
    begun(on_trigger=True)
    rig.fake.world.trigger()
    rig.run_ms(40)
    assert shown(rig)[-1].seq == rig.last_seq
    assert shown(rig)[-1].replaces is None, "it was silent while it waited"


@pytest.mark.parametrize("board", ["reference-hv507", "kajimoto-hv507", "feetthrough-relay"])
@pytest.mark.parametrize("tag", [None, 42, -(2**63), 'begin block "2": 30 %d µA'])
def test_a_mark_is_in_telemetry_and_trace_and_on_the_sync_line(
    make_rig: MakeRig, tag: int | str | None, board: str
) -> None:
    rig = make_rig(board)
    rig.open()
    answer = rig.ask(SetMark, lease=LEASE, tag=tag)
    assert (answer.error, answer.sync) == (None, True)
    assert answer.marked_ns is not None
    (mark,) = [entry for entry in rig.records if entry.get("event") == "mark"]
    assert mark["tag"] == tag
    (told,) = [report.mark for report in rig.reports if report.mark is not None]
    assert (told.marked_ns, told.tag, told.sync) == (answer.marked_ns, tag, True)
    assert 0 <= mark["t_ns"] - answer.marked_ns < MS
    sync = [
        entry["value"] for entry in rig.records if entry["bus"] == "gpio" and entry["line"] == 12
    ]
    assert sync == [0, 1, 0]


def test_a_board_without_a_sync_line_says_so(make_rig: MakeRig) -> None:
    rig = make_rig(loaded=config(sync_line="absent"))
    rig.open()
    assert rig.ask(SetMark, lease=LEASE).sync is False
