"""A record has every pulse that the wires have, and its replay fires the same ones again."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import msgspec
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from etd.files.calibration import load_calibration
from etd.files.configuration import fake_config
from etd.files.resources import find
from etd.protocol.pulse_row import PulseRow
from etd.record.lines import Asked, Carried, Halted, Lost, Pulses, Replied
from etd.record.reader import RecordReader
from etd.record.stimuli import stimuli_of
from etd.record.summary import summary_of
from etd.replay.compare import Comparison
from etd.replay.engine import ReplayEngine
from etd.replay.replay import caveats_of, replayed
from etd.replay.timeline import Timeline
from etd.stabilize.law_settings import ContactSettings, LinearLawSettings
from etd.stabilize.settings import NO_STABILIZERS, Settings
from etd_hal.compose import open_replay
from stepped_daemon import SteppedDaemon, SteppedDisplay
from trace_decoder import Phase

pytestmark = pytest.mark.slow

N = 8
_CHANGED = 3
CAP_UA, WIDTH_US = 3_000, 100
LAWS = Settings(
    order=("linear_law", "contact"),
    linear_law=LinearLawSettings(),
    contact=ContactSettings(),
    probe_first=True,
)


def armed(daemon: SteppedDaemon) -> SteppedDisplay:
    display = SteppedDisplay(daemon, CAP_UA, WIDTH_US)
    display.start_record("r")
    display.arm()
    return display


def recorded(display: SteppedDisplay, folder: Path) -> Path:
    display.stop_record()
    return display.fetch_record("r", folder / "r.jsonl")


def rows_of(path: Path) -> list[PulseRow]:
    """Those that were fired."""
    rows = [row for line in RecordReader(path) if isinstance(line, Pulses) for row in line.rows]
    return [row for row in rows if row.current_ua]


def flowed(daemon: SteppedDaemon) -> list[Phase]:
    return [phase for phase in daemon.followed.phases() if phase.electrode is not None]


def check_against_wires(rows: list[PulseRow], phases: list[Phase]) -> None:
    assert len(rows) == len(phases)
    for row, phase in zip(rows, phases, strict=True):
        assert row.electrode == phase.electrode
        assert abs(row.current_ua - phase.current_ua) <= 1
        assert abs(row.width_us - phase.width_us) < 1.5
        # A message begins some microseconds before its pulse.
        assert 0 <= phase.from_ns - row.t_ns < 100_000
        if row.purpose == "stimulus":
            assert row.seq == phase.seq


def replay(daemon: SteppedDaemon, path: Path) -> Comparison:
    stage = open_replay(daemon.loaded.board, electrodes=daemon.loaded.array.outputs())
    found = replayed(path, daemon.loaded, stage)
    stage.backend.close()
    return found


trials = st.lists(
    st.tuples(
        st.lists(st.sampled_from([0, 0, 400, 1_000, 2_400]), min_size=N, max_size=N),
        st.sampled_from([0.05, 0.3]),
        st.sampled_from([20.0, 60.0]),
        st.sampled_from([0.0, 0.02, 1.7]),
        st.sampled_from(["anodic", "cathodic", "biphasic"]),
    ),
    min_size=1,
    max_size=4,
)


def play(daemon: SteppedDaemon, display: SteppedDisplay, script: list[tuple[object, ...]]) -> None:
    for current_ua, seconds, rate_hz, pause_s, polarity in script:
        display.present(current_ua, seconds, rate_hz, polarity=polarity)  # type: ignore[arg-type]
        daemon.sleep_until_ns(daemon.now_ns() + int(pause_s * 1e9))  # type: ignore[operator]
        if daemon.engine.supervisor.lease is None:
            display.arm()


#: A scan that begins with a check of the source, at the edge of a step of the soft start.
LAST_ONLY: list[tuple[object, ...]] = [([0] * 7 + [400], 0.05, 20.0, 0.0, "anodic")] * 2


@settings(deadline=None, max_examples=6, suppress_health_check=[HealthCheck.too_slow])
@example(script=LAST_ONLY, laws=NO_STABILIZERS)
@given(script=trials, laws=st.sampled_from([NO_STABILIZERS, LAWS]))
def test_a_record_has_the_pulses_of_the_wires_and_its_replay_the_same(
    tmp_path_factory: pytest.TempPathFactory, script: list[tuple[object, ...]], laws: Settings
) -> None:
    with SteppedDaemon("pad-8", stabilize=laws, is_traced=True) as daemon:
        display = armed(daemon)
        play(daemon, display, script)
        path = recorded(display, tmp_path_factory.mktemp("record"))
        rows = rows_of(path)
        if not any(row.polarity == "biphasic" for row in rows):
            check_against_wires(rows, flowed(daemon))
        found = replay(daemon, path)
        assert found.is_same, (found.differences, found.refused)
        assert found.same >= len([row for row in rows if row.purpose != "poll"])
        assert found.latest_us < 2_000


def test_a_record_that_was_changed_is_not_the_same(tmp_path: Path) -> None:
    """An electrode that measured another resistance, which a law of the probe goes by: so it is the
    record's measurements that are replayed.
    """
    with SteppedDaemon("pad-8", stabilize=LAWS) as daemon:
        display = armed(daemon)
        for _ in range(3):
            display.present([1_500] * N, 0.4, 60.0)
        path = recorded(display, tmp_path)
        assert replay(daemon, path).is_same
        changed = tmp_path / "changed.jsonl"
        with changed.open("wb") as file:
            for data in path.read_bytes().splitlines(keepends=True):
                line = msgspec.json.decode(data)
                if line["kind"] == "pulses":
                    for row in line["rows"]:
                        if row[2] == _CHANGED:
                            row[-1][:] = [0.4 * volts for volts in row[-1]]
                file.write(msgspec.json.encode(line) + b"\n")
        # Another resistance is another share of the returns: pulses may be missing, or it halts.
        assert not replay(daemon, changed).is_same


def begun(path: Path) -> Carried:
    (carried,) = (line for line in RecordReader(path) if isinstance(line, Carried))
    return carried


def used(daemon: SteppedDaemon, display: SteppedDisplay) -> None:
    """The board was armed long ago, and its soft start has risen."""
    display.arm()
    display.present([1_000] * N, 0.5, 60.0)
    daemon.sleep_until_ns(daemon.now_ns() + 5_000_000_000)


def test_a_second_record_of_a_session_begins_with_the_ceiling_that_stands(tmp_path: Path) -> None:
    calibration = load_calibration(find("calibrations", "fake-fingertip-pad-8"))
    with SteppedDaemon("pad-8") as daemon:
        SteppedDisplay(daemon, CAP_UA, WIDTH_US).set_calibration("p01", calibration)
        display = SteppedDisplay(daemon, calibration="p01")
        used(daemon, display)
        assert daemon.engine.supervisor.lease is None
        display.start_record("r")
        display.arm()
        display.present([900] * N, 0.3, 60.0)
        path = recorded(display, tmp_path)
        first, *_ = (row for row in rows_of(path) if row.purpose == "stimulus")
        assert first.current_ua > 800
        assert begun(path).carried.soft_start.array.fired_ua > 800
        found = replay(daemon, path)
        assert found.is_same, (found.differences, found.refused)
        (why,) = caveats_of(path)
        assert "in use before" in why


def test_a_record_begun_while_armed_is_replayed_from_there(tmp_path: Path) -> None:
    with SteppedDaemon("pad-8") as daemon:
        display = SteppedDisplay(daemon, CAP_UA, WIDTH_US)
        used(daemon, display)
        display.arm()
        display.start_record("r")
        display.present([900] * N, 0.3, 60.0)
        path = recorded(display, tmp_path)
        timeline = Timeline(RecordReader(path))
        carried = begun(path).carried
        assert carried.state == "ARMED"
        assert timeline.told[0].t_ns >= carried.t_ns - 3_000_000_000
        assert [told.act for told in timeline.told[:3]] == ["open", "arm", "resume"]
        assert any("while the board was armed" in why for why in caveats_of(path))
        found = replay(daemon, path)
        assert found.is_same, (found.differences, found.refused)
        assert found.same > N


def test_a_frame_that_is_shown_when_a_record_begins_is_replayed_from_its_next_scan(
    tmp_path: Path,
) -> None:
    with SteppedDaemon("pad-8") as daemon:
        display = SteppedDisplay(daemon, CAP_UA, WIDTH_US)
        display.arm()
        display.present([900] * N, 0.4, 60.0)
        display.show_current([900] * N, rate_hz=60.0, ttl_ms=900)
        daemon.sleep_until_ns(daemon.now_ns() + 200_000_000)
        display.start_record("r")
        daemon.sleep_until_ns(daemon.now_ns() + 300_000_000)
        path = recorded(display, tmp_path)
        assert any("was shown" in why for why in caveats_of(path))
        found = replay(daemon, path)
        # What the ramp rose to in the scan under way is not known.
        assert (found.missing, found.more) == (0, 0)
        assert found.same + found.other > 10 * N


def test_what_a_record_lacks_or_a_replay_refuses_is_not_the_same() -> None:
    assert not Comparison(lost=1).is_same
    assert not Comparison(refused=("it halted",)).is_same
    assert Comparison(polls_alone=3).is_same


def test_a_record_is_replayed_on_no_real_board() -> None:
    loaded = fake_config(array="pad-8")
    stage = open_replay(loaded.board, electrodes=loaded.array.outputs())
    backend = dataclasses.replace(stage.backend, name="linux", host_clock=stage.backend.clock)
    with pytest.raises(ValueError, match="fake board only"):
        ReplayEngine(loaded, dataclasses.replace(stage, backend=backend))
    stage.backend.close()


def test_a_record_has_requests_replies_and_a_halt_with_who_and_why(tmp_path: Path) -> None:
    with SteppedDaemon("pad-8") as daemon:
        display = armed(daemon)
        display.present([1_000] + [0] * 7, 0.2, 60.0)
        display.mark(5)
        display.note("the\u00e9 hand moved")
        display.stop()
        path = recorded(display, tmp_path)
        lines = list(RecordReader(path))
    asked = [line for line in lines if isinstance(line, Asked)]
    ops = [line.request["op"] for line in asked]
    assert ops[:2] == ["open", "arm"]
    assert "mark" in ops
    assert ops[-1] == "stop"
    answered = {line.number for line in lines if isinstance(line, Replied)}
    assert {line.number for line in asked} == answered
    assert {line.client for line in asked if line.request["op"] != "arm"} == {"test"}
    (halt,) = (line.report for line in lines if isinstance(line, Halted))
    assert (halt.cause, halt.source) == ("stop", f"'test' (user {os.geteuid()})")
    assert b'"lease":"' not in path.read_bytes()


def test_a_stimulus_is_its_frames_together_and_its_sums_are_those_of_the_wires(
    tmp_path: Path,
) -> None:
    with SteppedDaemon("pad-8", is_traced=True) as daemon:
        display = armed(daemon)
        for _ in range(2):
            presented = display.present([1_200, 0, 900, *[0] * 5], 1.5, 50.0, tag=3)
        path = recorded(display, tmp_path)
        wires = [phase for phase in flowed(daemon) if phase.seq in presented.seqs]
    stimuli = list(stimuli_of(RecordReader(path)))
    assert len(stimuli) == 2
    last = stimuli[-1]
    assert last.tag == 3
    assert (last.first_ns, last.last_ns) == (presented.first_ns, presented.last_ns)
    for electrode in (0, 2):
        dose = last.by_electrode[electrode]
        at = [phase for phase in wires if phase.electrode == electrode]
        assert dose.pulses == presented.pulses[electrode] == len(at)
        assert dose.most_ua == presented.most_ua[electrode]
        assert dose.charge_nc * 1_000 == pytest.approx(
            sum(phase.charge_pc for phase in at), rel=0.02
        )
    summary = summary_of(RecordReader(path))
    assert summary.stimuli == 2
    assert summary.ended == "stopped"
    assert {dose.electrode for dose in summary.dose} == {0, 2}


def test_nothing_is_lost_when_a_record_is_stopped_in_the_middle_of_a_stimulus(
    tmp_path: Path,
) -> None:
    with SteppedDaemon("pad-8", is_traced=True) as daemon:
        display = armed(daemon)
        display.show_current([800] * N, rate_hz=60.0, ttl_ms=900)
        daemon.sleep_until_ns(daemon.now_ns() + 300_000_000)
        until_ns = daemon.now_ns()
        path = recorded(display, tmp_path)
        rows = rows_of(path)
        before = [phase for phase in flowed(daemon) if phase.from_ns < until_ns]
    assert len(rows) >= len(before)
    check_against_wires(rows[: len(before)], before)
    assert not any(isinstance(line, Lost) for line in RecordReader(path))
