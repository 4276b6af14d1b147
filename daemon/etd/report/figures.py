"""The figures of the report, from a configuration.

Owns: how each is calculated. Must not know: how it is shown, a running daemon.

The list follows what the FDA asks to characterise for a transcutaneous stimulator (21 CFR
882.5888): voltage and current at 500 ohm, 2 k and 10 k, charge, current density, average current
and power density. All are the most that the maxima allow, on one electrode.
"""

from __future__ import annotations

import math
from typing import Final

import msgspec

from etd.files.configuration import LoadedConfig
from etd.report.worst_cases import ROWS, charge_uc
from etd.safety.maxima import Maxima, maxima_of
from etd.version import __version__

LOADS_OHM: Final = (500, 2_000, 10_000)


class AtLoad(msgspec.Struct, frozen=True, kw_only=True):
    """The strongest pulse into a resistor, and the most average power at the mean's bound."""

    resistance_ohm: int
    current_ua: int
    voltage_v: float
    width_us: float
    energy_uj: float
    power_mw: float
    power_density_mw_cm2: float


class WorstCase(msgspec.Struct, frozen=True, kw_only=True):
    """`present`: whether this board has the guard; None for what no board file names."""

    what: str
    present: bool | None
    acts_within_s: float | None
    charge_uc: float


class Figures(msgspec.Struct, frozen=True, kw_only=True):
    version: str
    source: str
    board: str
    machine: str
    backend: str
    digests: dict[str, str]
    selftest: str
    body_site: str
    array: str
    electrodes: int
    diameter_mm: float
    pitch_mm: float
    area_cm2: float
    present_guards: tuple[str, ...]
    absent_guards: tuple[str, ...]
    compliance_v: int
    current_ua: int
    uncalibrated_current_ua: int
    width_us: int
    charge_nc: float
    rate_hz: int
    mean_current_ua: int
    array_mean_current_ua: int
    charge_density_uc_cm2: float
    current_density_ma_cm2: float
    mean_current_density_ma_cm2: float
    at_loads: tuple[AtLoad, ...]
    worst_cases: tuple[WorstCase, ...]


def figures_of(loaded: LoadedConfig, selftest: str) -> Figures:
    """`selftest`: the last one of this board, in a sentence."""
    board, array = loaded.board, loaded.array
    maxima = maxima_of(board, loaded.body_site)
    area_cm2 = math.pi * (array.diameter_mm / 20) ** 2
    charge_nc = maxima.charge_pc / 1_000
    full_scale_ua = board.source.full_scale_ua
    return Figures(
        version=__version__,
        source=loaded.source,
        board=board.name,
        machine=loaded.machine.name,
        backend=loaded.config.backend,
        digests=loaded.digests,
        selftest=selftest,
        body_site=loaded.body_site.name,
        array=array.name,
        electrodes=array.count,
        diameter_mm=array.diameter_mm,
        pitch_mm=_pitch_mm(array.x_mm, array.y_mm),
        area_cm2=area_cm2,
        present_guards=board.present_guards,
        absent_guards=board.absent_guards,
        compliance_v=board.source.compliance_v,
        current_ua=maxima.current_ua,
        uncalibrated_current_ua=maxima.uncalibrated_current_ua,
        width_us=maxima.width_us,
        charge_nc=charge_nc,
        rate_hz=maxima.rate_hz,
        mean_current_ua=maxima.mean_current_ua,
        array_mean_current_ua=maxima.array_mean_current_ua,
        charge_density_uc_cm2=charge_nc / 1_000 / area_cm2,
        current_density_ma_cm2=maxima.current_ua / 1_000 / area_cm2,
        mean_current_density_ma_cm2=maxima.mean_current_ua / 1_000 / area_cm2,
        at_loads=tuple(_at(ohm, maxima, board.source.compliance_v, area_cm2) for ohm in LOADS_OHM),
        worst_cases=tuple(
            WorstCase(
                what=row.what,
                present=None if not row.guard else row.guard in board.present_guards,
                acts_within_s=row.acts_s,
                charge_uc=charge_uc(row, full_scale_ua),
            )
            for row in ROWS
        ),
    )


def _at(resistance_ohm: int, maxima: Maxima, compliance_v: int, area_cm2: float) -> AtLoad:
    """The strongest current is the one of the most energy: a charge's energy rises with it."""
    current_ua = min(maxima.current_ua, int(compliance_v * 1e6 / resistance_ohm))
    width_us = min(float(maxima.width_us), maxima.charge_pc / current_ua)
    voltage_v = current_ua * 1e-6 * resistance_ohm
    charge_nc = current_ua * width_us / 1_000
    mean_ua = min(float(maxima.mean_current_ua), charge_nc * maxima.rate_hz / 1_000)
    power_mw = voltage_v * mean_ua / 1_000
    return AtLoad(
        resistance_ohm=resistance_ohm,
        current_ua=current_ua,
        voltage_v=voltage_v,
        width_us=width_us,
        energy_uj=voltage_v * charge_nc / 1_000,
        power_mw=power_mw,
        power_density_mw_cm2=power_mw / area_cm2,
    )


def _pitch_mm(x_mm: tuple[float, ...], y_mm: tuple[float, ...]) -> float:
    """The smallest distance between two electrodes; 0 for one."""
    places = list(zip(x_mm, y_mm, strict=True))
    return min(
        (math.dist(one, other) for at, one in enumerate(places) for other in places[:at]),
        default=0.0,
    )
