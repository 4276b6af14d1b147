"""Where a daemon of a given name keeps its sockets and its state, and which daemons there are.

Owns: the one rule for folders and addresses, used by gateway, client and command line.
Must not know: ZeroMQ, what is said at an address.

A daemon run by systemd has /run/etd/NAME and /var/lib/etd/NAME, laid out before it starts. One
run by a user has $XDG_RUNTIME_DIR/etd/NAME (or a folder of that user's in the temporary folder)
and $XDG_STATE_HOME/etd/NAME (or ~/.local/state/etd/NAME). Calibrations are in that state's folder
`calibrations`; those of a daemon run by systemd, whose state is the gateway's, in
/var/lib/etd-calibrations/NAME, which the gateway cannot write.
"""

from __future__ import annotations

import contextlib
import itertools
import os
import re
import socket
import tempfile
from pathlib import Path
from typing import Literal, NamedTuple

from etd.files import trust
from etd.protocol.errors import FileError
from etd.protocol.text import NAME_PATTERN

DEFAULT_NAME = "main"
SYSTEM_RUNTIME = Path("/run/etd")
SYSTEM_STATE = Path("/var/lib/etd")
SYSTEM_CALIBRATIONS = Path("/var/lib/etd-calibrations")
#: The sessions' runtime folders, one a user.
USER_RUNTIMES = Path("/run/user")

CONTROL = "control.sock"
FRAMES = "frames.sock"
TELEMETRY = "telemetry.sock"

#: What the kernel takes for the path of a Unix socket, its final zero not counted.
MAX_SOCKET_PATH = 107

#: Of one other user, and of all, root asks so many.
MOST_OF_A_USER = 8
MOST_OF_OTHERS = 32
#: Of one other user, so many sockets are looked at, whether anybody listens.
_MOST_LOOKED_AT = 64


class RunningDaemon(NamedTuple):
    """A daemon that answers. The same name may run once for the system and once for a user."""

    name: str
    address: str


class OthersDaemons(NamedTuple):
    """Of other users: those to ask, and a sentence for each user who has more."""

    daemons: tuple[RunningDaemon, ...] = ()
    not_asked: tuple[str, ...] = ()


def runtime_folder(name: str) -> Path:
    """Where a daemon started now, by this user, puts its sockets. Raises: FileError."""
    system = SYSTEM_RUNTIME / check_name(name)
    return system if os.access(system, os.W_OK) else _user_runtime() / name


def state_folder(name: str) -> Path:
    """Where a daemon started now, by this user, keeps records. Raises: FileError."""
    system = SYSTEM_STATE / check_name(name)
    return system if os.access(system, os.W_OK) else _user_state() / name


def calibrations_folder(runtime: Path, state: Path) -> Path:
    """Where the daemon with these folders has its calibrations."""
    is_system = runtime.parent == SYSTEM_RUNTIME
    return SYSTEM_CALIBRATIONS / runtime.name if is_system else state / "calibrations"


def kept_calibrations(name: str) -> tuple[Path, ...]:
    """Where calibrations of a daemon that does not run may be: the system's and this user's.

    Raises: FileError.
    """
    return (SYSTEM_CALIBRATIONS / check_name(name), _user_state() / name / "calibrations")


def selftest_file(name: str, backend: Literal["linux", "fake"], configuration: str) -> Path:
    """Where the last self-test of this daemon's board is kept. Raises: FileError.

    Beside the gateway's folder, not in it: the operator writes it, and the engine's user reads it.
    A daemon has one board, but a user's fakes are many: each `configuration` has a file of its own.
    """
    if backend == "linux" and SYSTEM_STATE.is_dir():
        return SYSTEM_STATE / f"{check_name(name)}.selftest.json"
    which = f"-{configuration}" if backend == "fake" else ""
    return _user_state() / check_name(name) / f"selftest-{backend}{which}.json"


def supply_note_file(name: str, backend: Literal["linux", "fake"], given: Path | None) -> Path:
    """Where the engine notes that the supply is on, for the next engine after a crash. Raises:
    FileError.

    A system has a board, and one note of it, in a folder of the engine's own: a program that may
    write there can hide a crash. Without such a folder it is `given`, or this user's.
    """
    system = SYSTEM_STATE / f"{check_name(name)}.engine"
    if backend == "linux" and os.access(system, os.W_OK):
        return system / "supply.json"
    return (given or _user_state() / name) / f"supply-{backend}.json"


