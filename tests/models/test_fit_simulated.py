"""The simulated wearer of a fake, over the protocol: the finger comes into each state of a fit."""

from __future__ import annotations

import pytest

from calibrated_body import conditions_of
from etd.calibrate.fitting import STATES
from etd.calibrate.stimulator import Stimulator
from etd.cli.fit_wearer import SimulatedWearer
from etd_body import states
from etd_body.states import BreathingBody
from stepped_daemon import SteppedDaemon, SteppedDisplay

SHOWN_UA, PRESENTED = 900, 3


def resistances_ohm(asked_in: tuple[int, ...]) -> list[int]:
    """Of one electrode in each of these states, by what a presentation reports."""
    with SteppedDaemon("pad-8", 4, body=BreathingBody) as daemon:
        display, wearer = SteppedDisplay(daemon, 3_000, 100), SimulatedWearer(1)
        display.arm()
        stimulator = Stimulator(
            display,
            display,
            daemon,
            conditions_of(daemon, "staircase", 10),
            wearer.answerer.wants_stop,
            wearer.hear,
        )
        stimulator.open()
        presenter, seen = wearer.presenter(stimulator), []
        for state in asked_in:
            wearer.come_into(state, stimulator)
            told = [presenter.present(2, SHOWN_UA).resistance_ohm for _ in range(PRESENTED)]
            assert None not in told
            seen.append(sorted(ohm for ohm in told if ohm is not None)[PRESENTED // 2])
        display.close()
        return seen


def test_each_state_of_a_fit_has_its_skin_also_where_it_is_continued() -> None:
    assert len(states.STATES) == len(STATES)
    seen = resistances_ohm(tuple(range(len(STATES))))
    dry, damp, again, pressed, last = seen
    assert dry > 2.0 * damp
    assert dry > 1.7 * pressed
    assert dry == pytest.approx(again, rel=0.3)
    assert dry == pytest.approx(last, rel=0.3)
    assert resistances_ohm((3, 4)) == pytest.approx([pressed, last], rel=0.05)
