"""How far a calibration has come: kept after every electrode, so that nobody is asked twice.

Owns: the struct, the file of an unfinished calibration, what that file must not say, and the
calibration that a finished one becomes. Must not know: procedures, daemons, terminals.
"""

from __future__ import annotations

import datetime
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from etd.calibrate.conditions import Conditions
from etd.calibration import Calibration, ElectrodeLimits, resisted_as_skin
from etd.errors import FileError
from etd.wholefile import write_whole


class Progress(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """What has been found so far, by electrode; `presentations` counts all of them."""

    conditions: Conditions
    found: dict[int, ElectrodeLimits] = {}
    presentations: Annotated[int, Meta(ge=0)] = 0

    @property
    def missing(self) -> tuple[int, ...]:
        return tuple(one for one in range(self.conditions.electrodes) if one not in self.found)


def save_progress(path: Path, progress: Progress) -> None:
    """Raises: OSError."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    data = msgspec.json.format(msgspec.json.encode(progress), indent=1)
    write_whole(path, data + b"\n", mode=0o600)


def load_progress(path: Path, conditions: Conditions) -> Progress:
    """What was found under the same conditions. Raises: FileError, also where what is in it cannot
    have been found under them.
    """
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
    for electrode, one in progress.found.items():
        _check_found(str(path), conditions, electrode, one)
    return progress


def _check_found(path: str, conditions: Conditions, electrode: int, one: ElectrodeLimits) -> None:
    """A cap was presented and accepted: one above all that is presented comes from elsewhere."""
    most_ua = conditions.presented_ua
    why = ""
    if not 0 <= electrode < conditions.electrodes:
        why = f"there is no such electrode: the array has 0 to {conditions.electrodes - 1}"
    elif not one.threshold_ua <= one.comfortable_ua <= one.cap_ua:
        why = (
            f"threshold {one.threshold_ua}, comfortable {one.comfortable_ua}, cap {one.cap_ua} uA"
            " do not rise"
        )
    elif one.cap_ua > most_ua:
        why = f"its cap of {one.cap_ua} uA is above the {most_ua} uA that are presented at most"
    elif not resisted_as_skin(one):
        why = f"{one.resistance_ohm} ohm is no resistance of skin"
    if why:
        raise FileError(path, f"found.{electrode}", why, "--restart begins anew")


def finished(
    progress: Progress, date: datetime.date, program: str, gamma: float = 1.0
) -> Calibration:
    """The calibration of all electrodes. One that was left out gets the least threshold that was
    found for everything, and counts as not felt: a bound, where nothing is known. What was found
    on another day than `date` says so.

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
        electrode=tuple(
            _dated(progress.found.get(one, unknown), date) for one in range(conditions.electrodes)
        ),
        method=conditions.method,
        pulses=conditions.pulses,
        shape=conditions.shape,
        gamma=gamma,
    )


def _dated(one: ElectrodeLimits, date: datetime.date) -> ElectrodeLimits:
    """Its days are written where they are not the file's."""
    return msgspec.structs.replace(
        one,
        date=None if one.date == date else one.date,
        threshold_date=None if one.threshold_date == date else one.threshold_date,
    )
