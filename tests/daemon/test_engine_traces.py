"""Frames played by the engine, read back from the wires: just what was sent, on every board."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path

import pytest

import engine_rig
from engine_rig import EngineRig
from etd.files.pattern import Pattern, PatternFrame, load_pattern
from etd.protocol.frame import PHASES, Polarity, Ring
from trace_agreement import (
    Sent,
    check_body,
    check_frames,
    check_reports,
    check_returns,
    check_what_passes,
)
from trace_decoder import Facts, Record, decode
from trace_rules import violations

pytestmark = pytest.mark.slow

ETACTILEKIT = Path(__file__).parents[3] / "shared" / "data" / "etactilekit"
CURRENT_UA = 600
WIDTH_US = 100
LONGEST_MS = 900


def our_pattern(electrodes: int, frames: int = 12, duration_ms: int = 40) -> Pattern:
    """A stripe that walks over the array, with one silent frame."""
    stripes = [
        tuple(
            1.0 if (electrode + frame) % 4 == 0 and frame != 5 else 0.0
            for electrode in range(electrodes)
        )
        for frame in range(frames)
    ]
    return Pattern(
        electrodes=electrodes,
        frames=tuple(
            PatternFrame(
                duration_ms=duration_ms, off_ms=0, level=level, rate_hz=None, polarity=None
            )
            for level in stripes
        ),
    )


#: Decided before a rig is built: a skip in the middle of a test would leave its sockets open.
needs_kit = pytest.mark.skipif(
    not ETACTILEKIT.exists(), reason=f"the pattern files of eTactileKit are not at {ETACTILEKIT}"
)


def kit_pattern(name: str) -> Pattern:
    return load_pattern(ETACTILEKIT / name)[0]


class Player:
    """Plays frames on the rig, and keeps what was sent."""

    def __init__(self, rig: EngineRig, width_us: int = WIDTH_US) -> None:
        self.rig = rig
        self.width_us = width_us
        self.sent: list[Sent] = []

    def open_up(self, current_ua: int = CURRENT_UA) -> None:
        """Arm, and hold one electrode until the opening is there."""
        self.rig.open()
        self.rig.arm()
        count = self.rig.engine.components.loaded.array.count
        while self.rig.engine.components.soft_start.ceiling_ua < current_ua:
            self.rig.hold(20, current_ua=(current_ua, *(0,) * (count - 1)), rate_hz=20.0)
        self.rig.run_ms(250)

    def show(
        self,
        current_ua: Sequence[int],
        duration_ms: int,
        polarity: Polarity = "anodic",
        **more: object,
    ) -> None:
        """One picture for its time, renewed where that is longer than a frame may live."""
        for left_ms in range(duration_ms, 0, -LONGEST_MS):
            shown_ms = min(left_ms, LONGEST_MS)
            answer = self.rig.show(
                current_ua=tuple(current_ua),
                width_us=self.width_us,
                polarity=polarity,
                ttl_ms=shown_ms,
                allow_slower=True,
                **more,
            )
            assert answer.error is None, answer.reason
            phases = PHASES[polarity]
            self.sent.append(Sent(self.rig.last_seq, tuple(current_ua), self.width_us, phases))
            self.rig.run_ms(shown_ms)

    def play(self, pattern: Pattern, polarity: Polarity | None = None, **more: object) -> None:
        for index, frame in enumerate(pattern.frames):
            currents = [round(level * CURRENT_UA) for level in frame.level]
            asked = polarity or frame.polarity or "anodic"
            self.show(currents, frame.duration_ms, asked, tag=index, **more)

    def finish(self) -> list[Record]:
        """The end of the engine; its trace, checked against all accounts."""
        assert self.rig.close() == ()
        trace = self.rig.trace()
        assert violations(trace, self.rig.engine.components.loaded.board.rest_us) == []
        check_body(trace)
        check_what_passes(trace)
        scans = [report.scan for report in self.rig.reports if report.scan is not None]
        assert check_reports(trace, scans) > 0
        check_frames(self.sent, trace)
        return trace


ALL_POLARITIES: tuple[Polarity, ...] = (
    "anodic",
    "cathodic",
    "biphasic",
    "biphasic_cathodic_first",
)


@needs_kit
def test_all_frames_of_the_kits_sine_wave_come_out_as_sent() -> None:
    pattern = kit_pattern("pattern_sine_wave_64.json")
    assert len(pattern.frames) == 76
    player = Player(engine_rig.make(electrodes=64))
    player.open_up()
    player.play(pattern)
    trace = player.finish()
    tags = [
        entry["tag"]
        for entry in trace[1:]
        if entry.get("event") == "frame" and entry["tag"] is not None
    ]
    assert sorted(set(tags)) == list(range(76))


@needs_kit
@pytest.mark.parametrize("name", ["pattern_fading_8.json", "pattern_spiral_arms_8.json"])
def test_the_kits_patterns_of_8_come_out_as_sent(name: str) -> None:
    player = Player(engine_rig.make(electrodes=8))
    player.open_up()
    player.play(kit_pattern(name))
    player.finish()


@pytest.mark.parametrize(
    ("electrodes", "polarity"),
    [*product((8, 16, 64), ALL_POLARITIES), (256, "anodic"), (256, "biphasic_cathodic_first")],
)
def test_our_pattern_comes_out_as_sent(electrodes: int, polarity: Polarity) -> None:
    player = Player(engine_rig.make(electrodes=electrodes))
    player.open_up()
    player.play(our_pattern(electrodes), polarity)
    player.finish()


@pytest.mark.parametrize("board", ["reference-hv507", "etactilekit-hv513-x2", "etactilekit-hv513"])
def test_our_pattern_comes_out_as_sent_on_every_half_bridge_board(board: str) -> None:
    rig = engine_rig.make(board)
    player = Player(rig)
    player.open_up()
    player.play(our_pattern(rig.engine.components.loaded.array.count))
    player.finish()


@pytest.mark.parametrize("width_us", [20, 33, 34, 50, 77, 150, 200])
def test_every_width_comes_out_within_a_microsecond(width_us: int) -> None:
    player = Player(engine_rig.make(electrodes=16), width_us)
    player.open_up()
    player.play(our_pattern(16, frames=3))
    player.finish()


@pytest.mark.parametrize("polarity", ALL_POLARITIES)
def test_a_ring_of_returns_comes_out_as_sent_on_the_relay_board(polarity: Polarity) -> None:
    rig = engine_rig.make("feetthrough-relay")
    array = rig.engine.components.loaded.array
    ring = Ring(ring_mm=2 * array.pitch_mm())
    player = Player(rig)
    player.open_up()
    player.play(our_pattern(array.count, 6, 120), polarity, returns=ring)
    first = player.sent[0].seq
    trace = player.finish()
    expected = {
        electrode: set(array.ring(electrode, ring.ring_mm)) for electrode in range(array.count)
    }
    assert all(2 <= len(members) < array.count - 1 for members in expected.values())
    played = [phase for phase in decode(trace) if phase.seq is not None and phase.seq >= first]
    check_returns(played, Facts.of(trace[0]), expected)


def test_explicit_returns_come_out_as_sent_on_the_relay_board() -> None:
    rig = engine_rig.make("feetthrough-relay")
    count = rig.engine.components.loaded.array.count
    returns = tuple(
        ((electrode + 1) % count, (electrode + 5) % count) for electrode in range(count)
    )
    player = Player(rig)
    player.open_up()
    player.play(our_pattern(count, 4, 120), "cathodic", returns=returns)
    first = player.sent[0].seq
    trace = player.finish()
    played = [phase for phase in decode(trace) if phase.seq is not None and phase.seq >= first]
    expected = {electrode: set(members) for electrode, members in enumerate(returns)}
    check_returns(played, Facts.of(trace[0]), expected)
