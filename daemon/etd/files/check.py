"""Tells what a file is and whether it holds together, for every kind of file there is.

Owns: recognizing a kind by its content, and the one sentence about each. Must not know: the rules
themselves (each kind's own module has them), how the answer is printed.
"""

from __future__ import annotations

import codecs
import datetime
from collections.abc import Callable
from pathlib import Path

import msgspec

from etd.files import etactilekit, pattern
from etd.files.array import ARRAY_FOR_COUNT, Array, load_array
from etd.files.body_site import BodySite, load_body_site, passes_yardstick, yardstick_nc
from etd.files.calibration import load_calibration
from etd.files.configuration import EtdConfig, load_config
from etd.files.json_file import read_json
from etd.files.raises_in_words import raises_in_words
from etd.files.resources import find
from etd.protocol.adaptation import why_not_raised
from etd.protocol.calibration import Calibration
from etd.protocol.errors import EtdError
from etd.stabilize.settings import BY_RESISTANCE, Settings
from etd_hal.boardfile import BoardFile, MachineFile, load_board, load_machine
from etd_hal.errors import FileError
from etd_hal.tomlfile import read_toml


class Checked(msgspec.Struct, frozen=True, kw_only=True):
    """What was found in one file. `error` None: it holds together; then `summary` says what it is.

    `kind` is "" where the file could not be recognized.
    """

    file: str
    kind: str = ""
    name: str = ""
    summary: str = ""
    mended: tuple[str, ...] = ()
    #: Of a calibration: what speaks against its figures, though they hold together.
    doubts: tuple[str, ...] = ()
    error: str | None = None


#: Of the keys of a file that is of no kind, so many are told.
_MOST_KEYS = 8
#: A name, a sentence about the content, and what was mended.
Answer = tuple[str, str, tuple[str, ...]]


def check_file(path: Path, today: datetime.date | None = None) -> Checked:
    """Recognize and check one file; what is wrong with it is in the answer, never raised. `today`:
    where it is known, nothing is of a later day.
    """
    kind = ""
    try:
        kind, check = _recognize(path, today)
        name, summary, mended = check()
    except EtdError as error:
        return Checked(file=str(path), kind=kind, error=str(error))
    return Checked(file=str(path), kind=kind, name=name, summary=summary, mended=mended)


def _recognize(path: Path, today: datetime.date | None) -> tuple[str, Callable[[], Answer]]:
    begin = _first_bytes(path).removeprefix(codecs.BOM_UTF8).lstrip()
    is_json = path.suffix == ".json" or (path.suffix != ".toml" and begin[:1] in (b"{", b"["))
    return _recognize_json(path) if is_json else _recognize_toml(path, today)


def _first_bytes(path: Path) -> bytes:
    try:
        if path.exists() and not path.is_file():
            raise FileError(str(path), "", "it is not a file", "name a file")
        with path.open("rb") as file:
            return file.read(256)
    except FileNotFoundError:
        raise FileError(str(path), "", "there is no such file", "name one that exists") from None
    except OSError as error:
        raise FileError(str(path), "", f"it cannot be read ({error})", "check it") from error


def _recognize_json(path: Path) -> tuple[str, Callable[[], Answer]]:
    data, mended = read_json(path)
    if pattern.is_pattern(data):
        return "pattern", lambda: _pattern(data, mended, path)
    if etactilekit.is_pattern(data):
        return "eTactileKit pattern", lambda: _pattern(data, mended, path)
    if etactilekit.is_layout(data):
        return "eTactileKit layout", lambda: _layout(data, mended, path)
    raise FileError(
        str(path), "", "it is no kind of JSON file that is known here",
        "a pattern has etd_pattern or Pattern_Data, a layout has electrodes",
    )  # fmt: skip


def _recognize_toml(path: Path, today: datetime.date | None) -> tuple[str, Callable[[], Answer]]:
    """By the keys at the top, so that a file with a typo is still known for what it is."""
    keys = set(read_toml(path))
    scores = {kind: len(keys & _own_keys(struct)) for kind, (struct, _) in _TOML_KINDS.items()}
    best = sorted(scores, key=lambda kind: scores[kind], reverse=True)
    if scores[best[0]] == scores[best[1]]:
        raise FileError(
            str(path),
            "",
            f"its keys are those of no kind of file ({_in_short(keys)})",
            f"the kinds are {', '.join(_TOML_KINDS)}",
        )
    struct, check = _TOML_KINDS[best[0]]
    if struct is Calibration:
        return best[0], lambda: _calibration(path, today)
    return best[0], lambda: check(path)


def _in_short(keys: set[str]) -> str:
    told = ", ".join(sorted(keys)[:_MOST_KEYS]) or "it has none"
    more = len(keys) - _MOST_KEYS
    return f"{told} and {more} more" if more > 0 else told


def _own_keys(struct: type[msgspec.Struct]) -> set[str]:
    return set(struct.__struct_fields__) - {"name", "title", "source_of_facts"}


def _board(path: Path) -> Answer:
    board = load_board(path)
    absent = ", ".join(board.absent_guards) or "none"
    summary = (
        f"{board.switch.chip} with {board.switch.outputs} outputs,"
        f" {board.source.full_scale_ua} uA full scale; absent guards: {absent}"
    )
    return board.name, summary, ()


def _machine(path: Path) -> Answer:
    machine = load_machine(path)
    word = machine.word_us
    return machine.name, f"{machine.title}: {word.low} to {word.high} us a word", ()


def _array(path: Path) -> Answer:
    array = load_array(path)
    return array.name, _about(array), ()


def _layout(data: object, mended: tuple[str, ...], path: Path) -> Answer:
    array, assumed = etactilekit.layout_to_array(data, path)
    return array.name, _about(array), mended + assumed


