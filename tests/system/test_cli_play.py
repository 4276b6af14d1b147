"""`etd play` and `etd demo` on fakes of their own: real processes, real sockets."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest

from command_rig import CommandRig, command_rig, wait_for_end

pytestmark = pytest.mark.slow

SMALL = [
    {"duration_ms": 60, "active": [0, 1]},
    {"duration_ms": 40, "off_ms": 40, "active": [2]},
    {"duration_ms": 60, "active": []},
    {"duration_ms": 50, "level": [0, 0, 0, 0.5, 0, 0, 0, 1]},
]


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def pattern(rig: CommandRig, frames: list[dict[str, Any]], electrodes: int = 8) -> str:
    path = rig.folder / "pattern.json"
    content = {"etd_pattern": 1, "electrodes": electrodes, "frames": frames}
    path.write_text(json.dumps(content))
    return str(path)


def events(trace: Path) -> list[dict[str, Any]]:
    return [json.loads(line) for line in trace.read_text().splitlines()]


def electrodes_by_tag(trace: Path) -> dict[int, set[int]]:
    """What was felt in each frame of the file, by the bodies' own account."""
    found: dict[int, set[int]] = {}
    tag: int | None = None
    for event in events(trace):
        if event.get("event") == "frame":
            tag = event["tag"]
            if tag is not None:
                found.setdefault(tag, set())
        elif event.get("bus") == "body" and tag is not None:
            found[tag].add(event["electrode"])
    return found


def test_each_frame_is_felt_on_its_electrodes(rig: CommandRig) -> None:
    trace = rig.folder / "trace.jsonl"
    told = rig.run("play", pattern(rig, SMALL), "--board", "fake", "--trace", str(trace), "--json")
    assert told.status == 0, told.err
    assert told.answer["frames"] == 4
    assert told.answer["backend"] == "fake"
    assert told.answer["clamped"] == []
    assert electrodes_by_tag(trace) == {0: {0, 1}, 1: {2}, 2: set(), 3: {3, 7}}


def test_each_frame_is_up_for_its_time(rig: CommandRig) -> None:
    trace = rig.folder / "trace.jsonl"
    frames = [{"duration_ms": 300, "active": [electrode]} for electrode in range(3)]
    rig.run("play", pattern(rig, frames), "--board", "fake", "--trace", str(trace))
    begins: dict[int, int] = {}
    for event in events(trace):
        if event.get("event") == "frame" and event["tag"] is not None:
            begins.setdefault(event["tag"], event["t_ns"])
    # Longer only by what the player was held up.
    assert 300e6 <= begins[2] - begins[1] < 5_000e6


def test_a_long_frame_stands_without_a_gap(rig: CommandRig) -> None:
    trace = rig.folder / "trace.jsonl"
    # At 0.3, direct current lasts for ever: a single electrode at 1 has its net charge in a second.
    weak = [0.3 if electrode == 5 else 0 for electrode in range(8)]
    frames = [{"duration_ms": 1, "active": [0]}, {"duration_ms": 2500, "level": weak}]
    told = rig.run("play", pattern(rig, frames), "--board", "fake", "--trace", str(trace), "--json")
    assert told.status == 0, told.err
    felt = [entry["from_ns"] for entry in events(trace) if entry.get("electrode") == 5]
    felt = [at_ns for at_ns in felt if at_ns > felt[0] + 100e6]  # contact is measured before
    gaps = [after - before for before, after in pairwise(felt)]
    assert max(gaps) < 100e6
    assert felt[-1] - felt[0] > 2_000e6


