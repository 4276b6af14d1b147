"""The note that outlasts an engine: written whole, found whatever it says, gone when dropped."""

from __future__ import annotations

import errno
import json
import os
from pathlib import Path
from typing import Any

import pytest

from etd_hal.supply_note import SupplyNote


@pytest.fixture
def note(tmp_path: Path) -> SupplyNote:
    return SupplyNote(tmp_path / "supply.json")


def test_there_is_none_until_it_is_kept_and_none_after_it_was_dropped(note: SupplyNote) -> None:
    assert note.left() is None
    note.drop()
    note.keep()
    note.keep()
    assert (
        note.left()
        == "the last engine was killed with the supply on, or could not make the board safe"
    )
    note.drop()
    note.drop()
    assert note.left() is None
    assert os.listdir(note.path.parent) == []


def test_keeping_and_dropping_hold_nothing_open_and_the_note_is_its_owner_s_alone(
    note: SupplyNote,
) -> None:
    """An engine keeps and drops it for as long as it lives."""
    before = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        note.keep()
        assert note.path.stat().st_mode & 0o777 == 0o600
        assert note.left() is not None
        note.try_to_keep()
        note.drop()
    assert len(os.listdir("/proc/self/fd")) == before


def test_one_of_another_boot_was_left_by_a_loss_of_power(note: SupplyNote) -> None:
    note.path.write_text(json.dumps({"boot": "another"}))
    assert note.left() == "the machine lost its power, or was reset, with the supply on"


@pytest.mark.parametrize(
    "content",
    [b"", b"{", b"[]", b"null", b"\xff\xfe", b"{}", b'{"boot": 3}', b"[" * 4_000],
)
def test_one_that_says_nothing_was_left_all_the_same(note: SupplyNote, content: bytes) -> None:
    note.path.write_bytes(content)
    assert note.left() is not None


def test_one_that_cannot_be_read_was_left(note: SupplyNote) -> None:
    note.path.mkdir()
    assert note.left() == "a note was left that cannot be read (Is a directory)"


def test_one_of_an_engine_that_a_defect_ended_says_so_in_any_boot(note: SupplyNote) -> None:
    words = "the last engine was ended by a defect of its own with the supply on"
    note.keep()
    note.keep_as_defect()
    assert note.left() == words
    assert note.path.stat().st_mode & 0o777 == 0o600
    assert os.listdir(note.path.parent) == [note.path.name]
    said = json.loads(note.path.read_text())
    note.path.write_text(json.dumps(said | {"boot": "another"}))
    assert note.left() == words
    note.path.write_text(json.dumps(said | {"ended": "otherwise"}))
    assert "was killed" in str(note.left())


def test_behind_a_folder_that_leads_nowhere_nothing_is_known(tmp_path: Path) -> None:
    (tmp_path / "round").symlink_to(tmp_path / "round")
    behind = SupplyNote(tmp_path / "round" / "supply.json")
    with pytest.raises(OSError, match="symbolic links") as caught:
        behind.path.read_bytes()
    assert caught.value.errno == errno.ELOOP
    assert behind.left() is None


def test_where_the_kernel_tells_no_boot_one_was_left_by_a_loss_of_power(
    note: SupplyNote, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Which it was cannot be known; that the supply was on is told all the same."""
    read = Path.read_text

    def refuse(path: Path, *args: Any, **options: Any) -> str:
        if path.name == "boot_id":
            raise PermissionError(errno.EACCES, "Permission denied")
        return read(path, *args, **options)

    monkeypatch.setattr(Path, "read_text", refuse)
    note.keep()
    assert note.left() == "the machine lost its power, or was reset, with the supply on"


def test_without_its_folder_it_is_not_there_and_cannot_be_kept(tmp_path: Path) -> None:
    lost = SupplyNote(tmp_path / "absent" / "supply.json")
    assert lost.left() is None
    lost.drop()
    with pytest.raises(FileNotFoundError):
        lost.keep()
    (tmp_path / "file").touch()
    under = SupplyNote(tmp_path / "file" / "supply.json")
    assert under.left() is None
    with pytest.raises(NotADirectoryError):
        under.keep()


def test_a_link_in_the_place_of_the_new_one_is_not_followed(note: SupplyNote) -> None:
    target = note.path.parent / "target"
    (note.path.parent / ".supply.json.new").symlink_to(target)
    with pytest.raises(OSError, match="symbolic links"):
        note.keep()
    assert not target.exists()


@pytest.mark.parametrize("kind", ["pipe", "second name", "folder"])
def test_what_else_is_in_its_place_is_an_error_at_once(note: SupplyNote, kind: str) -> None:
    """To open a pipe to which nobody listens would last for ever."""
    new, other = note.path.parent / ".supply.json.new", note.path.parent / "other"
    other.write_text("of somebody")
    reader = -1
    if kind == "pipe":
        os.mkfifo(new)
        with pytest.raises(OSError, match="No such device"):
            note.keep()
        reader = os.open(new, os.O_RDONLY | os.O_NONBLOCK)
    elif kind == "folder":
        new.mkdir()
    else:
        os.link(other, new)
    with pytest.raises(OSError, match=r"File exists|Is a directory"):
        note.keep()
    assert not note.path.exists()
    assert other.read_text() == "of somebody"
    if reader >= 0:
        os.close(reader)


def test_a_pipe_in_the_place_of_a_note_is_one_and_is_not_waited_for(note: SupplyNote) -> None:
    os.mkfifo(note.path)
    assert note.left() == "the machine lost its power, or was reset, with the supply on"


def test_what_an_earlier_process_left_half_written_is_written_over(note: SupplyNote) -> None:
    (note.path.parent / ".supply.json.new").write_text("x" * 1_000)
    note.keep()
    assert set(json.loads(note.path.read_text())) == {"boot"}


def test_a_system_that_takes_a_few_bytes_at_a_time_gets_all_of_them(
    note: SupplyNote, monkeypatch: pytest.MonkeyPatch
) -> None:
    write = os.write
    monkeypatch.setattr(os, "write", lambda fd, data: write(fd, data[:5]))
    note.keep()
    monkeypatch.undo()
    assert note.left() is not None
    assert "killed" in str(note.left())


def test_a_trial_leaves_nothing_and_changes_no_note_that_is_there(note: SupplyNote) -> None:
    note.try_to_keep()
    assert os.listdir(note.path.parent) == []
    note.path.write_text("as it was left")
    note.try_to_keep()
    assert os.listdir(note.path.parent) == [note.path.name]
    assert note.path.read_text() == "as it was left"
    with pytest.raises(FileNotFoundError):
        SupplyNote(note.path.parent / "absent" / "supply.json").try_to_keep()


def test_it_is_on_the_disk_before_it_counts(
    note: SupplyNote, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The file before its name, and its name before `keep` returns; the same when it is dropped."""
    calls: list[str] = []
    synced, renamed, removed = os.fsync, os.replace, os.unlink

    def sync(fd: int) -> None:
        calls.append("folder" if os.path.isdir(f"/proc/self/fd/{fd}") else "file")
        synced(fd)

    def rename(*paths: Path) -> None:
        calls.append("name")
        renamed(*paths)

    def remove(path: Path) -> None:
        calls.append("removed")
        removed(path)

    monkeypatch.setattr(os, "fsync", sync)
    monkeypatch.setattr(os, "replace", rename)
    monkeypatch.setattr(os, "unlink", remove)
    note.keep()
    assert calls == ["file", "name", "folder"]
    calls.clear()
    note.drop()
    assert calls == ["removed", "folder"]
