"""The check of the source over an hour of modelled fingers: no board that is in order ever halts.

The hour is lived in visits: armed for a few seconds, shown frames with and without a gap in both
polarities, disarmed until the next one. In between only the body's time goes on.
"""

from __future__ import annotations

from collections.abc import Callable
from random import Random

import pytest

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import halts
from etd.files.configuration import LoadedConfig, fake_config
from etd.files.resources import names
from etd.protocol.link import ArmBoard, CloseLease
from etd_body.electrode import skin
from etd_hal.boardfile import Relays
from etd_hal.fake.faults import AdcNoise
from etd_hal.fake.fingertip import fingertip_body, living_fingertip
from etd_hal.fake.world import Touchable

N, CURRENT_UA, VISITS, EVERY_S, SHOWN_MS = 8, 1_000, 24, 150, 1_300
POLARITIES = ("anodic", "cathodic", "biphasic", "biphasic_cathodic_first")


def living(loaded: LoadedConfig) -> Touchable:
    return living_fingertip(
        loaded.board, [(spot.x_mm, spot.y_mm) for spot in loaded.array.electrode]
    )


def still(loaded: LoadedConfig) -> Touchable:
    return fingertip_body(loaded.board, N)


def dry(rig: EngineRig, _: Random) -> None:
    for electrode in range(N):
        rig.fake.world.touch(electrode, skin(2_000.0, 500_000.0, 0.3))


def wet(rig: EngineRig, _: Random) -> None:
    for electrode in range(N):
        rig.fake.world.touch(electrode, skin(800.0, 8_000.0, 3.0))


def peeling(rig: EngineRig, chance: Random) -> None:
    for electrode in range(N):
        if chance.random() < 0.5:
            rig.fake.world.lift(electrode)
        else:
            rig.fake.world.touch(electrode, skin(1_000.0, 30_000.0, 1.0))


def as_it_lives(_rig: EngineRig, _: Random) -> None:
    """The body changes by itself."""


BODIES: dict[str, tuple[Callable[[LoadedConfig], Touchable], Callable[[EngineRig, Random], None]]]
BODIES = {
    "dry": (still, dry),
    "wet": (still, wet),
    "peeling": (still, peeling),
    "living": (living, as_it_lives),
}


@pytest.mark.parametrize("name", BODIES)
@pytest.mark.parametrize("board", names("boards"))
def test_no_board_in_order_halts_in_an_hour(board: str, name: str) -> None:
    loaded = fake_config(board=board, electrodes=N)
    body_of, change = BODIES[name]
    rig = engine_rig.make(loaded=loaded, body=body_of(loaded), is_traced=False)
    rig.fake.world.put_in(AdcNoise(1.5))
    begun_ns, chance = rig.clock.now_ns(), Random(1)
    fastest_hz = 4.0 if isinstance(loaded.board.switch, Relays) else 20.0
    for visit in range(VISITS):
        rig.clock.sleep_until_ns(begun_ns + visit * EVERY_S * 1_000_000_000)
        _visit(rig, change, chance, POLARITIES[visit % 4], 2.0 if visit % 3 == 0 else fastest_hz)
        assert halts(rig) == []
    assert rig.clock.now_ns() - begun_ns >= (VISITS - 1) * EVERY_S * 1_000_000_000
    rig.fake.world.mend()
    assert rig.close() == ()


def _visit(
    rig: EngineRig,
    change: Callable[[EngineRig, Random], None],
    chance: Random,
    polarity: str,
    rate_hz: float,
) -> None:
    rig.step()
    if not rig.engine.has_gateway:
        rig.attach_next_gateway()
    rig.open()
    if rig.engine.components.loaded.board.guards.wearer_stop != "absent":
        rig.try_wearer_stop()
    assert rig.ask(ArmBoard).error is None
    until_ns = rig.clock.now_ns() + SHOWN_MS * 1_000_000
    while rig.clock.now_ns() < until_ns and rig.state == "ARMED":
        change(rig, chance)
        rig.send(current_ua=(CURRENT_UA,) * N, rate_hz=rate_hz, polarity=polarity, width_us=100)
        rig.run_ms(100)
    rig.ask(CloseLease, lease=LEASE)
