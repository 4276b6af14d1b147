"""Folders that only their owner can put something into: what is written there lands there.

Owns: whose a folder and all above it may be, making one, opening a file that no other user has put
a link in the place of, and whether another user could write either. Must not know: what is in a
folder.

A user who can write to a folder, or to one above it, can put a link in the place of a file: the
daemon, or root, then writes to what the link names. The folders of /run/etd and /var/lib/etd are
laid out by systemd for the users of the services; there no link is followed.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from etd.protocol.errors import FileError
from etd.protocol.peer import Peer

#: As many links as Linux follows on one path.
_MOST_LINKS = 40
#: A file that is replaced so often while it is opened is no file to wait for.
_MOST_REPLACED = 8


def make_own(folder: Path, mode: int, laid_out: tuple[Path, ...] = ()) -> None:
    """Make the folder if it is not there; it, and what is above it, must be trusted.

    `laid_out`: folders of the system's; what is below them may be another user's.
    Raises: FileError, OSError.
    """
    nearest = folder.absolute()
    while not os.path.lexists(nearest) and nearest != nearest.parent:
        nearest = nearest.parent
    _check(nearest, laid_out, is_whole=nearest == folder.absolute())
    folder.mkdir(mode=mode, parents=True, exist_ok=True)
    _check(folder, laid_out, is_whole=True)


def check_own(folder: Path, laid_out: tuple[Path, ...] = ()) -> None:
    """As `make_own`, of a folder that is there. Raises: FileError, OSError."""
    _check(folder, laid_out, is_whole=True)


def check_beyond(folder: Path, other: Peer) -> None:
    """Neither the folder nor one above it can be written by that user; no link is on the way.

    Raises: FileError, OSError.
    """
    wanted = folder.absolute()
    for place in (*reversed(wanted.parents), wanted):
        found = place.lstat()
        if stat.S_ISLNK(found.st_mode):
            raise _distrusted(place, "a link is in the place of a folder", "remove it")
        _check_is_folder(place, found)
        is_sticky_above = place != wanted and bool(found.st_mode & stat.S_ISVTX)
        _check_beyond(place, found, other, is_sticky_above)


def open_beyond(path: Path, other: Peer) -> int:
    """To read: as `open_own`, of a file that this user cannot write. Raises: FileError, OSError."""
    number = open_own(path, os.O_RDONLY)
    try:
        _check_beyond(path, os.fstat(number), other, is_sticky_above=False)
    except BaseException:
        os.close(number)
        raise
    return number


def open_unshared(path: Path, laid_out: tuple[Path, ...] = ()) -> int:
    """To read: as `open_own`, of a file that only this user and root can write; below folders that
    are `laid_out`, its owner and group too.

    Raises: FileError, OSError.
    """
    is_laid_out = any(parent in path.absolute().parents for parent in laid_out)
    number = open_own(path, os.O_RDONLY)
    try:
        found = os.fstat(number)
        why, how = "", f"chmod go-w {path}"
        if found.st_uid not in (0, os.geteuid()) and not is_laid_out:
            why, how = f"it belongs to user {found.st_uid}", f"chown {os.geteuid()} {path}"
        elif found.st_mode & 0o002:
            why = "everybody may write it"
        elif found.st_mode & 0o020 and found.st_gid not in (0, os.getegid()) and not is_laid_out:
            why = f"the group {found.st_gid} may write it"
        if why:
            raise _distrusted(path, f"another user could have written it: {why}", how)
    except BaseException:
        os.close(number)
        raise
    return number


def _check_beyond(place: Path, found: os.stat_result, other: Peer, is_sticky_above: bool) -> None:
    """In a sticky folder above, as /tmp, a user can remove only what is that user's."""
    why, how = "", ""
    if found.st_uid == other.uid:
        why, how = f"it belongs to user {other.uid}", f"chown root {place}"
    elif found.st_mode & 0o002 and not is_sticky_above:
        why, how = "everybody may write it", f"chmod o-w {place}"
    elif found.st_mode & 0o020 and found.st_gid in other.gids and not is_sticky_above:
        why, how = f"the group {found.st_gid} may write it", f"chmod g-w {place}"
    if why:
        raise _distrusted(place, f"the gateway could have written this: {why}", how)


