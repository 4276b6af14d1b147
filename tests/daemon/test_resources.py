"""Finding what we ship."""

from __future__ import annotations

from pathlib import Path

import pytest

from etd.files import resources
from etd.protocol.errors import FileError


@pytest.mark.parametrize("kind", ["boards", "machines", "arrays", "bodysites", "calibrations"])
def test_every_shipped_name_is_found(kind: resources.Kind) -> None:
    names = resources.names(kind)
    assert names
    for name in names:
        path = resources.find(kind, name)
        assert path.is_file()
        assert path.stem == name


def test_a_name_that_is_not_there_is_answered_with_those_that_are() -> None:
    with pytest.raises(FileError, match="pi3, pi4, rig") as caught:
        resources.find("machines", "pi9")
    assert "'pi9'" in caught.value.value


def test_a_path_is_taken_as_it_is(tmp_path: Path) -> None:
    mine = tmp_path / "mine.toml"
    mine.write_text("")
    assert resources.find("boards", str(mine)) == mine
    assert resources.find("boards", "./mine.toml", tmp_path) == mine


@pytest.mark.parametrize("path", ["./pi4", "nowhere/pi4.toml", "pi4.toml", "../machines/pi4"])
def test_a_path_that_is_not_there_is_never_taken_for_a_name(
    path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(FileError, match="no such file"):
        resources.find("machines", path)


@pytest.mark.parametrize("name", ["", ".", "*"])
def test_no_name_reaches_outside_of_its_folder(name: str) -> None:
    with pytest.raises(FileError):
        resources.find("machines", name)
