"""What was too strong is forgotten when the supply goes off, and does not come back at once."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import calibration, only
from etd.protocol.link import CloseLease, SayFelt
from etd.safety.soft_start import RISE_UA

MakeRig = Callable[..., EngineRig]
N, UA = 16, 2_000


def show(rig: EngineRig, ms: int) -> list[int]:
    """The currents of its pulses in turn, as they were asked of the source."""
    before = len(rig.body())
    for _ in range(ms // 100):
        rig.show(current_ua=only(N, e1=UA), rate_hz=40.0, ttl_ms=200)
        rig.run_ms(100)
    fired = [one["asked_ua"] for one in rig.body()[before:] if one["electrode"] == 1]
    probe_ua = rig.engine.supervisor.maxima.probe_current_ua
    return [ua for ua in fired if ua != pytest.approx(probe_ua, rel=0.05)]


@pytest.mark.parametrize("said", [False, True])
def test_the_next_arming_begins_where_the_last_one_was_unless_it_was_too_strong(
    make_rig: MakeRig, said: bool
) -> None:
    rig = make_rig(electrodes=N)
    made = calibration(rig, (3_000,) * N)
    assert rig.open_with(made).error is None
    rig.arm()
    risen = show(rig, 3_000)
    assert max(risen) == pytest.approx(UA, rel=0.02)
    if said:
        assert rig.ask(SayFelt, answer="too_strong", electrodes=None, lease=LEASE).error is None
    assert rig.ask(CloseLease, lease=LEASE).error is None
    assert rig.open_with(made).error is None
    rig.arm()
    found = show(rig, 1_000)
    if said:
        assert found[0] < RISE_UA
        assert found == sorted(found)
    else:
        assert found[0] == pytest.approx(UA, rel=0.02)
