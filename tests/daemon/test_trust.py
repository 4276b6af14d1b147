"""Folders of somebody else's, and links that somebody has put in the place of a file.

Owns: that nothing is written through them, and that each is a sentence. Most need root, who alone
can give a folder away.
"""

from __future__ import annotations

import os
import socket
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

from etd.calibrate.progress import save_progress
from etd.cli.new_file import check_new_file, write_new_file
from etd.files import paths
from etd.files.atomic_file import write_atomically
from etd.files.calibration import load_calibration
from etd.files.calibration_folder import CalibrationFolder
from etd.files.exclusive import NameLock
from etd.files.resources import find
from etd.files.trust import check_beyond, make_own, open_unshared
from etd.gateway.config import GatewayConfig
from etd.gateway.record_store import RecordStore
from etd.gateway.server import Gateway
from etd.protocol.errors import EtdError, FileError, Refused
from etd.protocol.peer import Peer
from gateway_rig import HandClock

STRANGER = 65_533
CALIBRATION = load_calibration(find("calibrations", "fake-fingertip"))
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")


@pytest.fixture
def root() -> Iterator[Path]:
    with tempfile.TemporaryDirectory(prefix="etd-") as made:
        yield Path(made)


@pytest.fixture
def victim(root: Path) -> Path:
    """A file that is not the daemon's."""
    path = root / "victim"
    path.write_text("precious\n", encoding="utf-8")
    path.chmod(0o600)
    return path


