"""A calibration at one width, pulses of another one, and the same skin: no law finds a change."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import msgspec
import pytest

import engine_rig
from engine_rig import EngineRig
from engine_scenes import (
    calibration,
    exponent,
    fully_open,
    only,
    open_calibrated,
    opened_to,
    phases,
    scans,
)
from etd.files.configuration import fake_config
from etd.stabilize.law_settings import EnergySettings, LinearLawSettings, PowerLawSettings
from etd.stabilize.settings import NO_STABILIZERS, Settings
from etd_body.electrode import Contact, skin

N, CURRENT_UA = 16, 1_000
#: In pulses of 100 us it has the charge of the current that is shown, in those of 20 us, too.
CAP_UA = 5_000
#: The assumed time constant, and a slower one.
SKINS = {"usual": skin(2_000.0, 40_000.0, 0.35), "slow": skin(1_000.0, 19_000.0, 0.8)}
LAWS: dict[str, Any] = {
    "power_law": PowerLawSettings(min_width_us=20),
    "energy": EnergySettings(min_width_us=20),
    "linear_law": LinearLawSettings(charge_slope=-0.5, energy_slope=0.2, min_width_us=20),
}


def rig_with(settings: Settings, contact: Contact) -> EngineRig:
    loaded = fake_config(electrodes=N)
    site = msgspec.structs.replace(loaded.body_site, stabilize=settings)
    rig = engine_rig.make(loaded=replace(loaded, body_site=site))
    rig.fake.world.touch(4, contact)
    return rig


def held(rig: EngineRig, duration_ms: float, width_us: int) -> None:
    wanted = only(N, e4=CURRENT_UA)
    rig.hold(duration_ms, current_ua=wanted, width_us=width_us, rate_hz=20.0)


def told_ohm(contact: Contact, width_us: int) -> int:
    """What telemetry tells, and `etd calibrate` keeps."""
    rig = fully_open(rig_with(NO_STABILIZERS, contact), 2_500)
    held(rig, 600, width_us)
    found = [
        scan.fired.skin_ohm[4]
        for scan in scans(rig)
        if scan.fired.current_ua[4] > 0.95 * CURRENT_UA
    ][-1]
    rig.close()
    assert found is not None
    return found


@pytest.mark.parametrize("name", LAWS)
@pytest.mark.parametrize("skin_name", SKINS)
@pytest.mark.parametrize("calibrated_us", [20, 30, 50, 100])
def test_on_the_skin_of_the_calibration_a_law_leaves_every_width_as_it_is(
    name: str, skin_name: str, calibrated_us: int
) -> None:
    contact = SKINS[skin_name]
    rig = rig_with(Settings(order=(name,), **{name: LAWS[name]}), contact)  # type: ignore[arg-type]
    made = calibration(
        rig, (CAP_UA,) * N, width_us=calibrated_us, rate_hz=20.0, exponent=exponent(1.0)
    )
    resistance_ohm = told_ohm(contact, calibrated_us)
    each = [msgspec.structs.replace(limits, comfortable_ua=CURRENT_UA, threshold_ua=500,
                                    resistance_ohm=resistance_ohm)
            for limits in made.electrode]  # fmt: skip
    answer = open_calibrated(rig, msgspec.structs.replace(made, electrode=tuple(each)))
    assert answer.error is None, answer.reason
    rig.arm()
    opened_to(rig, 3_000)
    rig.hold(600, current_ua=only(N, e0=20), rate_hz=20.0)
    found = {}
    for width_us in (20, 100, 30):
        held(rig, 800, width_us)
        last = [phase for phase in phases(rig) if phase.electrode == 4][-1]
        current, width = last.current_ua / CURRENT_UA, last.width_us / width_us
        # Between two steps of the width `energy` keeps the energy, the others the charge.
        found[width_us] = current * width * (current if name == "energy" else 1.0)
    assert rig.close() == ()
    assert found == pytest.approx(dict.fromkeys(found, 1.0), abs=0.06)


def test_short_pulses_under_their_own_calibration_answer_a_change() -> None:
    rig = rig_with(Settings(order=("power_law",), power_law=LAWS["power_law"]), SKINS["slow"])
    made = calibration(rig, (CAP_UA,) * N, width_us=30, rate_hz=20.0, exponent=exponent(1.0))
    resistance_ohm = told_ohm(SKINS["slow"], 30)
    each = [msgspec.structs.replace(limits, comfortable_ua=CURRENT_UA, threshold_ua=500,
                                    resistance_ohm=resistance_ohm)
            for limits in made.electrode]  # fmt: skip
    open_calibrated(rig, msgspec.structs.replace(made, electrode=tuple(each)))
    rig.arm()
    opened_to(rig, 3_000)
    rig.hold(600, current_ua=only(N, e0=20), rate_hz=20.0)
    rig.fake.world.touch(4, skin(1_000.0, 40_000.0, 0.4))
    held(rig, 1_000, 30)
    last = [phase for phase in phases(rig) if phase.electrode == 4][-1]
    assert last.charge_pc < 0.8 * CURRENT_UA * 30
    rig.close()


def test_telemetry_tells_the_capacitance_where_pulses_are_wide_enough() -> None:
    rig = fully_open(rig_with(NO_STABILIZERS, SKINS["usual"]), 2_500)
    found = []
    for width_us in (30, 100):
        held(rig, 300, width_us)
        told = [scan.fired for scan in scans(rig) if scan.fired.current_ua[4] > 0.95 * CURRENT_UA][
            -1
        ]
        found.append(told.capacitance_nf[4])
    rig.close()
    assert found == [None, pytest.approx(0.35, rel=0.2)]
