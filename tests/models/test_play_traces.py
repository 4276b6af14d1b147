"""`etd play` in real processes, read back from the wires: every frame as the file says."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from etd.files.array import load_array
from etd.files.pattern import Pattern, PatternFrame, load_pattern
from files_by_hand import pattern_to_json
from trace_agreement import WIDTH_TOLERANCE_US, check_body, check_what_passes, is_look, one_code_ua
from trace_decoder import Facts, Phase, Record, decode, read, visits
from trace_rules import violations

CLONE = Path(__file__).parents[2]
ETACTILEKIT = CLONE.parent / "shared" / "data" / "etactilekit"
ROOTS = os.pathsep.join([str(CLONE / "daemon"), str(CLONE / "hal")])
CURRENT_UA = 600
WIDTH_US = 100
REST_US = 200
ENDS_WITHIN_S = 600


def stripes(electrodes: int, frames: int, duration_ms: int) -> Pattern:
    """Stripes that walk, with a silent frame among them."""
    levels = [
        tuple(float((electrode + frame) % 4 == 0 and frame != 3) for electrode in range(electrodes))
        for frame in range(frames)
    ]
    return Pattern(
        electrodes=electrodes,
        frames=tuple(
            PatternFrame(
                duration_ms=duration_ms, off_ms=0, level=level, rate_hz=None, polarity=None
            )
            for level in levels
        ),
    )


def played(file: Path, folder: Path, *options: str) -> list[Record]:
    """The trace of `etd play FILE` on a fake of its own."""
    trace = folder / "trace.jsonl"
    done = subprocess.run(
        [
            *(sys.executable, "-m", "etd", "play", str(file), "--json"),
            *("--trace", str(trace), "--current-ua", str(CURRENT_UA), "--width-us", str(WIDTH_US)),
            *options,
        ],
        capture_output=True,
        timeout=ENDS_WITHIN_S,
        env=os.environ | {"PYTHONPATH": ROOTS},
        check=False,
    )
    assert done.returncode == 0, done.stderr.decode() + done.stdout.decode()
    answer = json.loads(done.stdout)
    assert answer["ok"]
    assert answer["clamped_frames"] == 0
    return read(trace)


def check_play(trace: list[Record], pattern: Pattern, phases: tuple[bool, ...] = (True,)) -> None:
    """Each frame of the file: just its electrodes, its current, width and phases; contact polls of
    silent electrodes left out.
    """
    assert violations(trace, REST_US) == []
    check_body(trace)
    check_what_passes(trace)
    tags = {entry["tag"] for entry in trace[1:] if entry.get("event") == "frame"}
    assert tags == set(range(len(pattern.frames)))
    by_tag = _by_tag(decode(trace))
    code_ua = one_code_ua(Facts.of(trace[0]))
    opened = next(index for index, frame in enumerate(pattern.frames) if frame.active)
    for index, frame in enumerate(pattern.frames):
        found = [phase for phase in by_tag.get(index, []) if not is_look(phase, frame.active)]
        assert {phase.electrode for phase in found} == set(frame.active), f"frame {index}"
        assert {tuple(phase.is_anodic for phase in pulse) for pulse in visits(found)} <= {phases}
        assert all(WIDTH_US - WIDTH_TOLERANCE_US < phase.width_us <= WIDTH_US for phase in found)
        assert all(phase.current_ua <= CURRENT_UA for phase in found)
        let_through = found[-len(frame.active) :] if index == opened else found
        assert all(phase.current_ua > CURRENT_UA - code_ua for phase in let_through), (
            f"frame {index}"
        )


def _by_tag(phases: list[Phase]) -> dict[int, list[Phase]]:
    found: dict[int, list[Phase]] = {}
    for phase in phases:
        if phase.tag is not None:
            found.setdefault(phase.tag, []).append(phase)
    return found


def test_all_76_frames_of_the_kits_sine_wave_come_out_as_the_file_says(tmp_path: Path) -> None:
    file = ETACTILEKIT / "pattern_sine_wave_64.json"
    if not file.exists():
        pytest.skip(f"the pattern files of eTactileKit are not at {ETACTILEKIT}")
    pattern, _ = load_pattern(file)
    assert len(pattern.frames) == 76
    check_play(played(file, tmp_path, "--board", "fake"), pattern)


@pytest.mark.parametrize(
    ("electrodes", "options", "phases"),
    [
        (8, (), (True,)),
        (16, (), (True,)),
        (64, ("--polarity", "cathodic"), (False,)),
        (64, ("--polarity", "biphasic"), (True, False)),
        (64, ("--polarity", "biphasic_cathodic_first"), (False, True)),
        (256, ("--allow-slower",), (True,)),
    ],
)
def test_our_pattern_comes_out_as_the_file_says(
    electrodes: int, options: tuple[str, ...], phases: tuple[bool, ...], tmp_path: Path
) -> None:
    pattern = stripes(electrodes, 8, 60)
    file = tmp_path / "stripes.json"
    file.write_text(pattern_to_json(pattern))
    check_play(played(file, tmp_path, "--board", "fake", *options), pattern, phases)


def test_a_ring_of_returns_comes_out_as_asked_for_on_the_relay_board(tmp_path: Path) -> None:
    array = load_array(CLONE / "config" / "arrays" / "grid-4x8.toml")
    ring_mm = 2 * array.pitch_mm()
    pattern = stripes(array.count, 6, 200)
    file = tmp_path / "stripes.json"
    file.write_text(pattern_to_json(pattern))
    options = ("--board", "fake:feetthrough-relay", "--array", array.name, "--allow-slower")
    trace = played(file, tmp_path, *options, "--returns", f"ring:{ring_mm}")
    check_play(trace, pattern)
    outputs = array.outputs()
    for phase in decode(trace):
        if phase.tag is not None and phase.electrode is not None:
            ring = array.ring(phase.electrode, ring_mm)
            assert phase.ground == {outputs[electrode] for electrode in ring}