def board_as_started_file(name: str, backend: Literal["linux", "fake"], given: Path | None) -> Path:
    """A copy of the board's file as an engine was started with it, beside its note of the supply:
    for `etd safe`, where the file, or the settings that name it, cannot be read any more. Raises:
    FileError.
    """
    return supply_note_file(name, backend, given).with_name(f"board-as-started-{backend}.toml")


def calibrating_file(name: str, which: str, ending: str = "") -> Path:
    """Where this user's unfinished calibration `which` on this daemon is kept; with an `ending`
    what else is asked for it. Raises: FileError.

    With the user who calibrates, not with the daemon: it is no limit of anybody yet.
    """
    file = check_name(which, "the calibration's name")
    return _user_state() / check_name(name) / "calibrating" / f"{file}{ending}.json"


def control_address(name: str) -> str:
    """Where a client finds the daemon: the system's if there is one, else this user's.

    A system daemon whose folder this user may not enter counts as there: the client then says
    that permission is missing. Raises: FileError for a name that cannot be one.
    """
    system = SYSTEM_RUNTIME / check_name(name)
    locked = system.parent.is_dir() and os.path.lexists(system) and not os.access(system, os.X_OK)
    if locked or os.path.exists(system / CONTROL):
        return address_of(system)
    return address_of(_user_runtime() / name)


def address_of(folder: Path) -> str:
    """The control address of the daemon whose runtime folder this is."""
    return f"ipc://{folder / CONTROL}"


def sibling_address(control: str, socket_name: str) -> str:
    """FRAMES or TELEMETRY beside an ipc control address, for when `hello` cannot be answered."""
    return f"ipc://{Path(control.removeprefix('ipc://')).with_name(socket_name)}"


def find_daemons() -> list[RunningDaemon]:
    """The daemons of the system and of this user that answer on this machine, in this order."""
    return [
        _daemon_at(control)
        for parent in _own_parents()
        for control in _answering(_sockets_in(parent))
    ]


def find_daemons_of_others() -> OthersDaemons:
    """Those of other users, for root: of each user the first one before the second of any, and a
    few of each. Any user can make any number of sockets, and each takes a connection, and a second
    if it does not answer.
    """
    if not hasattr(os, "geteuid") or os.geteuid() != 0:
        return OthersDaemons()
    answering, not_looked_at = {}, {}
    for uid, sockets in _others_sockets().items():
        answering[uid] = _answering(sockets[:_MOST_LOOKED_AT])
        not_looked_at[uid] = sockets[_MOST_LOOKED_AT:]
    in_turn = [
        control
        for ones in itertools.zip_longest(*(each[:MOST_OF_A_USER] for each in answering.values()))
        for control in ones
        if control is not None
    ]
    asked = in_turn[:MOST_OF_OTHERS]
    not_asked = [
        _not_asked(uid, [*(one for one in each if one not in asked), *not_looked_at[uid]])
        for uid, each in answering.items()
    ]
    return OthersDaemons(tuple(map(_daemon_at, asked)), tuple(filter(None, not_asked)))


def _not_asked(uid: int, sockets: list[Path]) -> str:
    """A sentence, or nothing if there are none."""
    if not sockets:
        return ""
    return (
        f"sockets of the user {uid} that were not asked: {len(sockets)}; ask each with"
        f" `etd stop --folder {sockets[0].parent}` (the first of them)"
    )


def _own_parents() -> list[Path]:
    """The folders in which the system's daemons, and this user's, have one each."""
    parents = [SYSTEM_RUNTIME]
    with contextlib.suppress(FileError):  # what somebody else put in our place hides no daemon
        if not _is_anothers(_user_runtime()):
            parents.append(_user_runtime())
    return list(dict.fromkeys(parents))


def _others_parents() -> list[Path]:
    parents = [*USER_RUNTIMES.glob("*/etd")]
    parents += filter(_is_its_users, Path(tempfile.gettempdir()).glob("etd-*"))
    with contextlib.suppress(FileError):
        parents.append(_user_runtime())
    return sorted(set(parents) - set(_own_parents()))


def _others_sockets() -> dict[int, list[Path]]:
    """By who made the folder that they are in, whatever that is called."""
    found: dict[int, list[Path]] = {}
    for parent in _others_parents():
        owner = _owner_of(parent)
        if owner is not None:
            found.setdefault(owner, []).extend(_sockets_in(parent))
    return found


