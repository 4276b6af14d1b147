"""What a calibration is made under.

Owns: the struct, and which conditions cannot be. Must not know: procedures, daemons, terminals,
how far a calibration has come (progress).
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from typing import Annotated

import msgspec
from msgspec import Meta

from etd.files.calibration import to_toml
from etd.protocol.calibration import Calibration, Method
from etd.protocol.errors import FileError, Refused
from etd.protocol.frame import Polarity, Returns
from etd.stabilize.pipeline import PulseRequest
from etd.stabilize.shape import PLAIN, Shape

#: A presentation ends well before its frame would expire.
MOST_S = 0.7


#: Laws by resistance or pressure. They compare with a calibration.
_ANSWER_THE_SKIN = ("pressure", "energy", "power_law", "linear_law")
_SAME_AS_BASELINE = (
    "participant", "body_site", "array", "polarity", "width_us", "rate_hz", "returns", "shape",
)  # fmt: skip


class Conditions(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """All that a threshold depends on. `cap_ua`: nothing above it is presented to anybody."""

    participant: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$")]
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
    #: The earlier calibration that it begins from, as `identity` names it.
    baseline: str | None = None
    #: With equalize: the electrode that all others are compared with.
    reference: Annotated[int, Meta(ge=0, le=255)] | None = None

    @property
    def presented_ua(self) -> int:
        """The most that is presented: `cap_ua` in the charge of a plain pulse, because nobody has
        accepted what a prepulse adds. With equalize each electrode's cap is one of such pulses.
        """
        if self.method == "equalize":
            return self.cap_ua
        plain = PulseRequest(self.cap_ua, self.width_us)
        return self.shape.of(plain).current_of(plain.charge_pc)

    @property
    def presentation_s(self) -> float:
        return self.pulses / self.rate_hz


def check_conditions(conditions: Conditions) -> Conditions:
    """Raises: FileError, where a presentation would outlast its frame."""
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
    """What is asked about must be what was presented. Raises: FileError.

    `stabilizers`: those of the body site. `contact` only weakens the first moments of a touch,
    which are presented again; with a calibration in use, as a baseline is, it goes by the skin too.
    """
    answers = (*_ANSWER_THE_SKIN, "contact") if has_baseline else _ANSWER_THE_SKIN
    answering = [stabilizer for stabilizer in stabilizers if stabilizer in answers]
    if answering:
        raise FileError(
            "the body site",
            "stabilize.order",
            f"{' and '.join(answering)} would change pulses while the person is asked about them",
            "calibrate with a body-site file without it; put it back afterwards, the calibration"
            " holds with it",
        )
    narrow = conditions.shape.strength_duration
    if narrow is not None:
        raise FileError(
            "the body site",
            "stabilize.strength_duration",
            f"it makes {narrow.width_us} us of {conditions.width_us} us, at another current",
            f"calibrate at --width-us {narrow.width_us}, or without it",
        )


def identity(name: str, baseline: Calibration) -> str:
    """Name, day, and a mark of all that is in it: two of one name and day are told apart."""
    mark = hashlib.sha256(to_toml(baseline).encode()).hexdigest()[:8]
    return f"{name} of {baseline.date.isoformat()} ({mark})"


def check_baseline(conditions: Conditions, baseline: Calibration) -> None:
    """It must be of the same person under the same conditions: a threshold of another width or
    polarity would be a start in the wrong place. Raises: Refused (`bad_calibration`).
    """
    for key in _SAME_AS_BASELINE:
        was, now = getattr(baseline, key), getattr(conditions, key)
        if was != now:
            raise Refused(
                "bad_calibration",
                f"the baseline has {key} {was}, this calibration {now}: begin without it, or under"
                " its conditions",
            )
    if len(baseline.electrode) != conditions.electrodes:
        raise Refused(
            "bad_calibration",
            f"the baseline has {len(baseline.electrode)} electrodes, here are"
            f" {conditions.electrodes}",
        )
