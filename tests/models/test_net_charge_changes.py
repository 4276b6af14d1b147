"""No electrode has more net charge than its site allows where a silent return conducts much better
than all others, or begins to while many electrodes are stimulated: by the body's own account.

Owns: these scenes, on the board whose returns are all other electrodes. Must not know: how the
engine counts it.
"""

from __future__ import annotations

import math
from contextlib import closing
from dataclasses import dataclass

import pytest

import engine_rig
from engine_rig import EngineRig
from engine_scenes import config, fully_open
from etd_body.electrode import OPEN_CONTACT, Contact, skin
from etd_body.minimal import MinimalBody
from net_witness import NetWitness

BOUND_UC = 10.0
SERIES_OHM = 200.0


@dataclass(frozen=True)
class Scene:
    """So many electrodes, of which the first are stimulated; what these, the silent ones and the
    last one have, and what the last one gets while they are.
    """

    electrodes: int
    stimulated: int
    own_ohm: float
    silent_ohm: float
    last_ohm: float
    then_ohm: float
    capacitance_nf: float


SCENES = {
    "one return conducts best": Scene(64, 20, 10e3, 50e3, 2e3, 2e3, 2.0),
    "of 8 one is pressed": Scene(8, 4, 10e3, 20e3, 20e3, 2e3, 0.5),
    "of 16 one is pressed": Scene(16, 7, 10e3, 20e3, 20e3, 2e3, 0.5),
    "of 64 one is pressed": Scene(64, 20, 20e3, 20e3, 20e3, 2e3, 1.0),
    "of few silent ones one is pressed": Scene(64, 60, 20e3, 20e3, 20e3, 2e3, 1.0),
    "one is pressed hard in scans of 13 uC": Scene(64, 40, 5e3, 100e3, 100e3, 1e3, 0.5),
    "of 64 one is touched": Scene(64, 20, 10e3, 20e3, math.inf, 2e3, 0.1),
}


def contact(ohm: float, capacitance_nf: float) -> Contact:
    if ohm == math.inf:
        return OPEN_CONTACT
    return skin(SERIES_OHM, ohm - SERIES_OHM, capacitance_nf)


def stimulate(rig: EngineRig, scene: Scene, milliseconds: int, **fields: object) -> int:
    """The first electrodes, renewed as a client does; how often it was refused."""
    silent = scene.electrodes - scene.stimulated
    current_ua, refused = (2_000,) * scene.stimulated + (0,) * silent, 0
    for _ in range(milliseconds // 50):
        answer = rig.show(current_ua=current_ua, ttl_ms=300, allow_slower=True, **fields)
        refused += answer.error is not None
        rig.run_ms(50)
    return refused


@pytest.mark.parametrize("after_ms", [1_000, 1_450])
@pytest.mark.parametrize("name", SCENES)
def test_no_return_has_more_than_its_bound(name: str, after_ms: int) -> None:
    """The last poll of it was some time before, and another one each time."""
    scene = SCENES[name]
    loaded = config(electrodes=scene.electrodes)
    source = loaded.board.source
    contacts = [contact(scene.own_ohm, scene.capacitance_nf)] * scene.stimulated
    contacts += [contact(scene.silent_ohm, scene.capacitance_nf)] * (
        scene.electrodes - scene.stimulated - 1
    )
    contacts.append(contact(scene.last_ohm, scene.capacitance_nf))
    body = MinimalBody(tuple(contacts), leak_ohm=source.leak_ohm, compliance_v=source.compliance_v)
    with closing(engine_rig.make(loaded=loaded, body=body)) as rig:
        witness = NetWitness(body)
        rig.meanwhile = witness.look
        fully_open(rig)
        # The soft start is over, and nothing is left of it.
        assert not stimulate(rig, scene, after_ms, polarity="biphasic", width_us=50, rate_hz=10.0)
        now_ns = rig.clock.now_ns()
        body.touch(now_ns, scene.electrodes - 1, contact(scene.then_ohm, scene.capacitance_nf))
        witness.most_uc = 0.0
        stimulate(rig, scene, 1_200, polarity="anodic", width_us=165, rate_hz=60.0)
    assert 0.2 * BOUND_UC < witness.most_uc <= BOUND_UC