def _check(folder: Path, laid_out: tuple[Path, ...], is_whole: bool) -> None:
    """`is_whole`: files are put into the folder, and not a folder only.

    Raises: FileError, where a stranger could put a link there; OSError.
    """
    if not hasattr(os, "geteuid"):
        return  # no Unix: no daemon runs there
    wanted, links = folder.absolute(), 0
    place = Path(wanted.anchor)
    parts = list(wanted.parts[1:])
    while parts:
        place = Path(os.path.normpath(place / parts.pop(0)))
        found = place.lstat()
        is_laid_out = any(parent in place.parents for parent in laid_out)
        if not stat.S_ISLNK(found.st_mode):
            # First: what may be done to a folder must not be advised for a device.
            _check_is_folder(place, found)
        _check_owner(place, found, is_laid_out)
        if stat.S_ISLNK(found.st_mode):
            links += 1
            if is_laid_out or links > _MOST_LINKS:
                raise _distrusted(place, "a link is in the place of a folder", "remove it")
            target = place.parent / os.readlink(place)
            parts = [*target.parts[1:], *parts]
            place = Path(target.anchor)
        elif not is_laid_out:
            _check_writers(place, found, is_last=is_whole and not parts)


def open_own(path: Path, flags: int, mode: int = 0o640) -> int:
    """As `os.open`, of a file and of nothing else: no link, no second name of another file.

    Raises: FileError, OSError.
    """
    for _ in range(_MOST_REPLACED):
        number = _opened(path, flags, mode)
        found = os.fstat(number)
        if stat.S_ISREG(found.st_mode) and found.st_nlink == 1:
            return number
        os.close(number)
        if found.st_nlink:
            break
        # It was replaced after it had been opened: the name is another file's.
    raise _distrusted(path, "something else is in the place of a file", "remove it")


def _opened(path: Path, flags: int, mode: int) -> int:
    try:
        return os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK, mode)
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        raise _distrusted(path, "a link is in the place of a file", "remove it") from error


def _check_is_folder(place: Path, found: os.stat_result) -> None:
    if not stat.S_ISDIR(found.st_mode):
        raise _distrusted(place, "this is no folder", "name a folder")


def _check_owner(place: Path, found: os.stat_result, is_laid_out: bool) -> None:
    if found.st_uid not in (0, os.geteuid()) and not is_laid_out:
        what = "link" if stat.S_ISLNK(found.st_mode) else "folder"
        raise _distrusted(
            place,
            f"this {what} belongs to somebody else (user {found.st_uid}), who could put links in"
            " the place of files",
            "have it removed, or choose a folder of yours: with --folder, or with XDG_RUNTIME_DIR"
            " and XDG_STATE_HOME",
        )


def _check_writers(place: Path, found: os.stat_result, is_last: bool) -> None:
    """Below a folder that all may write to, as /tmp, each can remove only what is their own."""
    is_sticky = bool(found.st_mode & stat.S_ISVTX)
    who = ""
    if found.st_mode & 0o002:
        who, how = "everybody", "o-w"
    elif found.st_mode & 0o020 and found.st_gid not in (0, os.getegid()):
        who, how = f"the group {found.st_gid}", "g-w"
    if who and (is_last or not is_sticky):
        advice = f"chmod {how} {place}, or choose another one"
        if is_sticky:
            advice = "choose a folder of your own in it"
        raise _distrusted(place, f"{who} may write into this folder", advice)


def _distrusted(place: Path, what: str, advice: str) -> FileError:
    return FileError(str(place), "", what, advice)
