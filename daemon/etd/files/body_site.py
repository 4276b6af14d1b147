"""What a place on the body may get, whoever it belongs to.

Owns: the body-site file: maxima that hold for everybody there, the defaults of a frame, what tells
contact from none, and which stabilizers ask there.
Must not know: a person's limits, boards, states.

All maxima are required: a missing limit is a refusal, never a default. No file passes the hard
ceilings (`etd_hal.ceilings`).
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from etd.protocol.frame import Polarity
from etd.stabilize.settings import NO_STABILIZERS, Settings, check_settings
from etd_hal import ceilings
from etd_hal.errors import FileError
from etd_hal.names import PlainName
from etd_hal.tomlfile import Strict, load_toml

#: Shannon's line, log D = k - log Q, at this k. It comes from implanted electrodes, and nobody has
#: validated it on skin: a yardstick for the size of a charge, not evidence that it is harmless.
YARDSTICK_K = 1.5


class SiteMaxima(Strict, frozen=True):
    """What nobody gets more of at this place. What asks for more is refused as a whole."""

    #: Without a calibration, whatever limits the client names.
    uncalibrated_current_ua: Annotated[int, Meta(ge=50, le=ceilings.CURRENT_UA)]
    current_ua: Annotated[int, Meta(ge=50, le=ceilings.CURRENT_UA)]
    width_us: Annotated[int, Meta(ge=20, le=ceilings.WIDTH_US)]
    #: Of one phase of a pulse.
    charge_nc: Annotated[int, Meta(ge=1, le=ceilings.CHARGE_NC)]
    #: Pulses of one electrode in any second, those of bursts counted one by one.
    rate_hz: Annotated[int, Meta(ge=1, le=ceilings.RATE_HZ)]
    #: Of one electrode, from the start of a pulse to that of the next one, in a burst as well.
    interval_us: Annotated[int, Meta(ge=ceilings.INTERVAL_US, le=1_000_000 // ceilings.RATE_HZ)]
    #: Of one electrode over any second, all phases counted positive.
    mean_current_ua: Annotated[int, Meta(ge=1, le=ceilings.MEAN_CURRENT_UA)]
    array_mean_current_ua: Annotated[int, Meta(ge=1, le=ceilings.ARRAY_MEAN_CURRENT_UA)]
    #: Time with current in any second: one electrode, and the array.
    on_us_per_s: Annotated[int, Meta(ge=1, le=ceilings.ON_US_PER_S)]
    array_on_us_per_s: Annotated[int, Meta(ge=1, le=ceilings.ARRAY_ON_US_PER_S)]
    #: What pulses of one polarity may leave on one electrode, with a leak of one second.
    net_charge_nc: Annotated[int, Meta(ge=1, le=ceilings.NET_CHARGE_NC)]


class SiteDefaults(Strict, frozen=True):
    """What a frame gets that does not say, and that no calibration answers for."""

    width_us: Annotated[int, Meta(ge=20, le=ceilings.WIDTH_US)]
    rate_hz: Annotated[float, Meta(ge=0.1, le=ceilings.RATE_HZ)]
    polarity: Polarity


class SiteContact(Strict, frozen=True):
    """When an electrode counts as touched, and when as open.

    Both are fractions of the open-circuit signature, which is the voltage that the current makes
    across the board's leak alone, at most the compliance: min(current x leak, compliance).
    Below `touch_fraction` an open electrode becomes touched; above `open_fraction` a touched one
    becomes open; between them it stays what it was.
    """

    touch_fraction: Annotated[float, Meta(gt=0.0, lt=1.0)]
    open_fraction: Annotated[float, Meta(gt=0.0, lt=1.0)]
    #: Below this an electrode counts as shorted to a neighbor: no skin resists so little.
    shorted_ohm: Annotated[int, Meta(ge=100, le=50_000)] = 1_500
    #: So long a contact counts as soft, after none or after it shrank.
    soften_ms: Annotated[int, Meta(ge=10, le=5_000)] = 1_000


class BodySite(Strict, frozen=True):
    """One place on the body, with electrodes of one size."""

    name: PlainName
    title: str
    source_of_facts: str
    #: The maxima hold for electrodes of this diameter and larger ones.
    electrode_diameter_mm: Annotated[float, Meta(ge=0.1, le=100.0)]
    maxima: SiteMaxima
    defaults: SiteDefaults
    contact: SiteContact
    #: What may ask for more or less of a pulse; by default nothing does.
    stabilize: Settings = NO_STABILIZERS
    #: Whether what a person says of whom it was measured that they feel less in use may raise a
    #: level above the frame's own (`stabilize/said.py`, `protocol/adaptation.py`).
    felt_may_raise: bool = False
    #: What becomes of a frame of single phases whose direct current would pass `net_charge_nc` if
    #: it stood: by default it is refused when it does. `biphasic`: each of its pulses has the other
    #: phase as well, which is told, and feels different.
    balance: Literal["biphasic"] | None = None


def yardstick_nc(diameter_mm: float) -> float:
    """Charge of one phase, in nC, on Shannon's line at k = 1.5 for a disc of this diameter:
    10^0.75 x sqrt(area in cm2) uC, about 500 nC at 1 mm.
    """
    area_cm2 = math.pi * (diameter_mm / 20.0) ** 2
    return 1_000.0 * float(10.0 ** (YARDSTICK_K / 2.0)) * math.sqrt(area_cm2)


def passes_yardstick(site: BodySite) -> bool:
    """Whether the charge allowed there stays on the near side of the yardstick.

    A hundredth beyond counts as on it: k is given to two figures, and so is the usual 500 nC.
    """
    return site.maxima.charge_nc <= 1.01 * yardstick_nc(site.electrode_diameter_mm)


def load_body_site(path: Path) -> BodySite:
    """Read and check a body-site file. Raises: FileError."""
    try:
        return check_body_site(load_toml(path, BodySite), str(path))
    except FileError as error:
        if error.key != "stabilize.power_law" or "`k`" not in error.value:
            raise
        raise FileError(
            error.file,
            "stabilize.power_law.k",
            "k stands here no more: it is the person's, not the body site's",
            "remove it, and measure the person's (etd calibrate CODE --fit): it stands in the"
            " calibration",
        ) from error


def check_body_site(site: BodySite, file: str) -> BodySite:
    """The rules between keys. Raises: FileError."""
    _check_rises(site, file)
    _check_defaults(site, file)
    check_settings(site.stabilize, file)
    _check_bursts(site, file)
    return site


def _check_rises(site: BodySite, file: str) -> None:
    maxima, contact = site.maxima, site.contact
    for low_key, low, high_key, high in (
        ("maxima.uncalibrated_current_ua", maxima.uncalibrated_current_ua,
         "maxima.current_ua", maxima.current_ua),
        ("maxima.mean_current_ua", maxima.mean_current_ua,
         "maxima.array_mean_current_ua", maxima.array_mean_current_ua),
        ("maxima.on_us_per_s", maxima.on_us_per_s,
         "maxima.array_on_us_per_s", maxima.array_on_us_per_s),
    ):  # fmt: skip
        if low > high:
            raise FileError(
                file, low_key, f"{low} is above {high_key} ({high})", f"give at most {high}"
            )
    if contact.touch_fraction >= contact.open_fraction:
        raise FileError(
            file,
            "contact.touch_fraction",
            f"{contact.touch_fraction} is not below open_fraction ({contact.open_fraction})",
            "leave a gap between them: without it, contact would flicker with every pulse",
        )


def _check_defaults(site: BodySite, file: str) -> None:
    maxima, defaults = site.maxima, site.defaults
    for key, default, most in (
        ("width_us", defaults.width_us + site.stabilize.prepulse_us, maxima.width_us),
        ("rate_hz", defaults.rate_hz, maxima.rate_hz),
    ):
        if default > most:
            raise FileError(
                file,
                f"defaults.{key}",
                f"{default} is above maxima.{key} ({most})",
                f"give at most {most}: a frame that does not say would be refused",
            )


def _check_bursts(site: BodySite, file: str) -> None:
    bursts, maxima = site.stabilize.bursts, site.maxima
    if bursts is None:
        return
    if bursts.interval_us < maxima.interval_us:
        raise FileError(
            file,
            "stabilize.bursts.rate_hz",
            f"{bursts.rate_hz:g} Hz is a pulse every {bursts.interval_us:.0f} us,"
            f" maxima.interval_us is {maxima.interval_us}",
            f"give at most {1e6 / maxima.interval_us:.0f}",
        )
    if bursts.pulses * site.defaults.rate_hz > maxima.rate_hz:
        raise FileError(
            file,
            "defaults.rate_hz",
            f"{site.defaults.rate_hz:g} bursts of {bursts.pulses} pulses are more than"
            f" maxima.rate_hz ({maxima.rate_hz}) in a second",
            f"give at most {maxima.rate_hz / bursts.pulses:.1f}: it is the rate of the bursts",
        )
