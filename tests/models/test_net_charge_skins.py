"""No electrode has more net charge than its site allows, by the body's own account: on any skin,
with any frames of any polarity, and with contacts that change.
"""

from __future__ import annotations

import math
from contextlib import closing
from typing import Any

from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import engine_rig
from engine_scenes import config, fully_open
from etd_body.electrode import OPEN_CONTACT, Contact, load, skin
from etd_body.minimal import MinimalBody
from net_witness import NetWitness

N = 8
BOUND_UC = 10.0

ohms = st.floats(math.log(2e3), math.log(3e5)).map(math.exp)
contacts = st.one_of(
    ohms.map(load),
    st.builds(skin, st.floats(1e3, 3e3), ohms, st.floats(0.05, 0.5)),
    st.just(OPEN_CONTACT),
)
acts = st.fixed_dictionaries(
    {
        "current_ua": st.tuples(*[st.sampled_from([0, 0, 500, 1_500, 2_500])] * N),
        "polarity": st.sampled_from(["anodic", "anodic", "cathodic", "biphasic"]),
        "width_us": st.sampled_from([50, 100, 150]),
        "rate_hz": st.sampled_from([30.0, 60.0, 100.0]),
    }
)
changes = st.dictionaries(st.integers(0, N - 1), contacts, max_size=2)
#: Seven that are weakly connected, and one that carries the pulses of three of them.
ONE_CARRIES_ALL: dict[str, Any] = {
    "skins": [load(2_000.0), *[load(20_000.0)] * (N - 1)],
    "story": [
        ({}, {"current_ua": (0, 0, 0, 0, 0, 1_500, 1_500, 1_500), "polarity": "anodic",
              "width_us": 100, "rate_hz": 60.0})
    ] * 3,
}  # fmt: skip


def test_no_electrode_has_more_than_its_bound_by_the_body_itself() -> None:
    @settings(
        deadline=None,
        max_examples=12,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(
        skins=st.lists(contacts, min_size=N, max_size=N),
        story=st.lists(st.tuples(changes, acts), min_size=1, max_size=3),
    )
    @example(**ONE_CARRIES_ALL)
    def any_skin(
        skins: list[Contact], story: list[tuple[dict[int, Contact], dict[str, Any]]]
    ) -> None:
        loaded = config(electrodes=N)
        source = loaded.board.source
        body = MinimalBody(tuple(skins), leak_ohm=source.leak_ohm, compliance_v=source.compliance_v)
        with closing(engine_rig.make(loaded=loaded, body=body)) as rig:
            witness = NetWitness(body)
            rig.meanwhile = witness.look
            fully_open(rig)
            for changed, asked in story:
                for electrode, contact in changed.items():
                    body.touch(rig.clock.now_ns(), electrode, contact)
                # Renewed as a client does, and no more once it is refused.
                for _ in range(12):
                    answer = rig.show(ttl_ms=200, allow_slower=True, **asked)
                    rig.run_ms(100)
                    if answer.error is not None:
                        break
            assert witness.most_uc <= BOUND_UC

    any_skin()
