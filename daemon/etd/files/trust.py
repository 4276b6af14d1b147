"""Folders that only their owner can put something into: what is written there lands there.

Owns: whose a folder and all above it may be, making one, and opening a file that nobody has put a
link in the place of. Must not know: what is in a folder.

Whoever can write to a folder, or to one above it, can put a link in the place of a file: then the
daemon, or root, writes to what the link names. The folders of /run/etd and /var/lib/etd are laid
out by systemd for the users of the services; there no link is followed.
"""

from __future__ import annotations

import errno
import os
import stat
from pathlib import Path

from etd.protocol.errors import FileError

#: As many links as Linux follows on one path.
_MOST_LINKS = 40


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


def _check(folder: Path, laid_out: tuple[Path, ...], is_whole: bool) -> None:
    """`is_whole`: files are put into the folder, and not a folder only.

    Raises: FileError, where a stranger could put a link there; OSError.
    """
    if not hasattr(os, "geteuid"):
        return  # no Unix: there nobody runs a daemon
    wanted, links = folder.absolute(), 0
    place = Path(wanted.anchor)
    parts = list(wanted.parts[1:])
    while parts:
        place = Path(os.path.normpath(place / parts.pop(0)))
        found = place.lstat()
        is_laid_out = any(parent in place.parents for parent in laid_out)
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
    try:
        number = os.open(path, flags | os.O_NOFOLLOW | os.O_CLOEXEC | os.O_NONBLOCK, mode)
    except OSError as error:
        if error.errno != errno.ELOOP:
            raise
        raise _distrusted(path, "a link is in the place of a file", "remove it") from error
    found = os.fstat(number)
    if stat.S_ISREG(found.st_mode) and found.st_nlink == 1:
        return number
    os.close(number)
    raise _distrusted(path, "something else is in the place of a file", "remove it")


def _check_owner(place: Path, found: os.stat_result, is_laid_out: bool) -> None:
    if found.st_uid not in (0, os.geteuid()) and not is_laid_out:
        what = "link" if stat.S_ISLNK(found.st_mode) else "folder"
        raise _distrusted(
            place,
            f"this {what} belongs to somebody else (user {found.st_uid}), who could put links in"
            " the place of files",
            "have it removed, or choose a folder of yours: set XDG_RUNTIME_DIR and XDG_STATE_HOME,"
            " or give --folder",
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
