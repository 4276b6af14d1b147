"""The scenes that are recorded: boards, polarities, shapes, laws, frames, faults, stops, stories.

Owns: which scenes there are, each under a name of its own. Must not know: what comes of a scene.
"""

from __future__ import annotations

import dataclasses
import random
from collections.abc import Callable, Iterator
from functools import partial

import msgspec

from bench.steady_laws import LAWS
from engine_scenes import calibration
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.calibration import Calibration
from etd.protocol.frame import Polarity, Ring
from etd.stabilize.settings import NO_STABILIZERS, Settings
from etd_body.course import BUSY
from etd_body.living import LivingBody
from etd_hal.fake.faults import (
    AdcNoise,
    AdcScale,
    AdcStuck,
    AlsoSwitches,
    Bridge,
    DacGain,
    DacOffset,
    DacStuck,
    Fault,
    HeartbeatIgnored,
    I2cFailure,
    LatchIgnored,
    LostClock,
    MisoStuck,
    RailOff,
    Saturation,
    SlowWords,
    SpiError,
    SpiJitter,
    SpiShort,
    SpiStall,
    StuckLine,
    SwitchOutput,
)
from scenes.stage import Stage

Plot = Callable[[Stage], None]

BOARDS = ("reference-hv507", "kajimoto-hv507", "etactilekit-hv513-x2", "feetthrough-relay")
#: One of each way of switching.
TWO_BOARDS = ("reference-hv507", "feetthrough-relay")
POLARITIES: tuple[Polarity, ...] = ("anodic", "cathodic", "biphasic", "biphasic_cathodic_first")
COUNT = 16
_CAP_UA = 1_500
#: Of the reference board's rail monitor.
_MONITOR = 0x48
_STORIES = 12

FAULTS: dict[str, Fault] = {
    "spi-error-first": SpiError(at_message=2, at_transfer=0),
    "spi-error-mid": SpiError(at_message=1, at_transfer=3),
    "spi-timeout": SpiError(at_message=1, at_transfer=1, kind="timeout"),
    "spi-stall-short": SpiStall(stall_us=200),
    "spi-stall-long": SpiStall(stall_us=3_000),
    "spi-short": SpiShort(),
    "slow-words": SlowWords(extra_us=3),
    "spi-jitter": SpiJitter(every=7, late_us=40),
    "miso-high": MisoStuck(1),
    "miso-low": MisoStuck(0),
    "adc-stuck": AdcStuck(900),
    "adc-scale": AdcScale(0.7),
    "adc-noise": AdcNoise(sigma=1.0, seed=3),
    "dac-gain": DacGain(1.4),
    "dac-offset": DacOffset(400.0),
    "dac-stuck": DacStuck(200),
    "saturation": Saturation(900.0),
    "lost-clock": LostClock(at_edge=5),
    "latch-ignored": LatchIgnored(at_edge=3),
    "line-stuck": StuckLine("BL", 1),
    "rail-low": RailOff(0.7),
    "i2c-dead": I2cFailure(_MONITOR, "timeout"),
    "beats-ignored": HeartbeatIgnored(),
    "output-dead": SwitchOutput(output=2, side="open"),
    "outputs-together": AlsoSwitches(output=1, also=4),
    "bridge": Bridge(1, 2),
}


