"""A person's exponent, measured: the thresholds of a few electrodes, in one state of the skin after
another.

Owns: the states, which electrodes are asked, how far currents go, and what of it all is kept. Must
not know: procedures, the fit itself (exponent), terminals, daemons.

The skin becomes damp and dry again, and again, so that a person who adapts meanwhile can be told
from one whose thresholds follow the resistance. Currents begin at half of the lowest threshold that
the electrode had so far, since the skin may need less or more now, and rise as in any
calibration: each step was answered before the next. Damp skin may need more than the caps of the
calibration, and gets up to the limit of this one; dry skin gets no more than its caps, which were
accepted on such.
"""

from __future__ import annotations

import datetime
from collections.abc import Collection, Sequence
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Final, NamedTuple

import msgspec
from msgspec import Meta

from etd.calibrate.conditions import Conditions
from etd.calibrate.exponent import LEAST_STATES, Asked, NoFit, fitted
from etd.calibrate.in_doubt import InDoubt
from etd.calibrate.lowered import lowered
from etd.calibrate.progress import BoardNamed, Progress, check_electrode, check_made_on
from etd.protocol.calibration import MOST_SEED, Calibration, Seed, Ua
from etd.protocol.errors import FileError
from etd.protocol.exponent import LEAST_ELECTRODES, FittedExponent
from etd.protocol.frame import ShortText
from etd.pulse.measured import BEND_UA

#: Of electrodes that are asked without `--electrodes`: with four of them a person without a k got
#: one four times as often.
USUAL_ELECTRODES = 6
#: Above every current.
MOST_UA = 10_000
#: Between two states. Use raises thresholds, and in a pause they come down again: up to here a
#: straight line over time holds for both well enough; the next day the skin is another.
MOST_PAUSE_S = 3_600.0


class SkinState(NamedTuple):
    name: str
    todo: str
    #: It is damper than for the calibration.
    is_damp: bool = False


STATES: Final = (
    SkinState("dry", "Lay the finger on as for the calibration, and let it rest for a minute."),
    SkinState(
        "damp",
        "Breathe on array and fingertip, ten slow breaths, and lay the finger on again.",
        is_damp=True,
    ),
    SkinState("dry again", "Wipe array and finger with a dry cloth; wait two minutes in the air."),
    SkinState(
        "pressed",
        "Breathe on it again, and press more firmly than before, all the time.",
        is_damp=True,
    ),
    SkinState("dry at last", "Wipe both; wait two minutes in the air; press as at first."),
)


#: In so many of them an electrode may have no threshold: damp skin can need more than the limit,
#: and use can raise a threshold above its cap, on dry skin.
_MAY_LACK: Final = len(STATES) - LEAST_STATES


class FitProgress(msgspec.Struct, forbid_unknown_fields=True, kw_only=True):
    """What has been asked so far; complete states only. `board`, `leak_ohm`: what it is asked with.
    `made_on`: as in `Progress`. Times are of the wall clock: the file may be continued after the
    computer was off.
    """

    conditions: Conditions
    electrodes: tuple[Annotated[int, Meta(ge=0)], ...]
    seed: Seed
    board: ShortText
    leak_ohm: Annotated[int, Meta(ge=1)]
    made_on: BoardNamed | None = None
    #: Of the states that are over.
    states: Annotated[int, Meta(ge=0, le=len(STATES))] = 0
    asked: list[Asked] = []
    #: Silent trials in these states, and those of them that were said to be felt.
    catch_trials: Annotated[int, Meta(ge=0)] = 0
    false_alarms: Annotated[int, Meta(ge=0)] = 0
    #: What was too strong in one state is not presented in another; and in the state under way,
    #: where a slipped key can still be taken back.
    lowered_ua: dict[int, Ua] = {}
    lowering_ua: dict[int, Ua] = {}
    #: What it was stopped at, in the state under way.
    in_doubt: InDoubt | None = None


