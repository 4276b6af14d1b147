"""Targets: the files that a person, another kit or a disk may have damaged.

Owns: configuration files by kind, calibrations, patterns, layouts. Must not know: what a file's
figures are used for.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec

from etd.cli.check import lines_of
from etd.files.array import Array, check_array, load_array
from etd.files.body_site import BodySite, load_body_site
from etd.files.calibration import load_calibration, to_toml
from etd.files.check import check_file
from etd.files.configuration import LoadedConfig, load_config
from etd.files.etactilekit import read_layout
from etd.files.pattern import MAX_FRAMES, check_pattern, load_pattern
from etd.protocol.errors import FileError, PatternError
from etd.protocol.frame import MAX_ELECTRODES
from etd_hal import ceilings
from etd_hal.boardfile import BoardFile, load_board, load_machine
from fuzz.choices import Choices
from fuzz.message_targets import calibration, check_caps
from fuzz.sentences import check_error, check_told
from fuzz.target import Target

_CONFIG = Path(__file__).resolve().parents[2] / "config"
_folder = tempfile.TemporaryDirectory(prefix="etd-fuzz-")


def stored(name: str, data: bytes) -> Path:
    """In a folder of this process."""
    path = Path(_folder.name) / name
    path.write_bytes(data)
    return path


def _check_told(path: Path, is_accepted: bool) -> None:
    """`etd check` says the same as the loader, unless it took the file for one of another kind."""
    checked = check_file(path)
    check_told(lines_of(checked))
    assert checked.error is not None or checked.summary
    assert checked.error is None or not is_accepted


# --- configuration --------------------------------------------------------------------------------


def _check_board(board: BoardFile) -> None:
    most = board.maxima
    assert 0 < most.current_ua <= ceilings.CURRENT_UA
    assert 0 < most.width_us <= ceilings.WIDTH_US
    assert 0 < most.charge_nc <= ceilings.CHARGE_NC
    assert 0 < most.rate_hz <= ceilings.RATE_HZ
    assert 0 < most.mean_current_ua <= ceilings.MEAN_CURRENT_UA
    assert 0 < most.array_mean_current_ua <= ceilings.ARRAY_MEAN_CURRENT_UA
    assert 0 < most.probe_current_ua <= ceilings.PROBE_CURRENT_UA
    assert 0 < most.probe_width_us <= ceilings.PROBE_WIDTH_US
    for wanted_ua in (0, 1, most.current_ua):
        told_ua = board.source.current_of(board.source.code_for(wanted_ua))
        assert told_ua <= wanted_ua + 1e-6
    lines = board.used_lines()
    assert len(set(lines.values())) == len(lines), "two uses of one line"


def _check_site(site: BodySite) -> None:
    most = site.maxima
    assert most.uncalibrated_current_ua <= most.current_ua <= ceilings.CURRENT_UA
    assert 0 < most.width_us <= ceilings.WIDTH_US
    assert 0 < most.charge_nc <= ceilings.CHARGE_NC
    assert 0 < most.rate_hz <= ceilings.RATE_HZ
    assert most.interval_us >= ceilings.INTERVAL_US
    assert 0 < most.mean_current_ua <= ceilings.MEAN_CURRENT_UA
    assert 0 < most.array_mean_current_ua <= ceilings.ARRAY_MEAN_CURRENT_UA
    assert 0 < most.on_us_per_s <= ceilings.ON_US_PER_S
    assert 0 < most.array_on_us_per_s <= ceilings.ARRAY_ON_US_PER_S
    assert site.defaults.width_us <= most.width_us
    assert site.defaults.rate_hz <= most.rate_hz


def _check_array(array: Array) -> None:
    assert 2 <= array.count <= MAX_ELECTRODES
    outputs = array.outputs()
    assert len(set(outputs)) == array.count
    assert all(0 <= output < MAX_ELECTRODES for output in outputs)
    assert array.pitch_mm() > 0.0
    for electrode in (0, array.count - 1):
        assert electrode not in array.neighbors(electrode)


def _check_loaded(loaded: LoadedConfig) -> None:
    assert max(loaded.array.outputs()) < loaded.board.switch.outputs
    assert set(loaded.unaccepted_guards) <= set(loaded.board.absent_guards)
    assert loaded.config.tcp is None


def _unchecked(_: object) -> None:
    """Its figures bound nothing by themselves."""


_LOADERS: tuple[tuple[str, Callable[[Path], Any], Callable[[Any], None]], ...] = (
    ("boards", load_board, _check_board),
    ("machines", load_machine, _unchecked),
    ("bodysites", load_body_site, _check_site),
    ("arrays", load_array, _check_array),
    ("", load_config, _check_loaded),
)


def _play_configuration(data: bytes) -> None:
    choices = Choices(data)
    _, load, check = choices.pick(_LOADERS)
    path = stored("any.toml", choices.taken(len(data)))
    try:
        loaded = load(path)
    except FileError as error:
        check_error(error)
        _check_told(path, False)
    else:
        check(loaded)
        _check_told(path, False)


def _configuration_seeds() -> Iterator[bytes]:
    for number, (folder, *_) in enumerate(_LOADERS):
        for path in sorted((_CONFIG / folder).glob("*.toml")):
            data = path.read_bytes()
            if len(data) < _MOST_TOML_BYTES:
                yield bytes([number]) + data


_MOST_TOML_BYTES = 8_192


# --- calibrations ---------------------------------------------------------------------------------


def _play_calibration(data: bytes) -> None:
    path = stored("calibration.toml", data)
    try:
        made = load_calibration(path)
    except FileError as error:
        check_error(error)
        return
    check_caps(made)
    assert load_calibration(stored("again.toml", to_toml(made).encode())) == made
    assert msgspec.json.decode(msgspec.json.encode(made), type=type(made)) == made
    _check_told(path, False)


#: Keys of each form that TOML has, joined by points.
_KEYS = b'a . "b" . "\\"" . \'c\' = 1\n"\\"".a = [1.5]\nx = { a.b = """\n\\"""", c."d" = 1 }\n'


def _calibration_seeds() -> Iterator[bytes]:
    yield _KEYS
    yield to_toml(calibration()).encode()
    for path in sorted((_CONFIG / "calibrations").glob("*.toml")):
        data = path.read_bytes()
        if len(data) < _MOST_TOML_BYTES:
            yield data


# --- patterns and layouts -------------------------------------------------------------------------


def _play_pattern(data: bytes) -> None:
    path = stored("pattern.json", data)
    try:
        pattern, _ = load_pattern(path)
    except PatternError as error:
        check_error(error)
        return
    assert 1 <= len(pattern.frames) <= MAX_FRAMES
    assert 1 <= pattern.electrodes <= MAX_ELECTRODES
    for frame in pattern.frames:
        assert len(frame.level) == pattern.electrodes
        assert all(0.0 <= level <= 1.0 for level in frame.level)
        assert frame.rate_hz is None or 0.1 <= frame.rate_hz <= 200.0
        assert 1 <= frame.duration_ms <= 600_000
        assert 0 <= frame.off_ms <= 600_000
    assert check_pattern(pattern) == pattern
    _check_told(path, True)


def _pattern_seeds() -> Iterator[bytes]:
    frames = [
        {"duration_ms": 100, "off_ms": 50, "level": [0.0, 0.5, 1.0, 0.25]},
        {"duration_ms": 1, "active": [0, 3], "rate_hz": 60.0, "polarity": "cathodic"},
    ]
    yield json.dumps({"etd_pattern": 1, "electrodes": 4, "frames": frames}).encode()
    frame = {
        "pattern": [0, 1, 1, 0],
        "delay": {"ON": 100, "OFF": 20},
        "params": {"frequency": 50, "stim_mode": 1},
    }
    kit = {"Pattern_Data": [[frame], [frame]], "Execution": {"count": 1}, "Speed": 2}
    yield json.dumps(kit).encode()
    yield json.dumps(kit).encode().replace(b'"count": 1}', b'"count": once,}')


def _play_layout(data: bytes) -> None:
    path = stored("layout.json", data)
    try:
        array, _ = read_layout(path)
    except FileError as error:
        check_error(error)
        return
    _check_array(array)
    assert check_array(array, "again") == array
    _check_told(path, True)


def _layout_seeds() -> Iterator[bytes]:
    points = [{"x": 2.5 * x, "y": 2.5 * y, "z": 0.1} for x in range(2) for y in range(2)]
    layout = {"electrodes": points, "Mapping_func": [3, 2, 1, 0], "electrode_radius": 0.75}
    yield json.dumps(layout).encode()
    yield json.dumps({"electrodes": [{**point, "radius": 1.0} for point in points]}).encode()
    yield json.dumps({**layout, "Electrodes_Number": 5}).encode().replace(b"5}", b"five,}")


_FORMS = tuple(
    f"hal/etd_hal/{name}.py" for name in ("tomlfile", "toml_bounds", "schema_hints", "names")
)
TARGETS = (
    Target(
        "configuration",
        "etd.toml, and files of boards, machines, body sites and arrays",
        _play_configuration,
        _configuration_seeds,
        (
            *_FORMS,
            *("hal/etd_hal/boardfile.py", "hal/etd_hal/ceilings.py"),
            *(f"daemon/etd/files/{name}.py" for name in ("configuration", "array", "body_site")),
            "daemon/etd/stabilize/*settings.py",
        ),
        most_bytes=_MOST_TOML_BYTES,
    ),
    Target(
        "calibrations",
        "files of persons' calibrations",
        _play_calibration,
        _calibration_seeds,
        (*_FORMS, "daemon/etd/files/calibration.py", "daemon/etd/protocol/calibration.py"),
        most_bytes=_MOST_TOML_BYTES,
    ),
    Target(
        "patterns",
        "pattern files, ours and eTactileKit's",
        _play_pattern,
        _pattern_seeds,
        (*_FORMS, *(f"daemon/etd/files/{name}.py" for name in ("pattern", "json_file"))),
    ),
    Target(
        "layouts",
        "layout files of eTactileKit",
        _play_layout,
        _layout_seeds,
        (*_FORMS, *(f"daemon/etd/files/{name}.py" for name in ("etactilekit", "json_file"))),
    ),
)
