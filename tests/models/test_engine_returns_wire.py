"""No return carries more than its cap, on any board and any skin, with electrodes stimulated in any
order and contacts that change: by the circuit of the modelled body, not by what the engine knows.
"""

from __future__ import annotations

import math
from contextlib import closing
from typing import Any, NamedTuple

import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

import engine_rig
from engine_scenes import calibration, config, open_calibrated, opened_to
from etd_body.electrode import OPEN_CONTACT, Contact, load, skin
from return_witness import ReturnWitness

N = 8
BOARDS = (
    "kajimoto-hv507",
    "reference-hv507",
    "etactilekit-hv513",
    "etactilekit-hv513-x2",
    "etactilekit-hv513-x8",
    "feetthrough-relay",
)
#: Of a current that a return carries, by what floating point leaves out.
ROUNDING = 1e-6
#: From then on no measurement and nothing that follows from one is of a contact before its change.
KNOWN_AGAIN_NS = 1_300_000_000
_RENEWED_MS = 40

series = st.floats(1e3, 3e3)
ohms = st.floats(math.log(1e3), math.log(5e5)).map(math.exp)
contacts = st.one_of(
    ohms.map(load),
    st.builds(skin, series, ohms, st.floats(0.05, 0.5)),
    st.just(skin()),
    st.just(OPEN_CONTACT),
)
electrodes = st.integers(0, N - 1)


class Sweep(NamedTuple):
    """Electrodes that are stimulated in turn, each strongly and for so long."""

    order: list[int]
    hold_ms: int
    fields: dict[str, Any]

    def play(self, rig: engine_rig.EngineRig) -> None:
        strength_ua = self.fields["strength_ua"]
        fields = {key: value for key, value in self.fields.items() if key != "strength_ua"}
        for electrode in self.order:
            wanted = tuple(strength_ua if other == electrode else 0 for other in range(N))
            for _ in range(self.hold_ms // _RENEWED_MS):
                answer = rig.show(current_ua=wanted, allow_slower=True, **fields)
                # A return may be near its bound of net charge: then nothing is fired.
                assert answer.error in (None, "over_maximum"), answer.reason
                rig.run_ms(_RENEWED_MS)


class Change(NamedTuple):
    """A contact that is laid on, taken off, or another one from now on."""

    electrode: int
    contact: Contact


sweeps = st.builds(
    Sweep,
    st.lists(electrodes, min_size=1, max_size=N, unique=True),
    st.sampled_from([40, 120]),
    st.fixed_dictionaries(
        {
            "strength_ua": st.sampled_from([200, 800, 2_500, 4_000]),
            "width_us": st.sampled_from([20, 30, 50, 100]),
            "rate_hz": st.sampled_from([10.0, 30.0]),
            "polarity": st.sampled_from(["anodic", "cathodic", "biphasic"]),
        }
    ),
)
changes = st.lists(st.builds(Change, electrodes, contacts), max_size=3)
acts = st.lists(st.tuples(changes, st.lists(sweeps, min_size=1, max_size=2)), max_size=2)


def weak(width_us: int) -> dict[str, Any]:
    return {"strength_ua": 200, "width_us": width_us, "rate_hz": 10.0, "polarity": "anodic"}


#: Electrode 5 becomes one that conducts 20 times better, and the path of 0 tells that first.
TOLD_BY_ANOTHER: dict[str, Any] = {
    "skins": [
        *(skin(3_000, math.exp(8), 0.36), skin(), skin(), OPEN_CONTACT),
        *(load(77_000), skin(), OPEN_CONTACT, load(28_000)),
    ],
    "caps_ua": [100] + [50] * 7,
    "first": Sweep([0], 40, weak(20)),
    "acts": [([Change(5, load(3_500))], [Sweep([0], 120, weak(100))])],
}


def play(rig: engine_rig.EngineRig, swept: list[Sweep]) -> None:
    for sweep in swept:
        sweep.play(rig)


@pytest.mark.parametrize("board", BOARDS)
def test_no_return_carries_more_than_its_cap_by_the_body_itself(board: str) -> None:
    @settings(
        deadline=None,
        max_examples=10,
        suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
    )
    @given(
        skins=st.lists(contacts, min_size=N, max_size=N),
        caps_ua=st.lists(st.sampled_from([50, 100, 300, 1_000, 4_000]), min_size=N, max_size=N),
        first=sweeps,
        acts=acts,
    )
    @example(**TOLD_BY_ANOTHER)
    def any_skin(
        skins: list[Contact],
        caps_ua: list[int],
        first: Sweep,
        acts: list[tuple[list[Change], list[Sweep]]],
    ) -> None:
        with closing(engine_rig.make(loaded=config(board, N))) as rig:
            witness = ReturnWitness(rig, skins)
            assert open_calibrated(rig, calibration(rig, caps_ua)).error is None
            rig.arm()
            opened_to(rig, max(caps_ua))
            play(rig, [first])
            for changed, swept in acts:
                for electrode, contact in changed:
                    witness.touch(electrode, contact)
                known_ns = rig.clock.now_ns() + KNOWN_AGAIN_NS
                while rig.clock.now_ns() < known_ns:
                    play(rig, swept)
                play(rig, swept)
            assert rig.state == "ARMED"
            for carried in witness.carried():
                if carried.settled_ns >= KNOWN_AGAIN_NS:
                    assert carried.current_ua <= caps_ua[carried.electrode] + ROUNDING, carried

    any_skin()
