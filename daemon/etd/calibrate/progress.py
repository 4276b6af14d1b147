"""The progress of a calibration, saved after every electrode, and at once when something was too
strong, so that it is not presented again after an interruption.

Owns: the struct, its file and the checks of it, and the calibration made from finished progress.
Must not know: procedures, daemons, terminals.
"""

from __future__ import annotations

import datetime
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import msgspec
from msgspec import Meta

from etd.calibrate.conditions import Conditions
from etd.calibrate.in_doubt import InDoubt
from etd.files.atomic_file import check_folder, write_atomically
from etd.files.paths import make_own
from etd.protocol.calibration import (
    Calibration,
    Drift,
    ElectrodeLimits,
    Seed,
    SkinCelsius,
    Ua,
    is_felt_above_cap,
    resisted_as_skin,
)
from etd.protocol.errors import FileError

#: A board's name, and where its daemon is: two paths and a computer, at the most.
BoardNamed = Annotated[str, Meta(max_length=1_000)]


class Progress(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """What has been found so far, by electrode; `presentations` counts all of them, silent ones
    included: `catch_trials`, of which `false_alarms` were said to be felt.

    `lowered_ua`: by electrode, the cap after something was too strong there. It bounds all further
    presentations and the finished calibration. `together_ua`: by electrode, what is left of level
    and cap after all at once were too strong; it bounds what is found. `seed`: of the random order;
    None in a file of before there was one, which continues in the array's order.
    `is_whole_accepted`: all electrodes at once, at level 1, were presented with these figures and
    not too strong. `drift`, `is_drift_least` and `skin_celsius`: as in the calibration. `in_doubt`:
    asked about before anything else is presented. `made_on`: the board, whether it is a fake one,
    and of that the finger, and the daemon; None in a file of before that was kept.
    """

    conditions: Conditions
    found: dict[int, ElectrodeLimits] = {}
    presentations: Annotated[int, Meta(ge=0)] = 0
    lowered_ua: dict[int, Ua] = {}
    together_ua: dict[int, tuple[Ua, Ua]] = {}
    seed: Seed | None = None
    catch_trials: Annotated[int, Meta(ge=0)] = 0
    false_alarms: Annotated[int, Meta(ge=0)] = 0
    is_whole_accepted: bool = False
    drift: Drift | None = None
    is_drift_least: bool = False
    skin_celsius: SkinCelsius | None = None
    in_doubt: InDoubt | None = None
    made_on: BoardNamed | None = None

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
        """`left_ua` is the most allowed there from now on; a result with more is deleted."""
        left_ua = min(left_ua, self.lowered_ua.get(electrode, left_ua))
        self.lowered_ua[electrode] = left_ua
        self.is_whole_accepted = False
        if electrode in self.found and self.found[electrode].cap_ua > left_ua:
            del self.found[electrode]

    @property
    def left_ua(self) -> dict[int, tuple[int, int]]:
        """By electrode, the most that is left of its level and of its cap, where something was too
        strong, alone or all at once.
        """
        left = dict(self.together_ua)
        for electrode, one_ua in self.lowered_ua.items():
            left[electrode] = _lesser(left.get(electrode), (one_ua, one_ua))
        return left

    def keep(self, electrode: int, limits: ElectrodeLimits) -> None:
        """What was found there, and no more than all at once have left of it."""
        left = self.together_ua.get(electrode)
        self.found[electrode] = limits if left is None or not limits.felt else _within(limits, left)

    def hold_within(self, conditions: Conditions) -> None:
        """Of a lower limit than before, which also holds for what was found already."""
        self.conditions = conditions
        for electrode, limits in self.found.items():
            if limits.cap_ua > conditions.presented_ua:
                self.found[electrode] = capped(
                    limits, conditions.presented_ua, limits.comfortable_ua
                )
                self.is_whole_accepted = False

    def leave_out(self, electrode: int) -> None:
        """Its result, if it has one, is not used; its cap stays: for what it carries back."""
        limits = self.found.pop(electrode, None)
        if limits is not None:
            left_ua = self.lowered_ua.get(electrode, limits.cap_ua)
            self.lowered_ua[electrode] = min(limits.cap_ua, left_ua)

    @property
    def is_whole_due(self) -> bool:
        """A single electrode was accepted already."""
        return not self.is_whole_accepted and len(self.level_1_ua) > 1

    @property
    def level_1_ua(self) -> dict[int, int]:
        """By electrode, where there is such a level."""
        return {
            electrode: limits.comfortable_ua
            for electrode, limits in self.found.items()
            if limits.felt and limits.comfortable_ua
        }

    def part_of_level_1(self, part: float) -> dict[int, int]:
        """In uA, by electrode."""
        return {one: max(1, int(current_ua * part)) for one, current_ua in self.level_1_ua.items()}

    def left_by(self, times: float) -> dict[int, tuple[int, int]]:
        """What is left of the levels and caps of all at once, if they were too strong so often."""
        return {
            electrode: (int(limits.comfortable_ua / times), int(limits.cap_ua / times))
            for electrode, limits in self.found.items()
            if limits.felt
        }

    def take_down(self, times: float) -> None:
        """All levels at once, and with them the caps: together they were too strong."""
        self.take_down_to(self.left_by(times))

    def take_down_to(self, left_ua: Mapping[int, tuple[int, int]]) -> None:
        """Thresholds are what was found. A level does not fall below one; where the cap does, the
        electrode is not felt any more within what it may carry.
        """
        for electrode, left in left_ua.items():
            self.together_ua[electrode] = _lesser(self.together_ua.get(electrode), left)
            if electrode in self.found:
                self.keep(electrode, self.found[electrode])

    @property
    def below_threshold(self) -> dict[int, ElectrodeLimits]:
        """Those whose cap is below what they are felt from: too strong has left no more."""
        return {
            electrode: limits
            for electrode, limits in self.found.items()
            if limits.felt_from_ua is not None
        }


def _lesser(one: tuple[int, int] | None, other: tuple[int, int]) -> tuple[int, int]:
    return other if one is None else (min(one[0], other[0]), min(one[1], other[1]))


def _within(limits: ElectrodeLimits, left: tuple[int, int]) -> ElectrodeLimits:
    level_ua, cap_ua = _lesser((limits.comfortable_ua, limits.cap_ua), left)
    return capped(limits, cap_ua, level_ua)


def capped(limits: ElectrodeLimits, cap_ua: int, comfortable_ua: int) -> ElectrodeLimits:
    """An electrode with a lower cap: its level is no more than these, and not below its threshold.
    Where the cap is, it is not felt any more within what it may carry.
    """
    if cap_ua >= limits.threshold_ua:
        comfortable_ua = max(limits.threshold_ua, min(comfortable_ua, cap_ua))
        return msgspec.structs.replace(limits, comfortable_ua=comfortable_ua, cap_ua=cap_ua)
    return msgspec.structs.replace(
        limits,
        threshold_ua=cap_ua,
        comfortable_ua=cap_ua,
        cap_ua=cap_ua,
        felt=False,
        felt_from_ua=limits.threshold_ua if limits.felt else limits.felt_from_ua,
        quality=None,
        place=None,
    )


def save_progress(path: Path, progress: msgspec.Struct) -> None:
    """Whole, or as it was before. Raises: FileError."""
    data = msgspec.json.format(msgspec.json.encode(progress), indent=1)
    try:
        make_own(path.parent, 0o700)
        write_atomically(path, data + b"\n", mode=0o600)
    except OSError as error:
        raise _unsaved(path, error) from error


def check_progress_folder(path: Path) -> None:
    """Before the first question: `path` can be saved. Raises: FileError."""
    try:
        make_own(path.parent, 0o700)
        check_folder(path.parent)
    except OSError as error:
        raise _unsaved(path, error) from error


def _unsaved(path: Path, error: OSError) -> FileError:
    return FileError(
        str(path),
        "",
        f"what is found could not be saved ({error.strerror}); it keeps what was saved before",
        "see that its folder can be written to and has room, then give the same command",
    )


def load_progress(
    path: Path, conditions: Conditions, seed: int | None = None, made_on: str | None = None
) -> Progress:
    """`seed`: the one asked for; None takes the saved one. `made_on`: this board; None: any. What
    does not say of which it is may be of a fake one, and goes on with none.

    Raises: FileError, also for other conditions, or figures that they cannot have given.
    """
    try:
        progress = msgspec.json.decode(path.read_bytes(), type=Progress)
    except OSError as error:
        raise FileError(
            str(path), "", f"it cannot be read ({error.strerror})", "check its permissions"
        ) from error
    except msgspec.DecodeError as error:
        raise FileError(
            str(path), "", f"it is not a progress file ({error})", "start again with --restart"
        ) from error
    for key in Conditions.__struct_fields__:
        was, now = getattr(progress.conditions, key), getattr(conditions, key)
        is_lower_limit = key == "cap_ua" and now < was
        if was != now and not is_lower_limit:
            raise FileError(
                str(path),
                f"conditions.{key}",
                f"the saved progress has {was}, this calibration {now}",
                "use the same conditions, or a lower limit, or start again with --restart",
            )
    check_made_on(path, progress.made_on, made_on)
    _check_order(str(path), progress, seed)
    if progress.in_doubt is not None:
        for electrode in progress.in_doubt.electrodes:
            check_electrode(str(path), "in_doubt", progress.conditions, electrode)
    for electrode, limits in progress.found.items():
        _check_found(str(path), progress, electrode, limits)
    for key in ("lowered_ua", "together_ua"):
        for electrode in getattr(progress, key):
            check_electrode(str(path), key, conditions, electrode)
    progress.hold_within(conditions)
    return progress


def check_made_on(path: Path, saved: str | None, now: str | None) -> None:
    """`now` None: any. Raises: FileError."""
    if now is not None and saved != now:
        was = saved or "a board that it does not name"
        raise FileError(
            str(path),
            "made_on",
            f"the saved progress is of {was}, this board is {now}",
            "use that one, give the result another name (--as), or start again with --restart",
        )


def _check_order(path: str, progress: Progress, seed: int | None) -> None:
    if seed not in (None, progress.seed):
        raise FileError(
            path,
            "seed",
            f"the saved progress has {progress.seed}, this calibration {seed}",
            "leave --seed out: the order continues; or start again with --restart",
        )
    if not progress.false_alarms <= progress.catch_trials <= progress.presentations:
        raise FileError(
            path,
            "false_alarms",
            f"{progress.false_alarms} of {progress.catch_trials} catch trials in"
            f" {progress.presentations} presentations cannot be",
            "start again with --restart",
        )


def check_electrode(path: str, key: str, conditions: Conditions, electrode: int) -> None:
    """Raises: FileError, where the array has none of that number."""
    if not 0 <= electrode < conditions.electrodes:
        raise FileError(
            path,
            f"{key}.{electrode}",
            f"there is no such electrode: the array has 0 to {conditions.electrodes - 1}",
            "start again with --restart",
        )


def _check_found(path: str, progress: Progress, electrode: int, limits: ElectrodeLimits) -> None:
    """A cap is a current that was presented: it cannot exceed the highest presented one."""
    check_electrode(path, "found", progress.conditions, electrode)
    most_ua = progress.conditions.presented_ua
    lowered_ua = progress.lowered_ua.get(electrode, most_ua)
    why = ""
    if not limits.threshold_ua <= limits.comfortable_ua <= limits.cap_ua:
        why = (
            f"threshold {limits.threshold_ua}, comfortable {limits.comfortable_ua} and cap"
            f" {limits.cap_ua} uA do not rise"
        )
    elif limits.cap_ua > most_ua:
        why = f"its cap of {limits.cap_ua} uA is above {most_ua} uA, the highest that is presented"
    elif not is_felt_above_cap(limits):
        why = f"felt_from_ua, {limits.felt_from_ua}, goes with felt = false, and is above its cap"
    elif not resisted_as_skin(limits):
        why = f"{limits.resistance_ohm} ohm is out of the range of skin"
    elif limits.cap_ua > lowered_ua:
        why = f"its cap of {limits.cap_ua} uA is above lowered_ua, {lowered_ua} uA"
    if why:
        raise FileError(path, f"found.{electrode}", why, "start again with --restart")


def _unfelt(progress: Progress) -> tuple[str, str]:
    """Why there is nothing to store, and what to do."""
    if progress.below_threshold:
        return (
            "something was too strong down to below what is felt on each electrode, alone or all"
            " together",
            "rest the skin, and calibrate anew with --restart --forget-too-strong, or fewer"
            " electrodes (--leave-out)",
        )
    return "nothing was felt anywhere", "check contact and cap"


def finished(
    progress: Progress, date: datetime.date, program: str, gamma: float = 1.0
) -> Calibration:
    """The calibration of all electrodes. An electrode that was left out counts as not felt; all its
    figures are the lowest threshold found, or its `lowered_ua` if lower. Figures of another day
    than `date` are dated.

    Raises: FileError if nothing is felt anywhere within its cap.
    """
    conditions, catches = progress.conditions, progress.catch_trials
    felt_ua = [limits.threshold_ua for limits in progress.found.values() if limits.felt]
    if not felt_ua:
        raise FileError("the calibration", "", *_unfelt(progress))
    each = (
        progress.found.get(electrode) or _unknown(min(felt_ua), progress.lowered_ua.get(electrode))
        for electrode in range(conditions.electrodes)
    )
    both = set(Conditions.__struct_fields__) & set(Calibration.__struct_fields__)
    return Calibration(
        **{key: getattr(conditions, key) for key in both},
        date=date,
        program=program,
        electrode=tuple(_dated(limits, date) for limits in each),
        gamma=gamma,
        seed=progress.seed,
        catch_trials=catches or None,
        is_whole_accepted=progress.is_whole_accepted or None,
        drift=progress.drift,
        is_drift_least=progress.is_drift_least or None,
        skin_celsius=progress.skin_celsius,
        false_alarm_rate=round(progress.false_alarms / catches, 3) if catches else None,
    )


def _unknown(least_ua: int, lowered_ua: int | None) -> ElectrodeLimits:
    bound_ua = least_ua if lowered_ua is None else min(least_ua, lowered_ua)
    return ElectrodeLimits(
        threshold_ua=bound_ua, comfortable_ua=bound_ua, cap_ua=bound_ua, felt=False
    )


def _dated(limits: ElectrodeLimits, date: datetime.date) -> ElectrodeLimits:
    """Dates are kept only where they differ from the file's."""
    return msgspec.structs.replace(
        limits,
        date=None if limits.date == date else limits.date,
        threshold_date=None if limits.threshold_date == date else limits.threshold_date,
    )