def plots() -> Iterator[tuple[str, Callable[[], Stage], Plot]]:
    """(name, how its stage is made, what happens there) of each scene."""
    for board in BOARDS:
        stage = partial(Stage, _loaded(board))
        for polarity in POLARITIES:
            yield f"polarity-{board}-{polarity}", stage, partial(_polarity, polarity=polarity)
        yield f"frames-{board}", stage, _frames
        yield f"rates-{board}", stage, _rates
        yield f"ways-down-{board}", stage, _ways_down
        yield f"refusals-{board}", stage, _refusals
        yield f"contacts-{board}", stage, _contacts
    for board in TWO_BOARDS:
        for name, fault in FAULTS.items():
            stage = partial(Stage, _loaded(board))
            yield f"fault-{board}-{name}", stage, partial(_fault, fault=fault)
        for law, settings in LAWS.items():
            yield f"law-{board}-{law.replace(' ', '')}", partial(_finger, board, settings), _levels
        for seed in range(_STORIES):
            stage = partial(_finger, board, random.Random(seed).choice(list(LAWS.values())))
            yield f"story-{board}-{seed}", stage, partial(_story, seed=seed)
    for seed in range(6):
        stage = partial(Stage, _loaded("reference-hv507"))
        yield f"press-{seed}", stage, partial(_press, after_us=137 * seed + 11)
    yield "returns-relay", partial(Stage, _loaded("feetthrough-relay")), _returns
    yield "wide-array", partial(Stage, fake_config(board="etactilekit-hv513-x8")), _wide


def _loaded(board: str, settings: Settings = NO_STABILIZERS) -> LoadedConfig:
    loaded = fake_config(board=board, electrodes=COUNT)
    site = msgspec.structs.replace(loaded.body_site, stabilize=settings)
    return dataclasses.replace(loaded, body_site=site)


def _finger(board: str, settings: Settings) -> Stage:
    """A living one, that moves and sweats."""
    loaded = _loaded(board, settings)
    source = loaded.board.source
    body = LivingBody(
        list(zip(loaded.array.x_mm, loaded.array.y_mm, strict=True)),
        leak_ohm=source.leak_ohm,
        compliance_v=source.compliance_v,
        seed=11,
        script=BUSY,
    )
    return Stage(loaded, body)


def _calibration(stage: Stage, cap_ua: int = _CAP_UA) -> Calibration:
    shape = stage.rig.engine.components.loaded.body_site.stabilize.shape
    made = calibration(
        stage.rig, [cap_ua + 10 * electrode for electrode in range(stage.count)], shape=shape
    )
    electrode = tuple(
        msgspec.structs.replace(limits, resistance_ohm=20_000 + 500 * index)
        for index, limits in enumerate(made.electrode)
    )
    return msgspec.structs.replace(made, electrode=electrode, rate_hz=20.0)


def _every(count: int, current_ua: int, step: int = 1) -> tuple[int, ...]:
    return tuple(current_ua if electrode % step == 0 else 0 for electrode in range(count))


def _polarity(stage: Stage, polarity: Polarity) -> None:
    stage.ready()
    half = _every(stage.count, 900, step=2)
    stage.hold(300, current_ua=half, width_us=100, polarity=polarity, rate_hz=10.0)
    mixed = tuple(POLARITIES[electrode % 4] for electrode in range(stage.count))
    stage.hold(150, current_ua=half, width_us=60, polarity=mixed, rate_hz=10.0)
    stage.run(300)


def _frames(stage: Stage) -> None:
    """One after another, under way, expiring, of few pulses, with marks."""
    stage.ready(calibration=_calibration(stage))
    levels = tuple(electrode / stage.count for electrode in range(stage.count))
    stage.hold(400, level=levels)
    stage.show(level=levels, pulses=3, tag=4, sync=True)
    stage.mark(9)
    stage.run(250)
    for number in range(6):
        stage.send(current_ua=_every(stage.count, 300 + 150 * number), ttl_ms=400, rate_hz=5.0)
        stage.run(17)
    stage.show(current_ua=_every(stage.count, 0))
    stage.run(120)
    stage.show(current_ua=_every(stage.count, 1_600), strict=True)
    stage.show(current_ua=_every(stage.count, 1_600), ttl_ms=100)
    stage.run(250)
    stage.stall(120)
    stage.show(level=levels)
    stage.stall(300)
    stage.run(100)