def _about(array: Array) -> str:
    return (
        f"{array.count} electrodes of {array.diameter_mm:g} mm, {array.pitch_mm():.4g} mm apart,"
        f" outputs up to {max(array.outputs())}"
    )


def _body_site(path: Path) -> Answer:
    site = load_body_site(path)
    line_nc = yardstick_nc(site.electrode_diameter_mm)
    side = "within" if passes_yardstick(site) else "BEYOND"
    summary = (
        f"{site.maxima.uncalibrated_current_ua} uA until calibrated, then"
        f" {site.maxima.current_ua} uA; {site.maxima.charge_nc} nC a phase, {side} the yardstick"
        f" of about {round(line_nc, -1):.0f} nC for {site.electrode_diameter_mm:g} mm;"
        f" {_stabilized(site.stabilize)}{_raised(site)}{_balanced(site)}"
    )
    return site.name, summary, ()


def _raised(site: BodySite) -> str:
    if not site.felt_may_raise:
        return ""
    return (
        "; the word of a person who feels less in use may RAISE levels, NOT recommended (harm on"
        " some modelled bodies, docs/stabilization.md)"
    )


def _balanced(site: BodySite) -> str:
    if site.balance is None:
        return ""
    return (
        "; frames that would leave too much direct current get BOTH phases, which feels different"
    )


def _stabilized(settings: Settings) -> str:
    """All that is in force there, in the order that it asks; then what belongs to every pulse."""
    parts = [f"stabilized by {', '.join(settings.order) or 'nothing'}"]
    if judged := [name for name in settings.order if name in ("contact", *BY_RESISTANCE)]:
        parts.append(
            f"{' and '.join(judged)} NOT recommended (harm on some modelled bodies,"
            " docs/stabilization.md)"
        )
    if settings.before_contact:
        behind = " and ".join(settings.before_contact)
        parts.append(
            f"contact stands BEHIND {behind}: put it before, for they reckon with what it leaves"
        )
    if settings.power_law is not None:
        parts.append("power_law only for a person with a k (etd calibrate CODE --fit)")
    if settings.probe_first:
        parts.append("a probe before every pulse")
    if settings.bursts is not None:
        parts.append(f"bursts of {settings.bursts.pulses} at {settings.bursts.rate_hz:g} Hz")
    return "; ".join(parts)


def _calibration(path: Path, today: datetime.date | None = None) -> Answer:
    calibration = load_calibration(path)
    _check_count(calibration, path)
    caps_ua = [limits.cap_ua for limits in calibration.electrode]
    summary = (
        f"{len(caps_ua)} electrodes of {calibration.array} on the {calibration.body_site},"
        f" {calibration.polarity}, {calibration.width_us} us, caps up to {max(caps_ua, default=0)}"
        f" uA; {_k_of(calibration, today)}{_raises(calibration, today)}"
    )
    return calibration.participant, summary, ()


def _k_of(calibration: Calibration, today: datetime.date | None) -> str:
    """Of which board it holds the file says itself: which one is here, it does not. A day that is
    still to come is a doubt: the engine knows no date.
    """
    exponent = calibration.exponent
    if exponent is None:
        return "no k"
    if (why := exponent.why_not_in(calibration.date)) is not None:
        return f"power_law is not for this person: {why}"
    usable = f"k = {exponent.k:.2f} for power_law on {exponent.board} ({exponent.leak_ohm} ohm)"
    doubt = exponent.why_not_in(calibration.date, today)
    return usable if doubt is None else f"{usable}, in doubt: {doubt}"


def _raises(calibration: Calibration, today: datetime.date | None) -> str:
    """Where it was measured whether this person feels less in use."""
    if calibration.adaptation is None:
        return ""
    why = why_not_raised(calibration.adaptation, calibration.date)
    doubt = why_not_raised(calibration.adaptation, calibration.date, today) if why is None else None
    return f"; {raises_in_words(why, calibration.adaptation)}" + (
        "" if doubt is None else f", in doubt: {doubt}"
    )


def _check_count(calibration: Calibration, path: Path) -> None:
    """Only for a shipped array: where another one lies, the file does not say."""
    if calibration.array not in ARRAY_FOR_COUNT.values():
        return
    count = load_array(find("arrays", calibration.array)).count
    if len(calibration.electrode) != count:
        raise FileError(
            str(path),
            "electrode",
            f"{len(calibration.electrode)} electrodes, {calibration.array} has {count}",
            "give the limits of each electrode",
        )


def _config(path: Path) -> Answer:
    loaded = load_config(path)
    missing = ", ".join(loaded.unaccepted_guards)
    arming = f"arming will be refused, not accepted: {missing}" if missing else "it may be armed"
    summary = (
        f"{loaded.board.name} with {loaded.array.name} on the {loaded.body_site.name}"
        f" ({loaded.config.backend}); {arming}"
    )
    return path.stem, summary, loaded.mended


def _pattern(data: object, mended: tuple[str, ...], path: Path) -> Answer:
    content, notes = pattern.pattern_of(data, mended, str(path))
    most = max(len(frame.active) for frame in content.frames)
    summary = (
        f"{len(content.frames)} frames for {content.electrodes} electrodes,"
        f" {content.duration_ms / 1000:g} s, up to {most} active"
    )
    return path.stem, summary, notes


_TOML_KINDS: dict[str, tuple[type[msgspec.Struct], Callable[[Path], Answer]]] = {
    "board": (BoardFile, _board),
    "machine": (MachineFile, _machine),
    "array": (Array, _array),
    "body site": (BodySite, _body_site),
    "calibration": (Calibration, _calibration),
    "configuration": (EtdConfig, _config),
}