class Fitting:
    """`progress` is filled in; see the module. `baseline`: what k is added to."""

    def __init__(self, progress: FitProgress, baseline: Calibration) -> None:
        self._progress = progress
        self._baseline = baseline
        self._found_s: dict[int, float] = {}

    @property
    def state(self) -> SkinState | None:
        """The next one to be asked in; None after the last."""
        done = self._progress.states
        return STATES[done] if done < len(STATES) else None

    def progress_of_state(self) -> Progress:
        """For a course of it, with nothing found yet."""
        progress = self._progress
        self._found_s.clear()
        self._keep_lowered()
        seed = (progress.seed + progress.states) % (MOST_SEED + 1)
        return Progress(conditions=progress.conditions, seed=seed, in_doubt=progress.in_doubt)

    @property
    def caps_ua(self) -> dict[int, int]:
        """By electrode, the most that is presented in this state."""
        is_damp = self.state is not None and self.state.is_damp
        return {one: self._most_ua(one, is_damp=is_damp) for one in self._progress.electrodes}

    @property
    def above_caps_ua(self) -> dict[int, int]:
        """Of those that may get more on damp skin than on dry, how much."""
        return {
            one: damp_ua
            for one in self._progress.electrodes
            if (damp_ua := self._most_ua(one, is_damp=True)) > self._most_ua(one, is_damp=False)
        }

    def _most_ua(self, electrode: int, *, is_damp: bool) -> int:
        progress = self._progress
        most_ua = progress.conditions.presented_ua
        most_ua = min(most_ua, progress.lowered_ua.get(electrode, most_ua))
        return most_ua if is_damp else min(most_ua, self._baseline.electrode[electrode].cap_ua)

    def threshold_found(self, electrode: int, now_s: float) -> None:
        """Called as it is found: a state takes minutes."""
        self._found_s[electrode] = now_s

    def take(self, of_state: Progress) -> tuple[int, ...]:
        """Keep what was found in the state; it is over. Returns those that have nothing."""
        progress = self._progress
        self.lower(of_state)
        self._keep_lowered()
        missing = []
        for electrode in progress.electrodes:
            found = of_state.found.get(electrode)
            if found is None or not found.felt or found.resistance_ohm is None:
                missing.append(electrode)
                continue
            # Skin resists less at higher currents, and thresholds differ from state to state.
            bent = (found.threshold_ua + BEND_UA) / BEND_UA
            progress.asked.append(
                Asked(
                    electrode=electrode,
                    state=progress.states,
                    at_s=self._found_s[electrode],
                    threshold_ua=float(found.threshold_ua),
                    resistance_ohm=found.resistance_ohm * bent,
                )
            )
        progress.states += 1
        progress.catch_trials += of_state.catch_trials
        progress.false_alarms += of_state.false_alarms
        return tuple(missing)

    def lowered(self) -> Calibration:
        """The baseline without what was too strong in any state: the caps of these electrodes
        are lower, and what was found of all levels together is of others.
        """
        return lowered(self._baseline, self.left_ua)

    @property
    def left_ua(self) -> dict[int, tuple[int, int]]:
        """By electrode, of all states and the standing one: of its level and of its cap."""
        return {electrode: (ua, ua) for electrode, ua in self._lowered_ua().items()}

    def _lowered_ua(self) -> dict[int, int]:
        progress = self._progress
        found = dict(progress.lowered_ua)
        for electrode, ua in progress.lowering_ua.items():
            found[electrode] = min(ua, found.get(electrode, ua))
        return found

    def lower(self, of_state: Progress) -> None:
        """Called when something was too strong or may have been, and when that is taken back."""
        self._progress.lowering_ua = dict(of_state.lowered_ua)
        self._progress.in_doubt = of_state.in_doubt

    def _keep_lowered(self) -> None:
        """Also of a state that was interrupted."""
        self._progress.lowered_ua = self._lowered_ua()
        self._progress.lowering_ua = {}

    @property
    def least_ua(self) -> dict[int, int]:
        """By electrode, the lowest threshold in the states so far."""
        found: dict[int, int] = {}
        for one in self._progress.asked:
            found[one.electrode] = min(int(one.threshold_ua), found.get(one.electrode, MOST_UA))
        return found

    def fit(self, today: datetime.date) -> FittedExponent:
        """By the electrodes that have a threshold in all states, or all but one. Raises: NoFit."""
        asked = self._progress.asked
        known = self._known_well
        if len(known) < LEAST_ELECTRODES:
            raise NoFit(
                f"{len(known)} of {len(self._progress.electrodes)} electrodes have a threshold in"
                f" all states so far, or all but {_MAY_LACK}, and {LEAST_ELECTRODES} are needed:"
                f" {self._why_lacking}"
            )
        whole = [one for one in asked if one.electrode in known]
        progress, silent = self._progress, self._progress.catch_trials
        found = fitted(whole, today, progress.board, progress.leak_ohm)
        return msgspec.structs.replace(
            found,
            catch_trials=silent or None,
            false_alarm_rate=round(progress.false_alarms / silent, 3) if silent else None,
        )

    @property
    def _why_lacking(self) -> str:
        """And what to do: by the kind of states where most thresholds are missing."""
        if self._lacking(is_damp=False) > self._lacking(is_damp=True):
            return (
                "on dry skin thresholds are now above the calibration's caps: rest, and ask again,"
                " or calibrate anew"
            )
        return (
            "damp skin may need more current, so raise --max-current-ua, choose --electrodes with"
            " lower thresholds, or breathe less"
        )

    def _lacking(self, *, is_damp: bool) -> int:
        """So many thresholds are missing in the states of this kind that are over."""
        progress = self._progress
        over = [at for at in range(progress.states) if STATES[at].is_damp == is_damp]
        found = sum(one.state in over for one in progress.asked)
        return len(over) * len(progress.electrodes) - found

    @property
    def is_lost(self) -> bool:
        """Too few electrodes have thresholds enough: no further state makes a fit of them."""
        return len(self._known_well) < LEAST_ELECTRODES

    @property
    def _known_well(self) -> set[int]:
        asked, least = self._progress.asked, self._progress.states - _MAY_LACK
        return {
            electrode
            for electrode in self._progress.electrodes
            if sum(one.electrode == electrode for one in asked) >= least
        }


