"""Where daemons are found by name.

Owns: the order of system and user folders, and who counts as running.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import socket
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from etd.files import paths
from etd.protocol.errors import FileError


@pytest.fixture
def folders(monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A short root: the path of a Unix socket is bounded."""
    with tempfile.TemporaryDirectory(prefix="etd-") as root:
        monkeypatch.setattr(paths, "SYSTEM_RUNTIME", Path(root) / "run")
        monkeypatch.setattr(paths, "SYSTEM_STATE", Path(root) / "lib")
        monkeypatch.setenv("XDG_RUNTIME_DIR", f"{root}/user")
        monkeypatch.setenv("XDG_STATE_HOME", f"{root}/state")
        yield Path(root)


def listen(folder: Path) -> socket.socket:
    folder.mkdir(parents=True, exist_ok=True)
    listening = socket.socket(socket.AF_UNIX)
    listening.bind(str(folder / "control.sock"))
    listening.listen()
    return listening


def test_a_user_has_folders_of_their_own(folders: Path) -> None:
    assert paths.runtime_folder("main") == folders / "user/etd/main"
    assert paths.state_folder("main") == folders / "state/etd/main"
    assert paths.control_address("main") == f"ipc://{folders}/user/etd/main/control.sock"


def test_a_folder_that_systemd_laid_out_comes_first(folders: Path) -> None:
    for kind in ("run", "lib"):
        (folders / kind / "main").mkdir(parents=True)
    assert paths.runtime_folder("main") == folders / "run/main"
    assert paths.state_folder("main") == folders / "lib/main"
    assert "user" in paths.control_address("main"), "nobody has a socket there yet"
    (folders / "run/main/control.sock").touch()
    assert paths.control_address("main") == f"ipc://{folders}/run/main/control.sock"


