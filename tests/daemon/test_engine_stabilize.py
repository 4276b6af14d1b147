"""Stabilizers of a body-site file, on the wires: what the skin gets when it changes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec
import pytest

from engine_rig import LEASE, EngineRig
from engine_scenes import fully_open, only, phases, scans, unchecked
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.link import DisarmBoard, StopNow
from etd.pulse.request import NO_GAIN, PulseRequest
from etd.stabilize.law_settings import ContactSettings, EnergySettings, PowerLawSettings
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.settings import Settings
from etd_body.electrode import skin
from etd_hal.boardfile import BoardFile
from etd_hal.fake.faults import AdcScale, AdcStuck

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
CURRENT_UA, WIDTH_US = 1_500, 60


def with_laws(**laws: Any) -> LoadedConfig:
    loaded = fake_config(electrodes=N)
    settings = Settings(order=tuple(laws), **laws)  # type: ignore[arg-type]
    return replace(loaded, body_site=msgspec.structs.replace(loaded.body_site, stabilize=settings))


def standing(rig: EngineRig) -> EngineRig:
    """Electrode 4 on well conducting skin, its frame up for a second."""
    rig.fake.world.touch(4, skin(1_000.0, 19_000.0, 0.8))
    fully_open(rig, CURRENT_UA, k=1.05)
    hold(rig, 1_000)
    return rig


def hold(rig: EngineRig, duration_ms: float) -> None:
    rig.hold(duration_ms, current_ua=only(N, e4=CURRENT_UA), width_us=WIDTH_US, rate_hz=50.0)


def last_pulse(rig: EngineRig) -> tuple[float, float]:
    """(current, width) of the last one."""
    last = phases(rig, 0)[-1]
    return last.current_ua, last.width_us


def felt_there_ua(rig: EngineRig, since_ns: int) -> list[float]:
    """The currents of electrode 4; others are looked at."""
    return [phase.current_ua for phase in phases(rig, since_ns) if phase.electrode == 4]


def test_skin_that_takes_less_energy_gets_longer_pulses_within_its_slot(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_laws(energy=EnergySettings(max_widening=1.5))))
    assert last_pulse(rig)[1] == pytest.approx(WIDTH_US, abs=2)
    rig.fake.world.touch(4, skin(500.0, 9_500.0, 1.6))
    hold(rig, 1_500)
    current_ua, width_us = last_pulse(rig)
    assert 1.3 * WIDTH_US < width_us <= 1.5 * WIDTH_US
    assert current_ua <= CURRENT_UA
    told = scans(rig)[-1].fired
    assert told.gain[4] == pytest.approx(current_ua * width_us / (CURRENT_UA * WIDTH_US), rel=0.02)
    assert told.gain[5] is None, "nothing was wanted there"


def test_skin_that_takes_more_energy_gets_shorter_pulses(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_laws(energy=EnergySettings())))
    rig.fake.world.touch(4, skin(2_000.0, 48_000.0, 0.3))
    hold(rig, 200)
    assert last_pulse(rig)[1] < 0.85 * WIDTH_US


def test_skin_that_resists_a_little_more_gets_less_in_full_with_the_next_pulse(
    make_rig: MakeRig,
) -> None:
    """No mean over pulses delays a fall, however fast they come."""
    rig = standing(make_rig(loaded=with_laws(power_law=PowerLawSettings())))
    frame = {"current_ua": only(N, e4=CURRENT_UA), "width_us": WIDTH_US, "rate_hz": 100.0}
    rig.hold(300, **frame)
    begun_ns = rig.clock.now_ns()
    rig.fake.world.touch(4, skin(1_000.0, 23_000.0, 0.8))
    rig.hold(300, **frame)
    charge_pc = [phase.charge_pc for phase in phases(rig, begun_ns)]
    assert charge_pc[1] < 0.87 * charge_pc[0]
    assert charge_pc[1] <= 1.01 * charge_pc[-1]


def test_the_plan_makes_room_for_the_widest_that_may_be_asked(make_rig: MakeRig) -> None:
    frame = {"current_ua": (300,) * N, "width_us": 100, "rate_hz": 110.0}
    plain = make_rig(loaded=with_laws())
    plain.open()
    plain.arm()
    assert plain.show(**frame).error is None
    wider = make_rig(loaded=with_laws(energy=EnergySettings(max_widening=2.0)))
    wider.open()
    wider.arm()
    assert wider.show(**(frame | {"rate_hz": 120.0})).error is None
    many = make_rig(
        loaded=replace(with_laws(energy=EnergySettings(max_widening=2.0)), board=_resting(400))
    )
    many.open()
    many.arm()
    answer = many.show(**frame)
    assert answer.error == "too_fast"
    assert "the widest pulses of the stabilizers included" in answer.reason


def _resting(rest_us: int) -> BoardFile:
    return msgspec.structs.replace(fake_config(electrodes=N).board, rest_us=rest_us)


def test_an_adc_that_goes_wrong_gives_the_frames_own_pulse_and_is_counted_once(
    make_rig: MakeRig,
) -> None:
    rig = standing(make_rig(loaded=unchecked(with_laws(energy=EnergySettings()))))
    rig.fake.world.touch(4, skin(2_000.0, 48_000.0, 0.3))
    hold(rig, 300)
    rig.fake.world.put_in(AdcScale(0.01))
    hold(rig, 2_000)
    current_ua, width_us = last_pulse(rig)
    assert width_us == pytest.approx(WIDTH_US, abs=2)
    assert current_ua <= CURRENT_UA
    assert rig.engine.components.reporter.counters["rejected_implausible"] == 1


@pytest.mark.parametrize("volts", [0.1, 0.2, 1.0, 3.0, 4.9])
@pytest.mark.parametrize("laws", [{"power_law": PowerLawSettings()}, {"energy": EnergySettings()}])
@pytest.mark.parametrize("commanded_ua", [500, CURRENT_UA])
def test_an_adc_that_stands_still_gives_the_frames_own_pulse_and_is_counted_once(
    make_rig: MakeRig, laws: dict[str, Any], volts: float, commanded_ua: int
) -> None:
    rig = standing(make_rig(loaded=unchecked(with_laws(**laws))))
    frame = {"current_ua": only(N, e4=commanded_ua), "width_us": WIDTH_US, "rate_hz": 50.0}
    rig.hold(300, **frame)
    node_v = fake_config(electrodes=N).board.source.node_uv_per_code / 1e6
    fault = AdcStuck(round(volts / node_v))
    rig.fake.world.put_in(fault)
    since_ns = rig.clock.now_ns()
    rig.hold(600, **frame)
    rig.fake.world.take_out(fault)
    # The first one is what is asked before anybody can know.
    fired = phases(rig, since_ns)[1:]
    assert max(phase.current_ua for phase in fired) <= commanded_ua
    assert fired[-1].width_us == pytest.approx(WIDTH_US, abs=2)
    assert max(phase.width_us for phase in fired) <= WIDTH_US + 2
    counters = rig.engine.components.reporter.counters
    told = {name: count for name, count in counters.items() if name.startswith("rejected")}
    assert told == {"rejected_adc": 1}


def test_a_contact_made_anew_rises_from_half_and_never_above_what_is_wanted(
    make_rig: MakeRig,
) -> None:
    rig = standing(make_rig(loaded=with_laws(contact=ContactSettings())))
    rig.fake.world.lift(4)
    hold(rig, 300)
    rig.fake.world.touch(4, skin(1_000.0, 19_000.0, 0.8))
    since_ns = rig.clock.now_ns()
    hold(rig, 1_500)
    # The first one tells of the contact; it is no more than a probe.
    felt_ua = felt_there_ua(rig, since_ns)[1:]
    assert felt_ua[:5] == sorted(felt_ua[:5])
    assert felt_ua[2] < 0.5 * CURRENT_UA
    assert felt_ua[-1] == pytest.approx(CURRENT_UA, abs=5)
    assert max(felt_ua) <= CURRENT_UA


def test_peeling_is_answered_with_the_next_pulse(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_laws(contact=ContactSettings())))
    rig.fake.world.touch(4, skin(3_000.0, 57_000.0, 0.25))
    since_ns = rig.clock.now_ns()
    hold(rig, 100)
    felt_ua = felt_there_ua(rig, since_ns)
    assert felt_ua[0] == pytest.approx(CURRENT_UA, abs=5), "nobody can know before it was fired"
    assert felt_ua[1] == pytest.approx(CURRENT_UA / 2, rel=0.1)
    assert scans(rig)[-1].fired.gain[4] == pytest.approx(felt_ua[-1] / CURRENT_UA, rel=0.01)


def test_without_a_law_none_is_told_to_have_given_or_taken(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_laws()))
    assert set(scans(rig)[-1].fired.gain) == {None}


class Counts:
    """A stabilizer that changes nothing."""

    max_gain = NO_GAIN

    def __init__(self) -> None:
        self.resets = 0

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        return request

    def reset(self) -> None:
        self.resets += 1


@pytest.mark.parametrize("end", [DisarmBoard(ref=0, lease=LEASE), StopNow(ref=0, client="test")])
def test_with_the_supply_goes_all_that_was_known_of_the_skin(
    make_rig: MakeRig, end: DisarmBoard | StopNow
) -> None:
    counts = Counts()
    rig = fully_open(make_rig(electrodes=N, stabilizers=[counts]), 500)
    parts, before = rig.engine.components, counts.resets
    assert parts.returns.share.reading(0) is not None
    rig.commands.send(end)
    rig.run_ms(5)
    assert counts.resets > before
    assert parts.returns.share.reading(0) is None
    assert parts.contact.is_touched == [None] * N
