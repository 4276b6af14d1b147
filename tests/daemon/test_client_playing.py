"""Patterns, played by a program: over the wires on stepped time, and by both displays."""

from __future__ import annotations

import asyncio
import signal
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

from etd import AsyncDisplay, Display, Pattern, PatternError, PatternFrame, Refused
from etd.client import clock
from etd.protocol.link import Answer, Command, NewFrame, Report
from etd.protocol.messages import Fired, Halt, Scan, Shown, StateReport
from etd.protocol.outcome import Shortfall
from gateway_rig import ServedRig
from scripted_engine import full_answer
from stepped_daemon import SteppedDaemon, SteppedDisplay
from trace_decoder import Phase

pytestmark = pytest.mark.slow

N, MS = 8, 1_000_000
CURRENTS: dict[str, Any] = {"current_ua": 400, "width_us": 100}


def frame(*electrodes: int, ms: int = 100, off_ms: int = 0, rate_hz: float = 50.0) -> PatternFrame:
    level = tuple(1.0 if electrode in electrodes else 0.0 for electrode in range(N))
    return PatternFrame(duration_ms=ms, off_ms=off_ms, level=level, rate_hz=rate_hz)


WAVE = Pattern(electrodes=N, frames=(frame(1), frame(2, off_ms=60), frame(3)))


@pytest.fixture
def daemon() -> Iterator[SteppedDaemon]:
    with SteppedDaemon("pad-8", is_traced=True) as made:
        yield made


def armed(daemon: SteppedDaemon) -> SteppedDisplay:
    display = SteppedDisplay(daemon, 3_000, 100)
    display.arm()
    return display


def fired(daemon: SteppedDaemon, since_ns: int) -> list[Phase]:
    """Polls of contact are weaker."""
    return [
        phase
        for phase in daemon.followed.phases()
        if phase.from_ns >= since_ns and phase.current_ua > 350
    ]


# --- on the wires ---------------------------------------------------------------------------------


def test_each_frame_is_fired_for_its_time_and_then_nothing(daemon: SteppedDaemon) -> None:
    display, since_ns = armed(daemon), daemon.now_ns()
    played = display.play_pattern(WAVE, **CURRENTS)
    over_ns = daemon.now_ns()
    for _ in range(5):
        daemon.sleep_until_ns(daemon.now_ns() + 100 * MS)
        display.keep()
    phases = fired(daemon, since_ns)
    spans_ns = {
        electrode: [phase.from_ns for phase in phases if phase.electrode == electrode]
        for electrode in (1, 2, 3)
    }
    assert {phase.electrode for phase in phases} == {1, 2, 3}
    for begun_ns in spans_ns.values():
        # Reports pass through threads of ZeroMQ, which step with nobody: a frame may stand longer.
        assert len(begun_ns) >= 4
        assert begun_ns[-1] - begun_ns[0] >= 60 * MS
    assert spans_ns[3][0] - spans_ns[2][0] >= 155 * MS, "its silence was waited for"
    assert max(phase.from_ns for phase in phases) <= over_ns + 25 * MS
    assert (played.frames, played.not_fired, played.slowed_to_hz) == (3, {}, None)
    # Told by these reports too: less by some scans where the first ones come late.
    assert played.played_s >= 0.25


def test_it_is_repeated(daemon: SteppedDaemon) -> None:
    shown: list[int] = []
    played = armed(daemon).play_pattern(WAVE, **CURRENTS, repeat=3, on_frame=shown.append)
    assert played.frames == 9
    assert shown == list(range(1, 10))


def test_it_ends_after_the_seconds_given_though_its_frame_is_not_over(
    daemon: SteppedDaemon,
) -> None:
    display = armed(daemon)
    long = Pattern(electrodes=N, frames=(frame(1, ms=200), frame(2, ms=60_000)))
    since_ns = daemon.now_ns()
    played = display.play_pattern(long, **CURRENTS, seconds=0.7)
    assert 0.7 <= played.played_s < 10.0
    assert played.frames == 1
    over_ns = daemon.now_ns()
    daemon.sleep_until_ns(over_ns + 300 * MS)
    assert max(phase.from_ns for phase in fired(daemon, since_ns)) <= over_ns + 25 * MS


def test_seconds_repeat_a_pattern_that_is_shorter(daemon: SteppedDaemon) -> None:
    played = armed(daemon).play_pattern(WAVE, **CURRENTS, seconds=1.0)
    assert 3 < played.frames <= 8, "it has three"
    assert 1.0 <= played.played_s < 10.0


def test_what_interrupts_it_leaves_silence(daemon: SteppedDaemon) -> None:
    display, since_ns = armed(daemon), daemon.now_ns()

    def interrupt(_: int) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        display.play_pattern(
            Pattern(electrodes=N, frames=(frame(1), frame(2, ms=5_000))),
            **CURRENTS,
            on_frame=interrupt,
        )
    over_ns = daemon.now_ns()
    daemon.sleep_until_ns(over_ns + 300 * MS)
    phases = fired(daemon, since_ns)
    assert {phase.electrode for phase in phases} == {1}
    assert max(phase.from_ns for phase in phases) <= over_ns + 25 * MS


