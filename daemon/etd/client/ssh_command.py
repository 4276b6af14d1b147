"""A command of `etd` on another computer, over ssh: what only a process there may do.

Owns: how ssh is started, what it is given, and what the command's answer means. Must not know:
sockets, messages, what the command does.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import cast, get_args

import msgspec

from etd.protocol.errors import DaemonGone, ErrorCode, Refused

OPTIONS = (
    "ExitOnForwardFailure=yes",
    "ConnectTimeout=10",
    # A connection without an answer for two seconds is given up.
    "ServerAliveInterval=1",
    "ServerAliveCountMax=1",
    # Not over another program's connection: it would end with that.
    "ControlPath=none",
)
#: A person may have to type a passphrase.
_WITHIN_S = 90.0
#: What a shell says of a command that it does not find.
_NOT_FOUND = 127


class _Failure(msgspec.Struct):
    """As commands print it with `--json`."""

    error: str
    reason: str


def ssh_words(host: str, forwards: Sequence[str], command: str) -> list[str]:
    """What is started here."""
    ssh = ["ssh", "-T"]
    for option in OPTIONS:
        ssh += ["-o", option]
    for forward in forwards:
        ssh += ["-L", forward]
    ssh += ["--", host, command]
    if os.name == "posix":
        # Ctrl-C is for the program, which ends silent over this very connection.
        ssh = ["sh", "-c", 'trap "" INT; exec "$@"', "sh", *ssh]
    return ssh


def run_there(host: str, words: Sequence[str], data: str = "") -> None:
    """`etd WORDS` there, one of which is `--json`, with `data` as its input.

    Raises: Refused, as it was refused there; DaemonGone, where it could not be run.
    """
    command = shlex.join(["etd", *words])
    ran = _ran(host, command, data)
    if ran.returncode == 0:
        return
    # A login shell may print something first.
    lines = [line for line in ran.stdout.splitlines() if re.match(r"\{.*\}$", line)]
    try:
        told = msgspec.json.decode(lines[-1], type=_Failure)
    except (IndexError, msgspec.DecodeError):
        said = _last_word(ran)
        if ran.returncode == _NOT_FOUND:
            said += ": the command etd must be found there by a shell that ssh starts"
        raise DaemonGone(host, f"`{command}` could not be run", said) from None
    code = told.error if told.error in get_args(ErrorCode) else "bad_calibration"
    raise Refused(cast(ErrorCode, code), told.reason)


def may_write_there(host: str, folder: Path) -> bool:
    """Whether the account may write into that folder. Raises: DaemonGone."""
    command = f"test -w {shlex.quote(folder.as_posix())}"
    ran = _ran(host, command)
    if ran.returncode not in (0, 1):
        raise DaemonGone(host, f"`{command}` could not be run", _last_word(ran))
    return ran.returncode == 0


def _ran(host: str, command: str, data: str = "") -> subprocess.CompletedProcess[str]:
    """Raises: DaemonGone."""
    try:
        return subprocess.run(
            ssh_words(host, (), command),
            input=data,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_WITHIN_S,
            check=False,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DaemonGone(host, "ssh could not be run", str(error)) from error


def _last_word(ran: subprocess.CompletedProcess[str]) -> str:
    return (ran.stderr.splitlines() or ["it said nothing"])[-1]