def electrodes_to_ask(
    baseline: Calibration, named: Sequence[int] = (), most_ua: int = MOST_UA
) -> tuple[int, ...]:
    """Those `named`, or some that have room above their threshold, spread over the array.
    `most_ua`: no more is presented, whatever the caps.

    Raises: FileError, where they are too few, or not felt.
    """
    felt, by_caps = _with_room(baseline, most_ua), _with_room(baseline, MOST_UA)
    if len(felt) < LEAST_ELECTRODES <= len(by_caps):
        lowest_ua = sorted(baseline.electrode[one].threshold_ua for one in by_caps)
        raise FileError(
            "the command line",
            "--max-current-ua",
            f"{len(felt)} electrodes have a threshold below {most_ua} uA in the calibration",
            f"at least {LEAST_ELECTRODES} must: a limit well above"
            f" {lowest_ua[LEAST_ELECTRODES - 1]} uA, since damp skin may need more",
        )
    for electrode in named:
        if electrode not in felt:
            raise FileError(
                "the command line",
                "--electrodes",
                f"electrode {electrode} was not felt, or has no room above its threshold",
                f"choose of {', '.join(map(str, felt)) or 'none'}",
            )
    chosen = sorted(set(named)) or _spread(felt)
    if len(chosen) < LEAST_ELECTRODES:
        raise FileError(
            "the calibration",
            "electrode",
            f"{len(chosen)} electrodes could be asked",
            f"at least {LEAST_ELECTRODES} that were felt, with room above the threshold",
        )
    return tuple(chosen)


def _with_room(baseline: Calibration, most_ua: int) -> list[int]:
    return [
        electrode
        for electrode, limits in enumerate(baseline.electrode)
        if limits.felt and min(limits.cap_ua, most_ua) > limits.threshold_ua
    ]


def _spread(felt: Sequence[int]) -> list[int]:
    if len(felt) <= USUAL_ELECTRODES:
        return list(felt)
    step = (len(felt) - 1) / (USUAL_ELECTRODES - 1)
    return [felt[round(place * step)] for place in range(USUAL_ELECTRODES)]


