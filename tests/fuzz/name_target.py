"""Target: the name of a daemon, a calibration or a record, as it is typed or as a folder has it.

Owns: that what is taken for a name is one part of a path, inside the folder that it is for, and
that what is not ends in a sentence. Must not know: what the files are for.
"""

from __future__ import annotations

import os
import string
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import get_args

from etd.cli import record_source
from etd.files import paths, resources
from etd.files.named_files import names_in
from etd.protocol.errors import FileError
from etd.protocol.text import shown
from fuzz.choices import Choices
from fuzz.sentences import check_line
from fuzz.target import Target

_NAMED = frozenset(string.ascii_letters + string.digits + "-_")
#: With the length of a name, and what of its path is the folder that it is in.
_MADE: tuple[tuple[Callable[[str], Path], int], ...] = (
    (paths.runtime_folder, 1),
    (paths.state_folder, 1),
    (lambda name: paths.kept_calibrations(name)[0], 1),
    (lambda name: paths.kept_calibrations(name)[1], 2),
    (lambda name: paths.calibrating_file("main", name), 1),
    (lambda name: paths.calibrating_file(name, "P01", ".fit"), 3),
    (lambda name: paths.selftest_file(name, "fake", "0" * 8), 2),
    (lambda name: paths.supply_note_file(name, "fake", None), 2),
)
_FOLDER = tempfile.TemporaryDirectory(prefix="etd-fuzz-")


def _play(data: bytes) -> None:
    choices = Choices(data)
    kind = choices.pick(get_args(resources.Kind))
    # As the kernel hands it to a program: bytes that are no UTF-8 are kept.
    name = os.fsdecode(choices.taken(len(data)))
    is_name = _check_name(name)
    for make, depth in _MADE:
        _check_path(make, depth, name, is_name)
    if is_name:
        assert not record_source.is_file(name)
    _check_in_folder(name, is_name)
    _check_shipped(kind, name, is_name)


def _check_name(name: str) -> bool:
    try:
        assert paths.check_name(name) == name
    except FileError as error:
        _check_told(error)
        assert not (0 < len(name) <= 32 and _NAMED.issuperset(name)), name
        return False
    assert 0 < len(name) <= 32
    assert _NAMED.issuperset(name), name
    return True


def _check_path(make: Callable[[str], Path], depth: int, name: str, is_name: bool) -> None:
    other = make("other")
    try:
        path = make(name)
    except FileError as error:
        _check_told(error)
        assert not is_name
        return
    assert is_name, path
    assert path.parts[:-depth] == other.parts[:-depth]
    assert len(path.parts) == len(other.parts)
    assert os.path.normpath(path) == str(path)


def _check_in_folder(name: str, is_name: bool) -> None:
    """Of a file of that name in a daemon's folder."""
    if os.sep in name:
        return
    folder = Path(_FOLDER.name)
    path = os.path.join(folder, f"{name}.toml")
    try:
        descriptor = os.open(path, os.O_CREAT | os.O_WRONLY, 0o600)
    except (OSError, ValueError):  # what no file can be called
        return
    os.close(descriptor)
    try:
        assert names_in(folder, ".toml") == ([name] if is_name else [])
    finally:
        os.unlink(path)


def _check_shipped(kind: resources.Kind, name: str, is_name: bool) -> None:
    try:
        path = resources.find(kind, name, Path(_FOLDER.name))
    except FileError as error:
        _check_told(error)
        assert name not in resources.names(kind)
        return
    except OSError:  # a path that is too long: opening the file reports it
        assert not is_name
        return
    assert path.is_file()
    assert not is_name or path.parent == resources.config_dir() / kind


def _check_told(error: FileError) -> None:
    said = shown(str(error))  # as the commands print it
    check_line(said)
    said.encode()


def _seeds() -> Iterator[bytes]:
    kinds = get_args(resources.Kind)
    for number, kind in enumerate(kinds):
        for name in resources.names(kind):
            yield bytes([number]) + name.encode()
    for name in ("main", "P01", "p01\n", "../main", ".", "p01.jsonl", "a" * 33, "\x1b[2J", "é"):
        yield b"\0" + name.encode()


TARGETS = (
    Target(
        "names",
        "names of daemons, calibrations and records, and of shipped files",
        _play,
        _seeds,
        (
            *(f"daemon/etd/files/{name}.py" for name in ("paths", "named_files", "resources")),
            *("daemon/etd/protocol/text.py", "daemon/etd/cli/record_source.py"),
        ),
        most_bytes=512,
    ),
)