def _rates(stage: Stage) -> None:
    stage.ready()
    each_hz = tuple(2.0 + electrode for electrode in range(stage.count))
    currents_ua = tuple(100 + 60 * electrode for electrode in range(stage.count))
    stage.hold(600, current_ua=currents_ua, rate_hz=each_hz)
    few = tuple(500 if electrode < 2 else 0 for electrode in range(stage.count))
    stage.hold(300, current_ua=few, rate_hz=110.0)
    stage.show(current_ua=currents_ua, rate_hz=120.0)
    stage.show(current_ua=currents_ua, rate_hz=100.0, allow_slower=True)
    stage.run(250)


def _ways_down(stage: Stage) -> None:
    """Disarmed, closed, lapsed, stopped, cleared, and up again."""
    stage.ready()
    active = _every(stage.count, 400, step=3)
    stage.hold(120, current_ua=active)
    stage.disarm()
    stage.measure()
    stage.arm()
    stage.hold(120, current_ua=active)
    stage.stop()
    stage.show(current_ua=active)
    stage.arm()
    stage.clear()
    stage.ready()
    stage.hold(120, current_ua=active)
    stage.close_lease()
    stage.ready()
    stage.hold(60, current_ua=active)
    stage.run(1_300)
    stage.ready()
    stage.hold(60, current_ua=active)
    stage.silence_gateway()
    stage.run(500)


def _refusals(stage: Stage) -> None:
    stage.show(current_ua=_every(stage.count, 100))
    stage.arm()
    stage.open()
    stage.open()
    stage.show(current_ua=_every(stage.count, 100))
    stage.arm()
    stage.show(level=_every(stage.count, 1))
    stage.show(current_ua=_every(stage.count, 9_000))
    stage.show(current_ua=_every(stage.count, 3_000), width_us=200)
    stage.show(current_ua=_every(stage.count, 100), returns=Ring(ring_mm=3.0))
    stage.show(current_ua=_every(stage.count, 100), ttl_ms=100, sent_ns=1)
    stage.show(current_ua=_every(stage.count, 2_500), rate_hz=100.0)
    stage.clear()
    stage.run(50)


def _contacts(stage: Stage) -> None:
    """Lifted and touched again, one and several, beside small caps."""
    calibrated = _calibration(stage)
    small = msgspec.structs.replace(calibrated.electrode[3], cap_ua=60, comfortable_ua=50)
    small = msgspec.structs.replace(small, threshold_ua=30)
    electrode = (*calibrated.electrode[:3], small, *calibrated.electrode[4:])
    stage.ready(calibration=msgspec.structs.replace(calibrated, electrode=electrode))
    active = tuple(600 if electrode in (1, 5, 6) else 0 for electrode in range(stage.count))
    stage.hold(300, current_ua=active, rate_hz=30.0)
    stage.lift(5)
    stage.hold(120, current_ua=active, rate_hz=30.0)
    stage.touch(5)
    stage.hold(200, current_ua=active, rate_hz=30.0)
    for electrode_number in range(8):
        stage.lift(electrode_number)
    stage.hold(200, current_ua=active, rate_hz=30.0)


def _fault(stage: Stage, fault: Fault) -> None:
    """It comes while pulses are fired, and is mended later."""
    stage.ready()
    active = _every(stage.count, 800, step=2)
    stage.hold(250, current_ua=active, rate_hz=20.0, polarity="biphasic")
    stage.put_in(fault)
    stage.hold(300, current_ua=active, rate_hz=20.0, polarity="biphasic")
    stage.take_out(fault)
    stage.clear()
    stage.ready()
    stage.hold(100, current_ua=active, rate_hz=20.0)


def _levels(stage: Stage) -> None:
    stage.ready(calibration=_calibration(stage, cap_ua=2_500))
    levels = tuple((electrode + 1) / (2 * stage.count) for electrode in range(stage.count))
    stage.hold(900, level=levels, rate_hz=20.0)
    stage.stall(60)
    louder = tuple(min(1.0, 1.5 * level) for level in levels)
    stage.hold(300, level=louder, rate_hz=20.0)
    stage.hold(200, current_ua=_every(stage.count, 500), rate_hz=10.0, width_us=100)


