"""The rate that a reply says lasts is shown for as long as is asked, on modelled fingers: returns
are measured meanwhile, and the ways in which they may share draw apart.
"""

from __future__ import annotations

from contextlib import closing
from typing import Any

import pytest

import engine_rig
from bench import steady_skin
from engine_scenes import config, opened_to, shortfalls
from etd_body.kinds import BodyKind

#: Renewed as a client does.
EVERY_MS, TTL_MS = 100, 300


@pytest.mark.parametrize("kind", ["area", "capacitive", "bent"])
@pytest.mark.parametrize(("electrodes", "every"), [(8, 4), (16, 2), (16, 4), (32, 2), (32, 4)])
@pytest.mark.parametrize("seed", [51, 52])
def test_the_rate_that_is_said_to_last_after_a_tenth_of_a_second_does(
    electrodes: int, every: int, kind: str, seed: int
) -> None:
    """At the rate itself that follows from how returns conduct, a third of these is refused or
    loses pulses. Before they are measured no rate is named.
    """
    loaded = config(electrodes=electrodes)
    body = steady_skin.body_of(seed, loaded.board, loaded.array, BodyKind(kind))
    current_ua = tuple(2_000 if at % every == 0 else 0 for at in range(electrodes))
    asked: dict[str, Any] = {
        "current_ua": current_ua,
        "polarity": "anodic",
        "width_us": 150,
        "ttl_ms": TTL_MS,
        "allow_slower": True,
    }
    with closing(engine_rig.make(loaded=loaded, body=body, is_traced=False)) as rig:
        rig.open(3_000, 200)
        rig.arm()
        opened_to(rig, 3_000)
        lasting_hz = None
        for at in range(10):
            answer = rig.show(rate_hz=60.0, **asked)
            assert answer.error is None, answer.reason
            told = [it for it in answer.slowed if it.reason == "net_charge"]
            lasting_hz = told[0].lasting_hz if told else None
            assert at or lasting_hz is None
            if at >= 2 and lasting_hz is not None:
                break
            rig.run_ms(50)
        assert lasting_hz is not None
        for _ in range(40):
            answer = rig.show(rate_hz=lasting_hz, **asked)
            assert answer.error is None, answer.reason
            rig.run_ms(EVERY_MS)
        assert [it for it in shortfalls(rig) if it.reason == "net_charge"] == []
