"""What a calibration is made under, and how far it has come: kept after every electrode.

Owns: the two structs, the file of an unfinished calibration, and the calibration that a finished
one becomes. Must not know: procedures, daemons, terminals.
"""

from __future__ import annotations

import datetime
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from etd.calibration import Calibration, ElectrodeLimits, Method
from etd.errors import FileError, Refused
from etd.frame import Polarity, Returns
from etd.stabilize.pipeline import Wish
from etd.stabilize.shape import PLAIN, Shape
from etd.wholefile import write_whole

#: A presentation ends well before its frame would expire.
MOST_S = 0.7


#: Laws by resistance or pressure. They compare with a calibration.
_ANSWER_THE_SKIN = ("pressure", "energy", "fitted", "lines")
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

    @property
    def presented_ua(self) -> int:
        """The most that is presented: `cap_ua` in the charge of a plain pulse, because nobody has
        accepted what a prepulse adds. With equalize each electrode's cap is one of such pulses.
        """
        if self.method == "equalize":
            return self.cap_ua
        plain = Wish(self.cap_ua, self.width_us)
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


def check_laws(conditions: Conditions, stabilizers: Sequence[str]) -> None:
    """What is asked about must be what was presented. Raises: FileError.

    `stabilizers`: those of the body site. `contact` only weakens the first moments of a touch,
    which are presented again.
    """
    answering = [one for one in stabilizers if one in _ANSWER_THE_SKIN]
    if answering:
        raise FileError(
            "the body site",
            "stabilize.order",
            f"{' and '.join(answering)} would change pulses while the person is asked about them",
            "calibrate with a body-site file without it; put it back afterwards, the calibration"
            " holds with it",
        )
    narrow = conditions.shape.narrow
    if narrow is not None:
        raise FileError(
            "the body site",
            "stabilize.narrow",
            f"it makes {narrow.width_us} us of {conditions.width_us} us, at another current",
            f"calibrate at --width-us {narrow.width_us}, or without it",
        )


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


class Progress(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """What has been found so far, by electrode; `presentations` counts all of them."""

    conditions: Conditions
    found: dict[int, ElectrodeLimits] = {}
    presentations: int = 0

    @property
    def missing(self) -> tuple[int, ...]:
        return tuple(one for one in range(self.conditions.electrodes) if one not in self.found)


def save_progress(path: Path, progress: Progress) -> None:
    """Raises: OSError."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    data = msgspec.json.format(msgspec.json.encode(progress), indent=1)
    write_whole(path, data + b"\n", mode=0o600)


def load_progress(path: Path, conditions: Conditions) -> Progress:
    """What was found under the same conditions. Raises: FileError."""
    try:
        progress = msgspec.json.decode(path.read_bytes(), type=Progress)
    except OSError as error:
        raise FileError(
            str(path), "", f"it cannot be read ({error.strerror})", "check it"
        ) from error
    except msgspec.DecodeError as error:
        raise FileError(str(path), "", f"it is no progress file ({error})", "--restart") from error
    for key in Conditions.__struct_fields__:
        was, now = getattr(progress.conditions, key), getattr(conditions, key)
        if was != now:
            raise FileError(
                str(path),
                f"conditions.{key}",
                f"what was begun is for {was}, this is {now}",
                "go on under the same conditions, or give --restart to begin anew",
            )
    return progress


def finished(
    progress: Progress, date: datetime.date, program: str, gamma: float = 1.0
) -> Calibration:
    """The calibration of all electrodes. One that was left out gets the least threshold that was
    found for everything, and counts as not felt: a bound, where nothing is known.

    Raises: FileError, if nothing was found at all.
    """
    conditions = progress.conditions
    felt_ua = [one.threshold_ua for one in progress.found.values() if one.felt]
    if not felt_ua:
        raise FileError(
            "the calibration", "", "nothing was felt anywhere", "look at contact and cap first"
        )
    least_ua = min(felt_ua)
    unknown = ElectrodeLimits(
        threshold_ua=least_ua, comfortable_ua=least_ua, cap_ua=least_ua, felt=False
    )
    return Calibration(
        participant=conditions.participant,
        body_site=conditions.body_site,
        array=conditions.array,
        polarity=conditions.polarity,
        width_us=conditions.width_us,
        rate_hz=conditions.rate_hz,
        returns=conditions.returns,
        date=date,
        program=program,
        electrode=tuple(progress.found.get(one, unknown) for one in range(conditions.electrodes)),
        method=conditions.method,
        pulses=conditions.pulses,
        shape=conditions.shape,
        gamma=gamma,
    )
