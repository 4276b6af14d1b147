"""A person's session as a script of trials and pauses, and its judge: replies against wires.

Owns: showing frames as a program does, and that each reply told what its pulses became. Must not
know: which script is played.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from hypothesis import strategies as st

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import MS, calibration, only, open_calibrated, phases
from etd.protocol.link import ArmBoard, CloseLease
from etd.protocol.outcome import Clamp
from rise_witness import RISE_UA, Rise

N = 16
STEP_UA = 10_000 / 4_095
CAP_UA = 3_000


def armed_for(rig: EngineRig, participant: str = "P01") -> EngineRig:
    """With that person's calibration, whatever lease stands."""
    if rig.engine.supervisor.lease is not None:
        assert rig.ask(CloseLease, lease=LEASE).error is None
    made = calibration(rig, [CAP_UA] * N, participant=participant)
    assert open_calibrated(rig, made).error is None
    answer = rig.ask(ArmBoard)
    assert answer.error is None, answer.reason
    return rig


@dataclass
class Frames:
    """Frames that are shown one after another, and what each reply said."""

    rig: EngineRig
    #: When it was answered, what it asked for, and its clamps by electrode.
    told: list[tuple[int, Sequence[int], dict[int, Clamp]]] = field(default_factory=list)

    def show(self, current_ua: Sequence[int], seconds: float, rate_hz: float = 60.0) -> None:
        """As `Display.hold` does, which ends in silence."""
        until_ns = self.rig.clock.now_ns() + int(seconds * 1e9)
        while self.rig.clock.now_ns() < until_ns:
            self._frame(current_ua, rate_hz)
            self.rig.run_ms(min(60.0, (until_ns - self.rig.clock.now_ns()) / MS))
        self._frame((0,) * N, rate_hz)

    def _frame(self, current_ua: Sequence[int], rate_hz: float) -> None:
        answer = self.rig.show(current_ua=current_ua, rate_hz=rate_hz)
        assert answer.error is None, answer.reason
        clamped = {clamp.electrode: clamp for clamp in answer.clamped}
        self.told.append((self.rig.clock.now_ns(), current_ua, clamped))

    def open_to(self, current_ua: int) -> None:
        """A told opening: shown until a reply has no clamps."""
        while not self.told or self.told[-2][2]:
            self.show(only(N, e3=current_ua), 0.2)

    def check(self) -> None:
        """Against the wires: each pulse fires what its frame asked for, or its reply told less."""
        fired, frame = phases(self.rig, self.told[0][0]), 0
        for phase in fired:
            while frame + 1 < len(self.told) and self.told[frame + 1][0] <= phase.from_ns:
                frame += 1
            _, asked_ua, clamped = self.told[frame]
            assert phase.electrode is not None
            wanted_ua = asked_ua[phase.electrode]
            if not wanted_ua or not frame:
                continue  # a look, or a scan of the frame before
            before_ua = self.told[frame - 1][1][phase.electrode]
            if phase.electrode not in clamped and before_ua in (0, wanted_ua):
                assert wanted_ua - STEP_UA <= phase.current_ua <= wanted_ua


#: The pause before it, the currents, how long and how fast: of a trial.
trials = st.tuples(
    st.sampled_from([0.01, 0.3, 1.5, 20.0, 61.0]),
    st.lists(st.sampled_from([0, 0, 0, 300, 1_000, 2_400]), min_size=N, max_size=N),
    st.sampled_from([0.05, 0.2, 0.6]),
    st.sampled_from([20.0, 60.0]),
)
scripts = st.lists(trials, min_size=1, max_size=6)


def check_script(script: list[tuple[float, list[int], float, float]]) -> None:
    """Pause, then show, trial by trial; the lease lapses in the longer pauses."""
    rig = armed_for(engine_rig.make(electrodes=N))
    frames = Frames(rig)
    for pause_s, current_ua, seconds, rate_hz in script:
        rig.run_ms(1_000 * pause_s)
        if rig.engine.supervisor.lease is None:
            armed_for(rig)
        frames.show(current_ua, seconds, rate_hz)
    frames.check()
    rise = Rise()
    assert all(rise.above_ua(phase.from_ns, phase.current_ua) <= RISE_UA for phase in phases(rig))
    assert rig.close() == ()