def strangers(folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    os.chown(folder, STRANGER, STRANGER)
    return folder


def config(root: Path) -> GatewayConfig:
    return GatewayConfig(name="x", runtime_folder=root / "run", state_dir=root / "state")


@needs_root
def test_a_runtime_folder_of_somebody_elses_is_refused_and_nothing_is_written_through_a_link(
    root: Path, victim: Path
) -> None:
    folder = strangers(root / "run")
    (folder / "gateway.lock").symlink_to(victim)
    with pytest.raises(FileError, match="belongs to somebody else"):
        Gateway(config(root), HandClock())
    assert victim.read_text(encoding="utf-8") == "precious\n"


@needs_root
def test_a_folder_below_one_of_somebody_elses_is_refused(root: Path) -> None:
    strangers(root / "theirs")
    with pytest.raises(FileError, match="with --folder, or with XDG_RUNTIME_DIR"):
        paths.prepare_runtime(root / "theirs" / "run")
    assert list((root / "theirs").iterdir()) == [], "nor is one made there"


@needs_root
def test_a_link_of_somebody_elses_to_a_folder_of_ours_is_refused(root: Path) -> None:
    ours, link = root / "ours", root / "run"
    ours.mkdir()
    link.symlink_to(ours)
    os.chown(link, STRANGER, STRANGER, follow_symlinks=False)
    with pytest.raises(FileError, match="this link belongs to somebody else"):
        paths.prepare_runtime(link)


def test_a_link_of_ours_to_a_folder_of_ours_is_followed(root: Path) -> None:
    (root / "ours").mkdir()
    (root / "run").symlink_to("ours")
    (root / "all").symlink_to(root)
    paths.prepare_runtime(root / "all" / "run")
    paths.prepare_runtime(root / "ours" / ".." / "ours")


def test_links_without_an_end_are_told(root: Path) -> None:
    (root / "a").symlink_to("b")
    (root / "b").symlink_to("a")
    with pytest.raises(FileError):
        paths.prepare_runtime(root / "a")


def test_a_folder_above_that_everybody_may_write_to_is_refused(root: Path) -> None:
    (root / "open" / "run").mkdir(parents=True)
    (root / "open").chmod(0o777)
    with pytest.raises(FileError, match="everybody may write"):
        paths.prepare_runtime(root / "open" / "run")
    (root / "open").chmod(0o1777)
    paths.prepare_runtime(root / "open" / "run")
    with pytest.raises(FileError, match="choose a folder of your own in it"):
        paths.prepare_runtime(root / "open")


@pytest.mark.parametrize("folder", ["/dev/null/x", "/dev/null", "/etc/passwd", "/etc/passwd/x"])
def test_what_is_no_folder_is_told_and_no_rights_of_it_are_to_be_changed(folder: str) -> None:
    """Whoever followed `chmod o-w /dev/null` as root would break the machine."""
    with pytest.raises(FileError, match="this is no folder; name a folder") as caught:
        paths.prepare_runtime(Path(folder))
    assert "chmod" not in str(caught.value)
    assert "XDG" not in str(caught.value)
    with pytest.raises(FileError, match="this is no folder") as caught:
        check_beyond(Path(folder), Peer(STRANGER, (STRANGER,)))
    assert "chmod" not in str(caught.value)


@needs_root
def test_a_folder_that_a_strange_group_may_write_to_is_refused(root: Path) -> None:
    (root / "run").mkdir()
    os.chown(root / "run", 0, STRANGER)
    (root / "run").chmod(0o770)
    with pytest.raises(FileError, match="the group 65533 may write"):
        paths.prepare_runtime(root / "run")


@needs_root
def test_folders_that_systemd_laid_out_belong_to_the_services(root: Path) -> None:
    (root / "etd").mkdir()
    folder = strangers(root / "etd" / "main")
    folder.chmod(0o771)
    make_own(folder, 0o750, laid_out=(root / "etd",))
    with pytest.raises(FileError):
        make_own(folder, 0o750)


@needs_root
def test_there_no_link_is_followed(root: Path) -> None:
    (root / "etd").mkdir()
    (root / "etd" / "main").symlink_to(root)
    with pytest.raises(FileError, match="a link"):
        make_own(root / "etd" / "main", 0o750, laid_out=(root / "etd",))


@pytest.mark.parametrize("kind", ["link", "hard link", "pipe", "dangling"])
def test_a_lock_is_a_file_of_its_own(root: Path, victim: Path, kind: str) -> None:
    lock = root / "gateway.lock"
    if kind == "link":
        lock.symlink_to(victim)
    elif kind == "dangling":
        lock.symlink_to(root / "made")
    elif kind == "hard link":
        lock.hardlink_to(victim)
    else:
        os.mkfifo(lock)
    with pytest.raises(FileError, match="in the place of a file; remove it"):
        NameLock(root, "x")
    assert victim.read_text(encoding="utf-8") == "precious\n"
    assert not (root / "made").exists()


@needs_root
def test_a_lock_that_root_has_made_is_the_folders_owners(root: Path) -> None:
    """The service, which has the folder, could not open it afterwards."""
    NameLock(strangers(root / "kept"), "x").close()
    assert (root / "kept" / "gateway.lock").stat().st_uid == STRANGER


@needs_root
@pytest.mark.parametrize("below", [".", "calibrations"])
def test_a_calibration_is_not_written_for_somebody_else(root: Path, below: str) -> None:
    strangers(root / "state" / below)
    store = CalibrationFolder(root / "state" / "calibrations", None)
    with pytest.raises(Refused, match="belongs to somebody else") as told:
        store.put("p01", CALIBRATION)
    assert told.value.code == "bad_calibration"


@needs_root
@pytest.mark.parametrize("below", [".", "records"])
def test_nor_is_a_record(root: Path, below: str) -> None:
    strangers(root / "state" / below)
    with pytest.raises(Refused, match="belongs to somebody else") as told:
        RecordStore(root / "state").create("r")
    assert told.value.code == "record_failed"


@needs_root
def test_a_link_in_the_place_of_the_calibrations_is_refused(root: Path) -> None:
    (root / "state").mkdir()
    (root / "etc").mkdir()
    (root / "state" / "calibrations").symlink_to(root / "etc")
    os.chown(root / "state" / "calibrations", STRANGER, STRANGER, follow_symlinks=False)
    with pytest.raises(Refused):
        CalibrationFolder(root / "state" / "calibrations", None).put("passwd", CALIBRATION)
    assert list((root / "etc").iterdir()) == []


@needs_root
def test_an_unfinished_calibration_is_not_saved_for_somebody_else(root: Path) -> None:
    strangers(root / "state")
    with pytest.raises(EtdError, match="belongs to somebody else"):
        save_progress(root / "state" / "calibrating" / "p01.json", None)  # type: ignore[arg-type]
    assert list((root / "state").iterdir()) == []


def test_a_record_is_not_read_through_a_link(root: Path, victim: Path) -> None:
    (root / "state" / "records").mkdir(parents=True)
    (root / "state" / "records" / "r.jsonl").symlink_to(victim)
    with pytest.raises(Refused):
        RecordStore(root / "state").piece("r", 0)


def test_what_is_written_atomically_has_its_mode_and_replaces_a_link(
    root: Path, victim: Path
) -> None:
    (root / "file").symlink_to(victim)
    write_atomically(root / "file", b"new", mode=0o640)
    assert (root / "file").read_bytes() == b"new"
    assert (root / "file").lstat().st_mode & 0o777 == 0o640
    assert victim.stat().st_mode & 0o777 == 0o600


def test_a_socket_of_the_engine_has_its_mode_from_the_start(root: Path) -> None:
    from etd.protocol.link import Listener, socket_paths

    listener = Listener(root)
    for path in socket_paths(root):
        assert path.stat().st_mode & 0o777 == 0o660
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
            probe.connect(str(path))
    listener.close()


def test_a_file_that_came_meanwhile_is_neither_written_nor_followed(
    root: Path, victim: Path
) -> None:
    out = root / "out.txt"
    check_new_file(out)
    out.symlink_to(victim)
    with pytest.raises(FileError, match="it exists"):
        write_new_file(out, "new")
    assert victim.read_text(encoding="utf-8") == "precious\n"
    write_new_file(root / "other.txt", "new")
    assert (root / "other.txt").read_text(encoding="utf-8") == "new"


def test_below_a_folder_of_the_services_a_files_owner_and_group_may_write_it(
    tmp_path: Path,
) -> None:
    path = tmp_path / "p01.toml"
    path.write_text("x")
    path.chmod(0o664)
    if os.geteuid() == 0:
        os.chown(path, 65_533, 65_534)
        with pytest.raises(FileError, match="belongs to user 65533"):
            open_unshared(path)
    os.close(open_unshared(path, (tmp_path,)))
    path.chmod(0o666)
    with pytest.raises(FileError, match="everybody may write it"):
        open_unshared(path, (tmp_path,))