def _press(stage: Stage, after_us: int) -> None:
    stage.ready()
    active = _every(stage.count, 500)
    stage.hold(200, current_ua=active, polarity="biphasic", rate_hz=20.0)
    stage.at(after_us, lambda: stage.press("emergency_stop"))
    stage.hold(100, current_ua=active, polarity="biphasic", rate_hz=20.0)
    stage.release("emergency_stop")
    stage.clear()
    stage.run(50)


def _returns(stage: Stage) -> None:
    stage.ready(calibration=_calibration(stage))
    active = _every(stage.count, 700, step=5)
    stage.hold(300, current_ua=active, rate_hz=4.0, ttl_ms=600)
    lists = tuple(
        ((electrode + 1) % stage.count, (electrode + 2) % stage.count)
        for electrode in range(stage.count)
    )
    stage.hold(400, current_ua=active, rate_hz=4.0, returns=lists, ttl_ms=600)
    stage.hold(400, current_ua=active, rate_hz=4.0, returns=Ring(ring_mm=2.5), ttl_ms=600)


def _wide(stage: Stage) -> None:
    stage.ready()
    stage.hold(600, current_ua=_every(stage.count, 400, step=4), rate_hz=5.0, ttl_ms=600)
    stage.show(current_ua=_every(stage.count, 200), rate_hz=3.0, ttl_ms=900)
    stage.run(120)
    stage.show(current_ua=_every(stage.count, 100, step=2), rate_hz=3.0, ttl_ms=900)
    stage.run(400)


def _story(stage: Stage, seed: int) -> None:
    """Whatever chance draws, the same for one seed."""
    draw = random.Random(seed)
    stage.ready(calibration=_calibration(stage, cap_ua=draw.choice((400, 1_500, 2_500))))
    for _ in range(14):
        draw.choice(_VERBS)(stage, draw)


def _draw_frame(stage: Stage, draw: random.Random) -> None:
    currents_ua = tuple(draw.choice((0, 0, 200, 700, 1_400)) for _ in range(stage.count))
    fields = {
        "current_ua": currents_ua,
        "rate_hz": draw.choice((3.0, 10.0, 30.0)),
        "width_us": draw.choice((40, 100, 160)),
        "polarity": draw.choice(POLARITIES),
        "pulses": draw.choice((None, None, 2)),
        "ttl_ms": draw.choice((60, 200, 700)),
        "allow_slower": True,
    }
    for _ in range(draw.randint(1, 5)):
        stage.show(**fields)
        stage.run(draw.randint(5, 120))


def _draw_levels(stage: Stage, draw: random.Random) -> None:
    levels = tuple(draw.choice((0.0, 0.3, 0.9)) for _ in range(stage.count))
    for _ in range(draw.randint(1, 5)):
        stage.show(level=levels, allow_slower=True)
        stage.run(draw.randint(5, 120))


def _draw_contact(stage: Stage, draw: random.Random) -> None:
    electrode = draw.randrange(stage.count)
    stage.lift(electrode)
    _draw_frame(stage, draw)
    stage.touch(electrode)


def _draw_stop(stage: Stage, draw: random.Random) -> None:
    delay_us = draw.randint(0, 90_000)
    stage.at(delay_us, lambda: stage.press("emergency_stop"))
    _draw_levels(stage, draw)
    stage.run(90)
    stage.release("emergency_stop")
    stage.clear()
    stage.close_lease()
    stage.ready(calibration=_calibration(stage))


def _draw_stall(stage: Stage, draw: random.Random) -> None:
    stage.stall(draw.choice((5, 60, 240, 1_100)))
    stage.keep()


def _draw_disarm(stage: Stage, draw: random.Random) -> None:
    stage.disarm()
    stage.run(draw.randint(1, 30))
    stage.arm()


_VERBS: tuple[Callable[[Stage, random.Random], None], ...] = (
    _draw_frame,
    _draw_frame,
    _draw_levels,
    _draw_levels,
    _draw_contact,
    _draw_stop,
    _draw_stall,
    _draw_disarm,
)