def test_currents_are_those_asked_for_once_the_opening_is_there(rig: CommandRig) -> None:
    trace = rig.folder / "trace.jsonl"
    told = rig.run(
        *("play", pattern(rig, SMALL), "--board", "fake", "--trace", str(trace), "--json"),
        *("--current-ua", "1500", "--width-us", "100", "--polarity", "cathodic"),
    )
    assert told.status == 0, told.err
    last = [event for event in events(trace) if event.get("bus") == "body"][-2:]
    asked = {event["electrode"]: event["asked_ua"] for event in last}
    assert asked[7] == pytest.approx(-1500, abs=3)
    assert asked[3] == pytest.approx(-750, abs=3)


def test_a_frame_that_is_stronger_than_all_before_is_up_for_its_time_as_asked(
    rig: CommandRig,
) -> None:
    trace = rig.folder / "trace.jsonl"
    frames = [
        {"duration_ms": 200, "level": [0.2, 0, 0, 0, 0, 0, 0, 0]},
        {"duration_ms": 300, "level": [0, 1, 0, 0, 0, 0, 0, 0]},
    ]
    told = rig.run(
        *("play", pattern(rig, frames), "--board", "fake", "--trace", str(trace), "--json"),
        *("--current-ua", "2500", "--width-us", "60"),
    )
    assert told.status == 0, told.err
    assert told.answer["clamped"] == []
    assert told.answer["soft_start_s"] > 0.3
    found = [
        entry for entry in events(trace) if entry.get("bus") == "body" and entry["electrode"] == 1
    ]
    strong = [entry["from_ns"] for entry in found if entry["asked_ua"] >= 2_490]
    assert strong[-1] - strong[0] > 250e6


def test_a_frame_that_cannot_stand_for_its_time_is_refused_as_it_begins(rig: CommandRig) -> None:
    """Its direct current would last a second."""
    frames = [{"duration_ms": 1, "active": [0]}, {"duration_ms": 2500, "active": [5]}]
    told = rig.run("play", pattern(rig, frames), "--board", "fake", "--json")
    assert told.status == 1
    assert told.answer["error"] == "over_maximum"
    assert "frame 1: electrode 5: the frame is to stand for 2500 ms" in told.answer["reason"]
    assert "biphasic" in told.answer["reason"]


def test_a_pattern_is_repeated(rig: CommandRig) -> None:
    told = rig.run("play", pattern(rig, SMALL[:1]), "--board", "fake", "--repeat", "3", "--json")
    assert told.answer["frames"] == 3


def test_progress_is_plain_lines_without_a_terminal(rig: CommandRig) -> None:
    told = rig.run("play", pattern(rig, SMALL), "--board", "fake")
    assert told.out.splitlines()[:4] == [f"{count} of 4 frames" for count in range(1, 5)]
    assert "4 frames in" in told.out.splitlines()[-1]


def test_what_does_not_fit_is_refused_with_what_would_help(rig: CommandRig) -> None:
    frames = [{"duration_ms": 100, "rate_hz": 100, "active": list(range(64))}]
    path = pattern(rig, frames, electrodes=64)
    by_current = ("--current-ua", "1000", "--width-us", "100")
    refused = rig.run("play", path, "--board", "fake", *by_current)
    assert refused.status == 1
    assert "frame 0" in refused.err
    assert "--max-rate 4" in refused.err
    assert "--allow-slower" in refused.err
    lowered = rig.run("play", path, "--board", "fake", *by_current, "--max-rate", "40", "--json")
    assert lowered.status == 0
    assert "played at 40 Hz" in lowered.answer["told"][0]
    shortfalls = rig.run("play", path, "--board", "fake", *by_current, "--allow-slower", "--json")
    assert 30 < shortfalls.answer["slowed_to_hz"] < 60


def test_a_level_of_another_polarity_is_refused(rig: CommandRig) -> None:
    refused = rig.run("play", pattern(rig, SMALL), "--board", "fake", "--polarity", "cathodic")
    assert refused.status == 1
    assert "--current-ua" in refused.err