def test_a_frame_that_is_refused_is_named_and_the_one_before_it_falls_silent(
    daemon: SteppedDaemon,
) -> None:
    display = armed(daemon)
    with pytest.raises(Refused, match="frame 1: electrode 2: rate 150 Hz") as caught:
        display.play_pattern(
            Pattern(electrodes=N, frames=(frame(1), frame(2, rate_hz=150.0))), **CURRENTS
        )
    assert caught.value.code == "over_maximum"
    assert daemon.engine.components.active.schedule is not None
    since_ns = daemon.now_ns() + 25 * MS
    daemon.sleep_until_ns(since_ns + 300 * MS)
    assert fired(daemon, since_ns) == []


def test_what_is_played_otherwise_is_told_at_once_and_in_the_end(daemon: SteppedDaemon) -> None:
    told: list[str] = []
    played = armed(daemon).play_pattern(WAVE, **CURRENTS, max_rate_hz=20.0, tell=told.append)
    assert told == ["3 frames have more than 20 Hz and are played at 20 Hz"]
    assert played.told == tuple(told)


# --- what it is asked -----------------------------------------------------------------------------


@pytest.fixture
def rig() -> Iterator[ServedRig]:
    with ServedRig() as made:
        yield made


def four(*levels: float, ms: int = 60) -> PatternFrame:
    return PatternFrame(duration_ms=ms, level=levels)


FOUR = Pattern(electrodes=4, frames=(four(1, 0, 0, 0), four(0, 1, 0, 0)))
LIMITS: dict[str, Any] = {"max_current_ua": 3_000, "width_us": 100}


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"current_ua": 500}, "current_ua and width_us go together"),
        ({**CURRENTS, "level": 0.5}, "one of the two"),
        ({"level": 0.0}, "level=0.0: above 0"),
        ({**CURRENTS, "seconds": -1}, "seconds=-1: a number above 0"),
        ({**CURRENTS, "max_rate_hz": "fast"}, "max_rate_hz='fast'"),
        ({**CURRENTS, "repeat": 0}, "repeat=0: a whole number from 1"),
        ({**CURRENTS, "repeat": 1.5}, "repeat=1.5"),
        ({**CURRENTS, "rate": 20}, "play has no option 'rate'; it has allow_slower"),
        ({}, r"levels need a calibration: use Display\(calibration='NAME'\)"),
    ],
)
def test_what_cannot_be_asked_is_refused_before_anything_is_sent(
    rig: ServedRig, options: dict[str, Any], said: str
) -> None:
    with Display(address=rig.address, **LIMITS) as display, pytest.raises(Refused, match=said):
        display.play(FOUR, **options)
    assert rig.engine.heard == []


@pytest.mark.parametrize(
    ("pattern", "said"),
    [
        (Pattern(electrodes=4, frames=()), "the pattern: frames"),
        (Pattern(electrodes=4, frames=(four(1, 0),)), "frame 0: level has 2 values for 4"),
        (Pattern(electrodes=4, frames=(four(2, 0, 0, 0),)), "frame 0: level"),
        (Pattern(electrodes=4, frames=(four(1, 0, 0, 0, ms=0),)), "frame 0: duration_ms"),
        ([[1, 0, 0, 0]], "it is a list: give an etd.Pattern, or the path"),
    ],
)
def test_a_pattern_that_is_none_is_named(rig: ServedRig, pattern: Any, said: str) -> None:
    with Display(address=rig.address, **LIMITS) as display, pytest.raises(PatternError, match=said):
        display.play(pattern, **CURRENTS)
    assert rig.engine.heard == []


def test_a_pattern_is_checked_without_being_shown(rig: ServedRig) -> None:
    fast = Pattern(
        electrodes=4, frames=(PatternFrame(duration_ms=50, level=(1, 0, 0, 0), rate_hz=90),)
    )
    with Display(address=rig.address, **LIMITS) as display:
        assert display.check_pattern(FOUR, **CURRENTS) == ()
        (told,) = display.check_pattern(fast, **CURRENTS, max_rate_hz=30)
        assert "played at 30 Hz" in told
        with pytest.raises(Refused, match="for 8 electrodes, this array has 4"):
            display.check_pattern(WAVE, **CURRENTS)
    assert rig.engine.frames == []


# --- both displays --------------------------------------------------------------------------------


ZEROS = (0,) * 4
NOTHING = Fired(
    wanted_ua=ZEROS,
    current_ua=ZEROS,
    delivered_ua=ZEROS,
    width_us=ZEROS,
    voltage_v=ZEROS,
    resistance_ohm=ZEROS,
    contact=(None,) * 4,
)