def check_pause(progress: FitProgress, now_s: float, file: str) -> None:
    """Before the next state is asked in. Raises: FileError, where the last one is too long ago, or
    was later than now.
    """
    if not progress.asked or progress.states == len(STATES):
        return
    pause_s = now_s - max(one.at_s for one in progress.asked)
    if 0.0 <= pause_s <= MOST_PAUSE_S:
        return
    why = f"the last state was over {_long(pause_s)} ago"
    if pause_s < 0.0:
        why = "the clock has been set back since the last state"
    raise FileError(
        file,
        "asked",
        f"{why}, so that what time does to thresholds cannot be told from what skin does",
        f"ask all states in one sitting, with pauses of at most {MOST_PAUSE_S / 60:.0f} minutes:"
        " start again with --restart",
    )


def _long(seconds: float) -> str:
    minutes = seconds / 60.0
    return f"{minutes:.0f} minutes" if minutes < 120.0 else f"{minutes / 60.0:.0f} hours"


# --- its file ------------------------------------------------------------------------------------


_AGAIN: Final = "start again with --restart"


def load_fit(path: Path, asked_for: FitProgress, named: Collection[str] = ()) -> FitProgress:
    """The saved one, for the same conditions. `named`: what else was asked for by name, of `seed`
    and `electrodes`; what was not is as it was saved.

    Raises: FileError.
    """
    try:
        saved = msgspec.json.decode(path.read_bytes(), type=FitProgress)
    except OSError as error:
        why = f"it cannot be read ({error.strerror})"
        raise FileError(str(path), "", why, "check its permissions") from error
    except msgspec.DecodeError as error:
        raise FileError(str(path), "", f"it is no saved fit ({error})", _AGAIN) from error
    if asked_for.conditions.cap_ua < saved.conditions.cap_ua:
        # A lower limit: each step of what is asked is answered anyway.
        limit_ua = asked_for.conditions.cap_ua
        saved.conditions = msgspec.structs.replace(saved.conditions, cap_ua=limit_ua)
    for key in ("conditions", "board", "leak_ohm", *named):
        if getattr(saved, key) != getattr(asked_for, key):
            raise FileError(str(path), key, "it was begun with others", _AGAIN)
    check_made_on(path, saved.made_on, asked_for.made_on)
    _check_electrodes(str(path), saved)
    _check_asked(str(path), saved)
    doubted = saved.in_doubt.electrodes if saved.in_doubt is not None else frozenset[int]()
    if not doubted <= set(range(saved.conditions.electrodes)):
        raise FileError(str(path), "in_doubt", "it names what was not asked", _AGAIN)
    if saved.false_alarms > saved.catch_trials:
        why = f"{saved.false_alarms} of {saved.catch_trials} silent trials cannot be"
        raise FileError(str(path), "false_alarms", why, _AGAIN)
    return saved


def _check_electrodes(file: str, saved: FitProgress) -> None:
    conditions, electrodes = saved.conditions, saved.electrodes
    for one in electrodes:
        check_electrode(file, "electrodes", conditions, one)
        if (times := electrodes.count(one)) > 1:
            raise FileError(file, "electrodes", f"{one} is there {times} times", _AGAIN)
    if len(electrodes) < LEAST_ELECTRODES:
        why = f"{len(electrodes)} electrodes, and {LEAST_ELECTRODES} are needed"
        raise FileError(file, "electrodes", why, _AGAIN)
    for key in ("lowered_ua", "lowering_ua"):
        for one in getattr(saved, key):
            check_electrode(file, key, conditions, one)


def _check_asked(file: str, saved: FitProgress) -> None:
    """Each once, in a state that is over, and one state after another: by time, a person who adapts
    is told from one whose thresholds follow the resistance.
    """
    asked = {(one.electrode, one.state) for one in saved.asked}
    if len(asked) != len(saved.asked) or any(
        one.electrode not in saved.electrodes or not 0 <= one.state < saved.states
        for one in saved.asked
    ):
        raise FileError(file, "asked", "it has what was not asked", _AGAIN)
    in_order = sorted(saved.asked, key=lambda one: (one.state, one.at_s))
    for before, after in pairwise(in_order):
        if after.state > before.state and after.at_s <= before.at_s:
            why = f"state {after.state + 1} was not asked in after state {before.state + 1}"
            raise FileError(file, "asked", why, _AGAIN)
