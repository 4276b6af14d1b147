"""How far a calibration has come: kept after every electrode, so that nobody is asked twice, and at
once when something was too strong, so that it does not come again.

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
from etd.files.atomic_file import write_atomically
from etd.protocol.calibration import Calibration, ElectrodeLimits, Ua, resisted_as_skin
from etd.protocol.errors import FileError


class Progress(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """What has been found so far, by electrode; `presentations` counts all of them.

    `lowered_ua`: by electrode, the cap that was left when something was too strong there. It holds
    for all that this becomes. Files of before it was kept say nothing of it.
    """

    conditions: Conditions
    found: dict[int, ElectrodeLimits] = {}
    presentations: Annotated[int, Meta(ge=0)] = 0
    lowered_ua: dict[int, Ua] = {}

    @property
    def missing(self) -> tuple[int, ...]:
        return tuple(
            electrode
            for electrode in range(self.conditions.electrodes)
            if electrode not in self.found
        )

    @property
    def troubled(self) -> tuple[int, ...]:
        """Those of them on which something was too strong."""
        return tuple(electrode for electrode in self.missing if electrode in self.lowered_ua)

    def lower(self, electrode: int, left_ua: int) -> None:
        """Something was too strong: `left_ua` is the most that may come there. What was found with
        a higher cap, or taken over from another day, holds no more.
        """
        left_ua = min(left_ua, self.lowered_ua.get(electrode, left_ua))
        self.lowered_ua[electrode] = left_ua
        if electrode in self.found and self.found[electrode].cap_ua > left_ua:
            del self.found[electrode]


def save_progress(path: Path, progress: Progress) -> None:
    """Raises: OSError."""
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    data = msgspec.json.format(msgspec.json.encode(progress), indent=1)
    write_atomically(path, data + b"\n", mode=0o600)


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
    for electrode, limits in progress.found.items():
        _check_found(str(path), progress, electrode, limits)
    for electrode in progress.lowered_ua:
        _check_electrode(str(path), "lowered_ua", conditions, electrode)
    return progress


def _check_electrode(path: str, key: str, conditions: Conditions, electrode: int) -> None:
    if not 0 <= electrode < conditions.electrodes:
        raise FileError(
            path,
            f"{key}.{electrode}",
            f"there is no such electrode: the array has 0 to {conditions.electrodes - 1}",
            "--restart begins anew",
        )


def _check_found(path: str, progress: Progress, electrode: int, limits: ElectrodeLimits) -> None:
    """A cap was presented and accepted: one above all that is presented comes from elsewhere."""
    _check_electrode(path, "found", progress.conditions, electrode)
    most_ua = progress.conditions.presented_ua
    lowered_ua = progress.lowered_ua.get(electrode, most_ua)
    why = ""
    if not limits.threshold_ua <= limits.comfortable_ua <= limits.cap_ua:
        why = (
            f"threshold {limits.threshold_ua}, comfortable {limits.comfortable_ua}, cap "
            f"{limits.cap_ua} uA"
            " do not rise"
        )
    elif limits.cap_ua > most_ua:
        why = f"its cap of {limits.cap_ua} uA is above the {most_ua} uA that are presented at most"
    elif not resisted_as_skin(limits):
        why = f"{limits.resistance_ohm} ohm is no resistance of skin"
    elif limits.cap_ua > lowered_ua:
        why = f"its cap of {limits.cap_ua} uA is above the {lowered_ua} uA that too strong has left"
    if why:
        raise FileError(path, f"found.{electrode}", why, "--restart begins anew")


def finished(
    progress: Progress, date: datetime.date, program: str, gamma: float = 1.0
) -> Calibration:
    """The calibration of all electrodes. One that was left out gets the least threshold that was
    found for everything, or what was left where something was too strong, and counts as not felt: a
    bound, where nothing is known. What was found on another day than `date` says so.

    Raises: FileError, if nothing was found at all.
    """
    conditions = progress.conditions
    felt_ua = [limits.threshold_ua for limits in progress.found.values() if limits.felt]
    if not felt_ua:
        raise FileError(
            "the calibration", "", "nothing was felt anywhere", "look at contact and cap first"
        )
    each = (
        progress.found.get(electrode) or _unknown(min(felt_ua), progress.lowered_ua.get(electrode))
        for electrode in range(conditions.electrodes)
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
        electrode=tuple(_dated(limits, date) for limits in each),
        method=conditions.method,
        pulses=conditions.pulses,
        shape=conditions.shape,
        gamma=gamma,
    )


def _unknown(least_ua: int, lowered_ua: int | None) -> ElectrodeLimits:
    bound_ua = least_ua if lowered_ua is None else min(least_ua, lowered_ua)
    return ElectrodeLimits(
        threshold_ua=bound_ua, comfortable_ua=bound_ua, cap_ua=bound_ua, felt=False
    )


def _dated(limits: ElectrodeLimits, date: datetime.date) -> ElectrodeLimits:
    """Its days are written where they are not the file's."""
    return msgspec.structs.replace(
        limits,
        date=None if limits.date == date else limits.date,
        threshold_date=None if limits.threshold_date == date else limits.threshold_date,
    )