def reporting(rig: ServedRig) -> Callable[[Command | NewFrame], Answer]:
    """Each frame is reported as begun at once."""

    def answer(message: Command | NewFrame) -> Answer:
        if isinstance(message, NewFrame):
            now_ns = clock.now_ns()
            shown = Shown(
                seq=message.frame.seq,
                tag=message.frame.tag,
                begun_ns=now_ns,
                first_ns=now_ns,
                last_ns=now_ns,
                ended=False,
            )
            scan = Scan(
                now_ns=now_ns,
                shown=(shown,),
                seq=message.frame.seq,
                tag=message.frame.tag,
                scans=1,
                fired=NOTHING,
                clamped=(),
                not_fired=(),
                ceiling_ua=10_000,
                dropped_reports=0,
            )
            rig.engine.say(Report(scan=scan))
        return full_answer(message)

    return answer


def currents_of(rig: ServedRig) -> list[tuple[int, ...]]:
    return [sent.frame.current_ua or () for sent in rig.engine.frames]


SENT = [(400, 0, 0, 0), (0, 400, 0, 0), (0, 0, 0, 0)]


def test_a_file_or_a_pattern_is_played_and_falls_silent(rig: ServedRig, tmp_path: Path) -> None:
    path = tmp_path / "wave.json"
    path.write_text(
        '{"etd_pattern": 1, "electrodes": 4, "frames": ['
        '{"duration_ms": 60, "active": [0]}, {"duration_ms": 60, "active": [1]}]}'
    )
    rig.engine.answer = reporting(rig)
    with Display(address=rig.address, **LIMITS) as display:
        display.arm()
        for pattern in (FOUR, path, str(path)):
            assert display.play(pattern, **CURRENTS).frames == 2
    assert currents_of(rig) == SENT * 3


def test_pulses_that_get_both_phases_are_told_once(rig: ServedRig) -> None:
    report = reporting(rig)

    def balanced(message: Command | NewFrame) -> Answer:
        answer = report(message)
        if not isinstance(message, NewFrame):
            return answer
        return msgspec.structs.replace(answer, slowed=(Shortfall(electrode=0, reason="balanced"),))

    rig.engine.answer = balanced
    with Display(address=rig.address, **LIMITS) as display:
        display.arm()
        (told,) = display.play(FOUR, **CURRENTS).told
    assert "both phases" in told
    assert "name a polarity" in told


def test_control_c_ends_it_silent(rig: ServedRig) -> None:
    report = reporting(rig)

    def interrupt(message: Command | NewFrame) -> Answer:
        if isinstance(message, NewFrame) and message.frame.seq == 2:
            signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)
        return report(message)

    rig.engine.answer = interrupt
    with Display(address=rig.address, **LIMITS) as display:
        display.arm()
        with pytest.raises(KeyboardInterrupt):
            display.play(FOUR, **CURRENTS, repeat=1_000)
        assert currents_of(rig)[-1] == (0, 0, 0, 0)
        assert len(rig.engine.frames) <= 4


def test_it_is_awaited_and_ends_silent_when_it_is_cancelled(rig: ServedRig) -> None:
    rig.engine.answer = reporting(rig)

    async def script() -> None:
        async with AsyncDisplay(address=rig.address, **LIMITS) as display:
            await display.arm()
            assert await display.check_pattern(FOUR, **CURRENTS) == ()
            assert (await display.play(FOUR, **CURRENTS)).frames == 2
            assert currents_of(rig) == SENT
            playing = asyncio.create_task(display.play(FOUR, **CURRENTS, repeat=1_000))
            while len(rig.engine.frames) < 6:
                await asyncio.sleep(0.005)
            playing.cancel()
            with pytest.raises(asyncio.CancelledError):
                await playing
            assert currents_of(rig)[-1] == (0, 0, 0, 0)

    asyncio.run(script())


# --- what ends it ---------------------------------------------------------------------------------


def refused_after_the_first(rig: ServedRig, halt: Halt | None) -> str:
    """What is said where a frame is refused before any halt is reported."""
    state: StateReport = StateReport(
        state="HALTED" if halt else "SAFE", now_ns=1, engine="there", halt=halt
    )

    def answer(message: Command | NewFrame) -> Answer | None:
        if not isinstance(message, NewFrame):
            return full_answer(message)
        rig.engine.say(Report(state=state))
        return Answer(ref=message.ref, error="no_lease", reason="no lease stands")

    rig.engine.answer = answer
    with Display(address=rig.address, **LIMITS) as display, pytest.raises(Refused) as caught:
        display.play(FOUR, **CURRENTS)
    return str(caught.value)


def test_a_frame_that_is_refused_after_a_halt_is_told_as_the_halt(rig: ServedRig) -> None:
    halt = Halt(cause="stop", source="etd stop", detail="asked to stop", t_ns=1)
    assert "halted by stop (etd stop: asked to stop)" in refused_after_the_first(rig, halt)


def test_a_frame_that_is_refused_without_a_halt_is_told_as_refused(rig: ServedRig) -> None:
    assert "frame 0: no lease stands" in refused_after_the_first(rig, None)