def _sockets_in(parent: Path) -> list[Path]:
    """Of folders that a daemon could have, by their names."""
    return [
        control
        for control in sorted(parent.glob(f"*/{CONTROL}"))
        if re.search(NAME_PATTERN, control.parent.name)
    ]


def _answering(sockets: list[Path]) -> list[Path]:
    return [control for control in sockets if why_unreachable(control) is None]


def _daemon_at(control: Path) -> RunningDaemon:
    return RunningDaemon(control.parent.name, address_of(control.parent))


def _is_its_users(folder: Path) -> bool:
    """Whether `etd-UID` is that user's, by the one name that a daemon of that user gives it."""
    return folder.name == f"etd-{_owner_of(folder)}"


def _is_anothers(folder: Path) -> bool:
    return hasattr(os, "geteuid") and _owner_of(folder) not in (None, 0, os.geteuid())


def _owner_of(folder: Path) -> int | None:
    """None if it is not there, or not any more."""
    try:
        return folder.lstat().st_uid
    except OSError:
        return None


def why_unreachable(path: Path) -> str | None:
    """None if somebody listens at this Unix socket; otherwise what is wrong, as a clause."""
    if not hasattr(socket, "AF_UNIX"):
        return "this system has no Unix sockets"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(os.fspath(path))
        except BlockingIOError:
            return None  # so many are connecting that this one would have to wait
        except FileNotFoundError:
            return "there is no socket"
        except ConnectionRefusedError:
            return "no daemon listens any more (a socket is left over)"
        except PermissionError:
            return "this user may not use the socket (join the group that owns it)"
        except OSError as error:
            return error.strerror or str(error)
    return None


def prepare_runtime(folder: Path) -> None:
    """Make the folder (mode 0750) if it is not there, and check that it can be trusted.

    Raises: FileError if it cannot be made, others could put links into it, or it is too long for
    a socket's path.
    """
    if len(os.fsencode(folder / TELEMETRY)) > MAX_SOCKET_PATH:
        raise FileError(
            str(folder),
            "",
            "the path is too long for a Unix socket",
            f"at most {MAX_SOCKET_PATH} bytes with the socket's name: choose a shorter folder",
        )
    try:
        make_own(folder, 0o750)
    except OSError as error:
        raise FileError(
            str(folder),
            "",
            f"this runtime folder cannot be made ({error.strerror})",
            "choose a folder of yours: with --folder, or with XDG_RUNTIME_DIR",
        ) from error


def make_own(folder: Path, mode: int) -> None:
    """Make a folder that only this user, root and the services can put something into.

    Raises: FileError, OSError.
    """
    trust.make_own(folder, mode, _laid_out())


def check_own(folder: Path) -> None:
    """The same of a folder that is there. Raises: FileError, OSError."""
    trust.check_own(folder, _laid_out())


def open_unshared(path: Path) -> int:
    """To read a file that only this user, root and the services can write.

    Raises: FileError, OSError.
    """
    return trust.open_unshared(path, _laid_out())


def _laid_out() -> tuple[Path, ...]:
    """What is below these is made by root, for the users of the services."""
    return (SYSTEM_RUNTIME, SYSTEM_STATE, SYSTEM_CALIBRATIONS)


def check_name(name: str, whose: str = "the daemon's name") -> str:
    """Raises: FileError for a name that could not be a file's everywhere."""
    if re.search(NAME_PATTERN, name):
        return name
    raise FileError(whose, "", repr(name), "give 1 to 32 letters, digits, hyphens or underscores")


def _user_runtime() -> Path:
    given = os.environ.get("XDG_RUNTIME_DIR")
    if given:
        return Path(given) / "etd"
    if not hasattr(os, "getuid"):
        return Path(tempfile.gettempdir()) / "etd"
    folder = Path(tempfile.gettempdir()) / f"etd-{os.getuid()}"
    if os.path.lexists(folder) and folder.lstat().st_uid != os.getuid():
        raise FileError(
            str(folder),
            "",
            "this folder belongs to somebody else",
            "have it removed, or set XDG_RUNTIME_DIR",
        )
    return folder


def _user_state() -> Path:
    given = os.environ.get("XDG_STATE_HOME")
    return (Path(given) if given else Path.home() / ".local" / "state") / "etd"
