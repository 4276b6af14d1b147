"""Any script of presentations: what each is told is what flowed. Some are limited at one electrode,
replaced by another one, or cut short by a lapse of the lease.
"""

from __future__ import annotations

import contextlib
import datetime
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

from hypothesis import HealthCheck, event, given, settings
from hypothesis import strategies as st

from etd.client.presented import CutShort, Presented
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.errors import Refused
from presenting_scenes import (
    CAP_UA,
    SECOND_NS,
    STEP_UA,
    WIDTH_US,
    N,
    check,
    flowed,
    meanwhile,
    rest,
)
from stepped_daemon import SteppedDaemon, SteppedDisplay
from trace_decoder import Phase

#: This electrode alone has a low cap.
LIMITED, LIMIT_UA = 2, 900
#: Of what rate and time make; and one pulse more or less at the ends.
ENOUGH = 0.98


@dataclass(frozen=True)
class Trial:
    pause_s: float
    wanted_ua: list[int]
    seconds: float
    rate_hz: float
    #: What happens before the pause of this number, if it comes to it.
    at: int
    happens: Literal["nothing", "another begins", "lapse"]
    other_ua: list[int]
    keeper_is_first: bool


wanted = st.lists(st.sampled_from([0, 0, 0, 300, 1_000, 2_400]), min_size=N, max_size=N)
trials = st.builds(
    Trial,
    pause_s=st.sampled_from([0.02, 0.4, 1.5, 20.0]),
    wanted_ua=wanted,
    seconds=st.sampled_from([0.05, 0.2, 0.7, 1.3]),
    rate_hz=st.sampled_from([20.0, 60.0]),
    at=st.integers(1, 4),
    happens=st.sampled_from(["nothing", "another begins", "lapse"]),
    other_ua=wanted,
    keeper_is_first=st.booleans(),
)


class Program:
    """Presents trial after trial, as a program under `kept()` does, and judges the accounts."""

    def __init__(self, daemon: SteppedDaemon) -> None:
        self._daemon = daemon
        loaded = daemon.loaded
        electrodes = [ElectrodeLimits(threshold_ua=200, comfortable_ua=800, cap_ua=CAP_UA)] * N
        electrodes[LIMITED] = ElectrodeLimits(threshold_ua=200, comfortable_ua=800, cap_ua=LIMIT_UA)
        made = Calibration(
            participant="P01",
            body_site=loaded.body_site.name,
            array=loaded.array.name,
            polarity="anodic",
            width_us=WIDTH_US,
            rate_hz=60.0,
            returns="all",
            date=datetime.date(2026, 1, 1),
            program="test",
            electrode=tuple(electrodes),
        )
        SteppedDisplay(daemon, CAP_UA, WIDTH_US).set_calibration("P01", made)
        self._display = SteppedDisplay(daemon, calibration="P01")
        self._display.arm()
        self._others: list[tuple[Presented, int]] = []

    def play(self, trial: Trial) -> None:
        daemon, display = self._daemon, self._display
        rest(daemon, display, trial.pause_s)
        since_ns, self._others = daemon.now_ns(), []
        course = display.presenting(
            trial.wanted_ua, trial.seconds, trial.rate_hz, after=display.last_seq
        )
        presented, refusal = None, None
        try:
            presented = display.play(meanwhile(course, trial.at, lambda: self._meanwhile(trial)))
        except Refused as refused:
            refusal = refused
        self._judge(trial, presented, refusal, since_ns)
        with contextlib.suppress(Refused):
            display.keep()
        # Anew after a lapse; else it stands.
        display.arm()

    def _meanwhile(self, trial: Trial) -> None:
        daemon, display = self._daemon, self._display
        if trial.happens == "lapse":
            daemon.sleep_until_ns(daemon.now_ns() + 2 * SECOND_NS)
            if trial.keeper_is_first:
                with contextlib.suppress(Refused):
                    display.keep()
        elif trial.happens == "another begins":
            since_ns = daemon.now_ns()
            course = display.presenting(trial.other_ua, 0.5, 60.0, after=display.last_seq)
            self._others.append((display.play(course), since_ns))

    # --- the judge --------------------------------------------------------------------------------

    def _judge(
        self, trial: Trial, presented: Presented | None, refusal: Refused | None, since_ns: int
    ) -> None:
        if isinstance(refusal, CutShort):
            assert (trial.happens, refusal.code) == ("lapse", "no_lease")
            event("cut short by a lapse")
            presented = refusal.presented
            assert any("it was cut short after" in why for why in presented.why_not)
        if presented is None:
            # Nothing of it was begun.
            assert refusal is not None
            assert refusal.code == ("no_lease" if trial.happens == "lapse" else "expired")
            return
        self._check(presented, trial.wanted_ua, since_ns)
        if presented.as_asked:
            self._check_whole(presented, trial, since_ns)
        for other, other_since_ns in self._others:
            event("replaced")
            self._check(other, trial.other_ua, other_since_ns)
            self._check_end(presented, other)

    def _check(self, presented: Presented, wanted_ua: Sequence[int], since_ns: int) -> None:
        fired = flowed(self._daemon, presented, since_ns)
        check(presented, fired, wanted_ua)
        for electrode in range(N):
            mine_ua = _currents_ua(fired, electrode)
            named = [why for why in presented.why_not if why.startswith(f"electrode {electrode}:")]
            if wanted_ua[electrode] and min(mine_ua, default=0) < wanted_ua[electrode] - STEP_UA:
                assert named, "it is told which electrode got less"
            if electrode == LIMITED and mine_ua:
                assert max(mine_ua) <= LIMIT_UA

    def _check_whole(self, presented: Presented, trial: Trial, since_ns: int) -> None:
        """Every electrode for as long as was asked."""
        fired = flowed(self._daemon, presented, since_ns)
        about = trial.rate_hz * trial.seconds
        for electrode, wanted_ua in enumerate(trial.wanted_ua):
            if wanted_ua:
                assert len(_currents_ua(fired, electrode)) >= ENOUGH * about - 1
        event("as asked")

    def _check_end(self, presented: Presented, other: Presented) -> None:
        """It is told by when the other one began, not by when this one noticed."""
        (why,) = (why for why in presented.why_not if "replaced it" in why)
        told = re.search(r"after ([0-9.]+) s", why)
        assert told is not None
        told_s = float(told[1])
        if presented.first_ns is not None and presented.last_ns is not None:
            assert told_s * 1.05 + 0.01 >= (presented.last_ns - presented.first_ns) / 1e9
            if other.first_ns is not None:
                until_s = (other.first_ns - presented.first_ns) / 1e9
                assert told_s * 0.95 <= until_s + 1 / presented.rate_hz


def _currents_ua(fired: Sequence[Phase], electrode: int) -> list[float]:
    return [phase.current_ua for phase in fired if phase.electrode == electrode]


@settings(
    deadline=None,
    max_examples=25,
    suppress_health_check=[HealthCheck.too_slow],
)
@given(script=st.lists(trials, min_size=1, max_size=4))
def test_what_any_script_is_told_is_what_flowed(script: list[Trial]) -> None:
    with SteppedDaemon("pad-8", is_traced=True) as daemon:
        program = Program(daemon)
        for trial in script:
            program.play(trial)
