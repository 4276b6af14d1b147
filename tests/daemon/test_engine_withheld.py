"""A measurement of contact that limits leave no room for says where, by which limit, until when."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import calibration, config, only, open_calibrated
from etd.protocol.link import Answer, CloseLease, MeasureContact
from etd.protocol.messages import Contact

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16


def measured(answer: Answer) -> Contact:
    assert answer.error is None, answer.reason
    assert answer.contact is not None
    return answer.contact


def shown_then_measured(rig: EngineRig, **frame: object) -> Contact:
    """Strong pulses, and the measurement of another lease at once."""
    rig.open()
    rig.arm()
    rig.hold(3_000, **frame)
    assert rig.ask(CloseLease, lease=LEASE).error is None
    rig.open()
    return measured(rig.ask(MeasureContact, lease=LEASE))


def test_probes_that_the_ledger_withholds_are_told_until_they_have_room(
    make_rig: MakeRig,
) -> None:
    rig = make_rig(loaded=config(electrodes=N, maxima={"mean_current_ua": 6}))
    found = shown_then_measured(rig, current_ua=(2_400,) * N, rate_hz=20.0, width_us=100)
    withheld = {one.electrode: one for one in found.withheld}
    assert withheld
    assert {one.reason for one in found.withheld} <= {"charge", "return charge"}
    assert {one for one in range(N) if found.contact[one] is None} == set(withheld)
    after_ms = max(one.after_ms or 0 for one in found.withheld)
    assert 0 < after_ms <= 1_000
    rig.run_ms(after_ms)
    later = measured(rig.ask(MeasureContact, lease=LEASE))
    assert later.withheld == ()
    assert None not in later.contact


def test_a_cap_that_is_below_the_source_s_step_withholds_for_good(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    caps_ua = [2_000] * N
    caps_ua[3] = 1
    assert open_calibrated(rig, calibration(rig, caps_ua)).error is None
    found = measured(rig.ask(MeasureContact, lease=LEASE))
    reasons = {one.electrode: one.reason for one in found.withheld}
    assert reasons.pop(3) == "resolution", "it has no code so low"
    assert set(reasons.values()) <= {"return_cap"}, "it is a return of the others"
    assert {one.after_ms for one in found.withheld} == {None}
    assert found.contact[3] is None


def test_what_is_not_withheld_is_not_told(make_rig: MakeRig) -> None:
    rig = make_rig(electrodes=N)
    found = shown_then_measured(rig, current_ua=only(N, e0=500), rate_hz=20.0)
    assert found.withheld == ()
