"""An engine of whose pulses a person says how strong they are.

Owns: the lease, the calibration and the frames of such a scene, and what its electrode 4 gets. Must
not know: what is expected of it.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import msgspec

from engine_rig import LEASE, EngineRig
from engine_scenes import calibration, exponent, open_calibrated, opened_to, phases
from etd.files.configuration import fake_config
from etd.protocol.adaptation import MeasuredAdaptation
from etd.protocol.calibration import ElectrodeLimits
from etd.protocol.link import Answer, SayFelt

MakeRig = Callable[..., EngineRig]
N = 16
CAP_UA = 3_000
#: Who feels less in use, as their calibration says.
ADAPTS = MeasuredAdaptation(
    answers=20, weaker=16, stronger=1, use_s=600.0, date=datetime.date(2025, 1, 15)
)


def ready(
    rig: EngineRig,
    cap_ua: int = CAP_UA,
    adaptation: MeasuredAdaptation | None = None,
    comfortable_ua: int = 2_000,
) -> EngineRig:
    """Armed for a calibrated person: threshold at 1000 uA."""
    made = calibration(rig, [cap_ua] * N)
    limits = ElectrodeLimits(threshold_ua=1_000, comfortable_ua=comfortable_ua, cap_ua=cap_ua)
    made = msgspec.structs.replace(
        made, electrode=(limits,) * N, exponent=exponent(1.05), adaptation=adaptation
    )
    assert open_calibrated(rig, made).error is None
    rig.arm()
    opened_to(rig, max(cap_ua, CAP_UA))
    return rig


def felt_rig(
    make_rig: MakeRig,
    cap_ua: int = CAP_UA,
    *,
    may_raise: bool = False,
    adaptation: MeasuredAdaptation | None = ADAPTS,
    comfortable_ua: int = 2_000,
) -> EngineRig:
    """Its electrode 4 at a middle level for some seconds. `may_raise`: as the body site has it."""
    loaded = fake_config(electrodes=N)
    site = msgspec.structs.replace(loaded.body_site, felt_may_raise=may_raise)
    made = make_rig(loaded=replace(loaded, body_site=site))
    rig = ready(made, cap_ua, adaptation, comfortable_ua)
    hold(rig, 2_000)
    return rig


def hold(rig: EngineRig, duration_ms: float, level: float = 0.5, rate_hz: float = 20.0) -> None:
    rig.hold(duration_ms, level=only_level(level), rate_hz=rate_hz, ttl_ms=1_000)


def only_level(level: float) -> tuple[float, ...]:
    return tuple(level if electrode == 4 else 0.0 for electrode in range(N))


def say(rig: EngineRig, answer: str, lease: str | None = LEASE, **about: Any) -> Answer:
    return rig.ask(SayFelt, answer=answer, lease=lease, **about)


def of_four(rig: EngineRig) -> list[float]:
    return [phase.current_ua for phase in phases(rig) if phase.electrode == 4]


def last_ua(rig: EngineRig) -> float:
    return of_four(rig)[-1]


def done(answer: Answer) -> tuple[str, str]:
    assert answer.felt is not None, answer.reason
    return answer.felt.did, answer.felt.reason
