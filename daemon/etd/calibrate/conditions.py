"""The conditions of a calibration.

Owns: the struct, and which conditions are invalid. Must not know: procedures, daemons, terminals,
the progress of a calibration (progress).
"""

from __future__ import annotations

import datetime
import hashlib
from collections.abc import Sequence
from typing import Annotated

import msgspec
from msgspec import Meta

from etd.files.calibration import to_toml
from etd.protocol.calibration import Calibration, Method
from etd.protocol.errors import FileError, Refused
from etd.protocol.frame import Name, Polarity, Returns
from etd.pulse.request import PulseRequest
from etd.stabilize.shape import PLAIN, Shape

#: A presentation ends well before its frame would expire.
MOST_S = 0.7


#: Laws by resistance or pressure: they change pulses by what the skin does.
_ANSWER_THE_SKIN = ("pressure", "energy", "power_law", "linear_law")
_SAME_AS_BASELINE = (
    "participant", "body_site", "array", "polarity", "width_us", "rate_hz", "returns", "shape",
)  # fmt: skip


#: Who or what differs in one of these uses another calibration.
_OF_ONE_USE = ("participant", "body_site", "array", "polarity", "width_us")


class Conditions(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that a threshold depends on. `cap_ua` is the highest current that is presented."""

    participant: Name
    method: Method
    body_site: str
    array: str
    electrodes: Annotated[int, Meta(ge=2, le=256)]
    polarity: Polarity
    width_us: Annotated[int, Meta(ge=20, le=200)]
    rate_hz: Annotated[float, Meta(ge=0.1, le=200)]
    returns: Returns
    pulses: Annotated[int, Meta(ge=1, le=140)]
    shape: Shape = PLAIN
    cap_ua: Annotated[int, Meta(ge=50, le=10_000)]
    #: The earlier calibration that it starts from, as `identity` names it.
    baseline: str | None = None
    #: With equalize: the electrode that all others are compared with.
    reference: Annotated[int, Meta(ge=0, le=255)] | None = None

    @property
    def presented_ua(self) -> int:
        """The most that is presented: the current with the charge of a plain pulse of `cap_ua`,
        because the charge of a prepulse has not been accepted yet. With equalize the caps were
        found with such pulses.
        """
        if self.method == "equalize":
            return self.cap_ua
        plain = PulseRequest(self.cap_ua, self.width_us)
        return self.shape.of(plain).current_of(plain.charge_pc)

    @property
    def presentation_s(self) -> float:
        return self.pulses / self.rate_hz


def other_use(one: Conditions | Calibration, other: Conditions | Calibration) -> str | None:
    """In what they are not of the same person, array and pulses; None: they are."""
    for key in _OF_ONE_USE:
        was, now = getattr(one, key), getattr(other, key)
        if was != now:
            return f"its {key} is {was}, not {now}"
    return None


def check_conditions(conditions: Conditions) -> Conditions:
    """Raises: FileError if a presentation would outlast its frame."""
    if conditions.presentation_s > MOST_S:
        raise FileError(
            "the presentation",
            "pulses",
            f"{conditions.pulses} pulses at {conditions.rate_hz:g} Hz last"
            f" {conditions.presentation_s:.2f} s",
            f"at most {MOST_S} s: fewer pulses, or a higher rate",
        )
    return conditions


def check_laws(
    conditions: Conditions, stabilizers: Sequence[str], *, has_baseline: bool = False
) -> None:
    """Stabilizers must not change what is presented. Raises: FileError.

    `stabilizers`: those of the body site. `contact` only weakens the first moments of a touch,
    which are presented again; with a baseline it also depends on the resistance.
    """
    answers = (*_ANSWER_THE_SKIN, "contact") if has_baseline else _ANSWER_THE_SKIN
    answering = [stabilizer for stabilizer in stabilizers if stabilizer in answers]
    if answering:
        raise FileError(
            "the body site",
            "stabilize.order",
            f"{' and '.join(answering)} would change the pulses that are presented",
            "calibrate with a body-site file without it, then put it back: the calibration remains"
            " valid with it",
        )
    narrow = conditions.shape.strength_duration
    if narrow is not None:
        raise FileError(
            "the body site",
            "stabilize.strength_duration",
            f"it changes pulses of {conditions.width_us} us to {narrow.width_us} us, at another"
            " current",
            f"calibrate with --width-us {narrow.width_us}, or remove it while calibrating",
        )


def identity(name: str, baseline: Calibration) -> str:
    """Name, day, and a hash of the content."""
    digest = hashlib.sha256(to_toml(baseline).encode()).hexdigest()[:8]
    return f"{name} of {baseline.date.isoformat()} ({digest})"


def check_date(baseline: Calibration, today: datetime.date) -> None:
    """Before anything is asked that is added to it: what is of a day before it would not count.
    Raises: Refused (`bad_calibration`).
    """
    if baseline.date > today:
        raise Refused(
            "bad_calibration",
            f"it is of {baseline.date}, and this computer has {today}: set its clock, or the date"
            " of the calibration",
        )


def check_baseline(
    conditions: Conditions,
    baseline: Calibration,
    otherwise: str = "start without a baseline, or use its conditions",
) -> None:
    """Thresholds depend on person and conditions. `otherwise`: what to do where these differ.

    Raises: Refused (`bad_calibration`).
    """
    for key in _SAME_AS_BASELINE:
        was, now = getattr(baseline, key), getattr(conditions, key)
        if was != now:
            raise Refused(
                "bad_calibration",
                f"the baseline has {key} {was}, this calibration {now}: {otherwise}",
            )
    if len(baseline.electrode) != conditions.electrodes:
        raise Refused(
            "bad_calibration",
            f"the baseline has {len(baseline.electrode)} electrodes, this array has"
            f" {conditions.electrodes}: {otherwise}",
        )