def test_a_file_with_frames_of_mixed_length_names_the_frame(rig: CommandRig) -> None:
    mixed = [*SMALL, {"duration_ms": 10, "level": [1, 0]}]
    refused = rig.run("play", pattern(rig, mixed), "--board", "fake", "--json")
    assert refused.status == 1
    assert refused.answer["error"] == "pattern_error"
    assert "frame 4" in refused.answer["reason"]


@pytest.mark.parametrize("ending", [signal.SIGINT, signal.SIGTERM])
def test_being_asked_to_end_leaves_no_process_and_no_folder(
    rig: CommandRig, ending: signal.Signals
) -> None:
    playing = rig.start("play", pattern(rig, SMALL), "--board", "fake", "--repeat", "1000000")
    playing.line()
    parts = list(playing.children().values())
    assert len(list(rig.folder.glob("etd-*"))) == 1
    playing.signal(ending)
    said = playing.ended()
    told = {signal.SIGINT: (130, ""), signal.SIGTERM: (143, "etd: ended by SIGTERM\n")}
    assert (said.status, said.err) == told[ending]
    wait_for_end(parts)
    assert list(rig.folder.glob("etd-*")) == []


def test_a_dead_engine_is_told_as_that(rig: CommandRig) -> None:
    playing = rig.start("play", pattern(rig, SMALL), "--board", "fake", "--repeat", "1000000")
    playing.line()
    os.kill(playing.children()["engine"], signal.SIGKILL)
    said = playing.ended()
    assert said.status == 1
    assert "the engine ended (killed by SIGKILL)" in said.err


def test_a_gateway_that_is_held_up_is_told_as_that_and_nobody_is_sent_to_another_daemon(
    rig: CommandRig,
) -> None:
    playing = rig.start("play", pattern(rig, SMALL), "--board", "fake", "--repeat", "1000000")
    playing.line()
    os.kill(playing.children()["gateway"], signal.SIGSTOP)
    said = playing.ended()
    assert said.status == 3
    assert "held up" in said.err
    assert "etd status" not in said.err


def test_the_private_daemon_ends_with_a_killed_player(rig: CommandRig) -> None:
    playing = rig.start("play", pattern(rig, SMALL), "--board", "fake", "--repeat", "1000000")
    playing.line()
    parts = list(playing.children().values())
    assert len(parts) == 2
    playing.signal(signal.SIGKILL)
    wait_for_end(parts)


def test_the_demo_shows_lines_and_ends_by_itself(rig: CommandRig) -> None:
    trace = rig.folder / "trace.jsonl"
    told = rig.run("demo", "--seconds", "1.2", "--trace", str(trace))
    assert told.status == 0, told.err
    # A line a second: a busy machine may be later than asked to end.
    first, second, *more, last = told.out.splitlines()
    assert "backend: fake" in first
    assert all(line.startswith("ARMED") for line in (second, *more))
    assert "64 touched, 0 open, 0 unknown" in second
    assert "pulses in" in last
    assert sum(event.get("bus") == "body" for event in events(trace)) > 200


def test_the_demo_takes_an_array_that_has_no_calibration(rig: CommandRig) -> None:
    told = rig.run("demo", "--seconds", "0.5", "--array", "band-4x8")
    assert told.status == 0, told.err


@pytest.mark.parametrize("ending", [signal.SIGTERM, signal.SIGHUP])
def test_another_signal_ends_the_demo_and_is_told(rig: CommandRig, ending: signal.Signals) -> None:
    showing = rig.start("demo")
    showing.line()
    showing.line()
    showing.signal(ending)
    said = showing.ended()
    assert (said.status, said.err) == (128 + ending, f"etd: ended by {ending.name}\n")
    assert list(rig.folder.glob("etd-*")) == []


def test_ctrl_c_ends_the_demo_with_its_summary(rig: CommandRig) -> None:
    showing = rig.start("demo")
    showing.line()
    showing.line()
    showing.signal(signal.SIGINT)
    said = showing.ended()
    assert said.status == 0
    assert "pulses in" in said.out