def test_without_a_runtime_folder_of_the_session_the_temporary_one_serves(
    folders: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setattr(tempfile, "tempdir", str(folders))
    assert paths.runtime_folder("x") == folders / f"etd-{os.getuid()}/x"

    (folders / f"etd-{os.getuid()}").symlink_to("/")
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    (folders / "etd-12345").mkdir()
    with pytest.raises(FileError, match="belongs to somebody else"):
        paths.runtime_folder("x")


def test_only_daemons_that_answer_are_running(folders: Path) -> None:
    here = [listen(folders / where) for where in ("user/etd/main", "user/etd/b", "run/main")]
    (folders / "user/etd/dead").mkdir()
    left = listen(folders / "user/etd/dead")
    left.close()

    found = [daemon.name for daemon in paths.find_daemons()]
    assert found == ["main", "b", "main"], "two of one name are two, the system's first"
    for listening in here:
        listening.close()
    assert paths.find_daemons() == []


@pytest.mark.parametrize("user", [0, 4321])
def test_root_finds_the_daemons_of_every_user_and_others_their_own(
    folders: Path, monkeypatch: pytest.MonkeyPatch, user: int
) -> None:
    monkeypatch.setattr(paths, "USER_RUNTIMES", folders / "sessions")
    monkeypatch.setattr(tempfile, "tempdir", str(folders / "tmp"))
    monkeypatch.setattr(os, "geteuid", lambda: user)
    here = [
        listen(folders / where)
        for where in (
            "user/etd/own",
            "sessions/1000/etd/theirs",
            f"tmp/etd-{os.getuid()}/without-session",
            f"tmp/etd-{os.getuid() + 1}/somebody-elses-trap",
            "tmp/etd-x1/private",
        )
    ]
    found = [daemon.name for daemon in paths.find_daemons()]
    found += [daemon.name for daemon in paths.find_daemons_of_others().daemons]
    assert found == (["own", "theirs", "without-session"] if user == 0 else ["own"])
    for listening in here:
        listening.close()


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_of_another_user_root_asks_a_few_after_its_own_and_says_how_many_not(
    folders: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(paths, "USER_RUNTIMES", folders / "sessions")
    monkeypatch.setattr(tempfile, "tempdir", str(folders / "tmp"))
    with ExitStack() as stack:
        for number in range(20):
            folder = folders / f"sessions/1000/etd/a{number}"
            stack.enter_context(listen(folder))
            os.chown(folder.parent, 65_533, 65_533)
        for where in ("user/etd/own", "run/main"):
            stack.enter_context(listen(folders / where))
        stack.enter_context(listen(folders / "sessions/1000/etd/$(reboot)"))
        found = paths.find_daemons()
        others = paths.find_daemons_of_others()
    assert [daemon.name for daemon in found] == ["main", "own"]
    assert len(others.daemons) == paths.MOST_OF_A_USER
    (told,) = others.not_asked
    assert f"`etd stop --folder {folders}/sessions/1000/etd/a" in told
    assert "of the user 65533 that were not asked: 12;" in told
    assert all("reboot" not in daemon.name for daemon in others.daemons)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_one_user_takes_no_other_users_place_by_folders_of_many_names(
    folders: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A name that is read as the same number is no name of a daemon's folder; and what one user
    has in several folders counts together.
    """
    monkeypatch.setattr(paths, "USER_RUNTIMES", folders / "sessions")
    monkeypatch.setattr(tempfile, "tempdir", str(folders / "tmp"))
    stranger = 2_000
    names = ("2000", "02000", "002000", "0002000", "00002000", "\u0662\u0660\u0660\u0660")
    theirs = [f"tmp/etd-{name}" for name in names] + ["sessions/2000/etd", "sessions/2001/etd"]
    with ExitStack() as stack:
        for parent, number in itertools.product(theirs, range(10)):
            stack.enter_context(listen(folders / parent / f"a{number}"))
        for parent in theirs:
            os.chown(folders / parent, stranger, stranger)
        for victim in (65_532, 65_533):
            stack.enter_context(listen(folders / f"tmp/etd-{victim}" / "victim"))
            os.chown(folders / f"tmp/etd-{victim}", victim, victim)
        others = paths.find_daemons_of_others()
    found = [daemon.name for daemon in others.daemons]
    assert found.count("victim") == 2
    assert len(found) == 2 + paths.MOST_OF_A_USER
    (told,) = others.not_asked
    assert f"of the user 2000 that were not asked: {3 * 10 - paths.MOST_OF_A_USER};" in told


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_of_many_users_each_is_asked_once_before_any_is_asked_twice(
    folders: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(paths, "USER_RUNTIMES", folders / "sessions")
    monkeypatch.setattr(tempfile, "tempdir", str(folders / "tmp"))
    users = range(2_000, 2_000 + paths.MOST_OF_OTHERS + 2)
    with ExitStack() as stack:
        for uid in users:
            for number in range(3):
                stack.enter_context(listen(folders / f"tmp/etd-{uid}" / f"a{number}"))
            os.chown(folders / f"tmp/etd-{uid}", uid, uid)
        others = paths.find_daemons_of_others()
    assert [daemon.name for daemon in others.daemons] == ["a0"] * paths.MOST_OF_OTHERS
    assert len(others.not_asked) == len(users)
    assert "of the user 2033 that were not asked: 3;" in others.not_asked[-1]


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a folder away")
def test_what_another_user_names_as_the_session_of_root_is_that_users(
    folders: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(paths, "USER_RUNTIMES", folders / "sessions")
    monkeypatch.setattr(tempfile, "tempdir", str(folders / "tmp"))
    with listen(folders / "user/etd/theirs"):
        os.chown(folders / "user/etd", 65_533, 65_533)
        assert paths.find_daemons() == []
        assert [daemon.name for daemon in paths.find_daemons_of_others().daemons] == ["theirs"]


def test_what_somebody_else_put_in_our_place_hides_no_daemon_of_the_system(
    folders: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("XDG_RUNTIME_DIR")
    monkeypatch.setattr(tempfile, "tempdir", str(folders))
    monkeypatch.setattr(os, "getuid", lambda: 12345)
    (folders / "etd-12345").mkdir()
    with listen(folders / "run/main"):
        assert [daemon.name for daemon in paths.find_daemons()] == ["main"]


def test_a_daemon_that_many_are_connecting_to_is_there_and_is_not_waited_for(
    folders: Path,
) -> None:
    path = folders / "busy.sock"
    with socket.socket(socket.AF_UNIX) as listening, ExitStack() as stack:
        listening.bind(str(path))
        listening.listen(0)
        for _ in range(4):
            waiting = stack.enter_context(socket.socket(socket.AF_UNIX))
            waiting.setblocking(False)
            with contextlib.suppress(BlockingIOError):
                waiting.connect(str(path))
        assert paths.why_unreachable(path) is None


def test_why_a_socket_cannot_be_reached_is_a_clause(folders: Path) -> None:
    listen(folders / "user/etd/dead").close()
    assert paths.why_unreachable(folders / "none") == "there is no socket"
    assert "left over" in str(paths.why_unreachable(folders / "user/etd/dead/control.sock"))


def test_a_path_too_long_for_a_socket_is_refused(tmp_path: Path) -> None:
    with pytest.raises(FileError, match="at most 107 bytes"):
        paths.prepare_runtime(tmp_path / ("x" * 100))
    assert not (tmp_path / ("x" * 100)).exists()


def test_a_runtime_folder_that_cannot_be_made_is_told_with_what_to_do(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(FileError, match="this is no folder; name a folder"):
        paths.prepare_runtime(tmp_path / "file" / "main")
    with pytest.raises(FileError, match=r"cannot be made .* --folder, or with XDG_RUNTIME_DIR"):
        paths.prepare_runtime(Path("/proc/nope"))


def test_a_runtime_folder_is_for_its_group(tmp_path: Path) -> None:
    with tempfile.TemporaryDirectory() as root:
        paths.prepare_runtime(Path(root) / "main")
        assert (Path(root) / "main").stat().st_mode & 0o777 == 0o750
