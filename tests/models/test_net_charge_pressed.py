"""No electrode has more net charge than its site allows where a silent return is nearly a short
circuit, or is pressed harder and harder, or is named: by the body's own account.

Owns: these scenes. Must not know: how the engine counts it. `test_net_charge_changes.py` has
contacts that change once.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from itertools import repeat

import pytest

import engine_rig
from engine_rig import EngineRig
from engine_scenes import config, opened_to
from etd.files.configuration import LoadedConfig
from etd_body.electrode import Contact, load, skin
from etd_body.minimal import MinimalBody
from net_witness import NetWitness

SERIES_OHM = 200.0


@dataclass(frozen=True)
class Scene:
    """So many electrodes of the same skin, of which the first are stimulated so, and a last one
    beside them.
    """

    electrodes: int
    stimulated: int
    own_ohm: float
    current_ua: int
    width_us: int
    rate_hz: float
    capacitance_nf: float = 0.1
    silent_ohm: float | None = None
    bound_nc: int = 10_000

    def contact(self, ohm: float) -> Contact:
        return skin(SERIES_OHM, ohm - SERIES_OHM, self.capacitance_nf)

    @property
    def contacts(self) -> list[Contact]:
        silent = self.contact(self.silent_ohm or self.own_ohm)
        own = [self.contact(self.own_ohm)] * self.stimulated
        return own + [silent] * (self.electrodes - self.stimulated - 1)

    @property
    def currents_ua(self) -> tuple[int, ...]:
        silent = self.electrodes - self.stimulated
        return (self.current_ua,) * self.stimulated + (0,) * silent


def most_uc(scene: Scene, last_ohm: Iterator[float], milliseconds: int) -> float:
    """Renewed each 25 ms, when the last contact becomes the next of these."""
    loaded = config(electrodes=scene.electrodes, maxima={"net_charge_nc": scene.bound_nc})
    contacts = [*scene.contacts, scene.contact(next(last_ohm))]
    with witnessed(loaded, contacts) as (rig, witness):
        for _ in range(milliseconds // 25):
            rig.fake.world.touch(scene.electrodes - 1, scene.contact(next(last_ohm)))
            rig.show(
                current_ua=scene.currents_ua,
                polarity="anodic",
                width_us=scene.width_us,
                rate_hz=scene.rate_hz,
                ttl_ms=300,
                allow_slower=True,
            )
            rig.run_ms(25)
        return witness.most_uc


@contextmanager
def witnessed(
    loaded: LoadedConfig, contacts: Sequence[Contact]
) -> Iterator[tuple[EngineRig, NetWitness]]:
    """Armed on this skin, the soft start over."""
    source = loaded.board.source
    body = MinimalBody(tuple(contacts), leak_ohm=source.leak_ohm, compliance_v=source.compliance_v)
    with closing(engine_rig.make(loaded=loaded, body=body, is_traced=False)) as rig:
        witness = NetWitness(body)
        rig.meanwhile = witness.look
        rig.open(3_000, 200)
        rig.arm()
        opened_to(rig, 3_000)
        yield rig, witness


@pytest.mark.parametrize(
    "scene",
    [
        Scene(64, 60, 20e3, 1_500, 165, 30.0),
        Scene(64, 60, 20e3, 1_000, 100, 60.0),
        Scene(16, 15, 10e3, 2_500, 165, 50.0),
        Scene(8, 7, 10e3, 2_500, 165, 60.0),
    ],
)
def test_a_return_that_the_others_do_not_bound_carries_all(scene: Scene) -> None:
    """Of 300 ohm: its path resists no more than its way back may."""
    assert most_uc(scene, repeat(300.0), 2_500) <= scene.bound_nc / 1e3


@pytest.mark.parametrize(
    ("scene", "to_ohm", "times"),
    [
        (Scene(64, 60, 10e3, 3_000, 100, 40.0, 0.1, 100e3), 700.0, 0.8),
        (Scene(32, 28, 10e3, 2_000, 165, 40.0, 0.5, 50e3), 1_000.0, 0.8),
        (Scene(64, 60, 20e3, 1_500, 165, 30.0, 0.1, 50e3, 15_000), 700.0, 0.6),
    ],
)
def test_a_return_that_is_pressed_harder_and_harder_keeps_it(
    scene: Scene, to_ohm: float, times: float
) -> None:
    """It is read again and again, and each time it conducts better."""
    most = most_uc(scene, pressed(scene, to_ohm, times), 1_500)
    assert 0.3 * scene.bound_nc / 1e3 < most <= scene.bound_nc / 1e3


def pressed(scene: Scene, to_ohm: float, times: float) -> Iterator[float]:
    """After a third of a second."""
    ohm = scene.silent_ohm or scene.own_ohm
    yield from repeat(ohm, 13)
    while True:
        ohm = max(to_ohm, ohm * times)
        yield ohm


@pytest.mark.parametrize("polarity", ["anodic", "cathodic"])
@pytest.mark.parametrize("best_ohm", [2e3, 5e3, 100e3])
def test_a_named_return_keeps_it_however_it_conducts(best_ohm: float, polarity: str) -> None:
    """On relays, which leave all others open. Eight electrodes return through the same eight; what
    these conduct was not measured for longer than a measurement counts.
    """
    named = tuple(range(8, 16))
    contacts = [*[load(20e3)] * 8, load(best_ohm), *[load(100e3)] * 7]
    loaded = config(board="feetthrough-relay", electrodes=16)
    with witnessed(loaded, contacts) as (rig, witness):
        for current_ua in (20, 1_000, 2_000):
            for _ in range(20):
                rig.show(
                    current_ua=(current_ua,) * 8 + (0,) * 8,
                    polarity=polarity,
                    width_us=150,
                    rate_hz=12.0,
                    ttl_ms=300,
                    allow_slower=True,
                    returns=(*[named] * 8, *[(0,)] * 8),
                )
                rig.run_ms(60)
    assert 0.0 < witness.most_uc <= 10.0
