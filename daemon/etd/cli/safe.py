"""`etd safe`: put the board into its safe state, without a daemon.

Owns: finding the board file, and printing what was done. Must not know: anything beyond the HAL. It
imports only the HAL, the folder of shipped files and the standard library, so that it works after
most failures.
"""

from __future__ import annotations

import argparse
import json
import re
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from etd.files.resources import Kind, find
from etd.protocol.errors import BusError, FileError
from etd.protocol.text import NAME_PATTERN
from etd_hal.backend import Backend
from etd_hal.board import Board
from etd_hal.boardfile import BoardFile, MachineFile, load_board, load_machine
from etd_hal.compose import open_fake, open_linux_safe
from etd_hal.tomlfile import read_toml

HELP = "put the board into its safe state, without a daemon"
EPILOG = """
examples:
  etd safe                                      the board of /etc/etd/main.toml
  etd safe --board reference-hv507 --machine pi4

Switches outputs and supply off, sets the DAC to zero, and deselects all electrodes. Every step is
tried and checked, even if another fails. systemd runs it whenever the engine has ended. While an
engine runs it holds the lines: use `etd stop`. A file that was edited since the engine was started
does not count: the lines that it has moved are those of the file as it was.

exit status: 0 safe, 1 a step failed, 3 the hardware is missing or in use
"""

_CONFIG_FOLDER = Path("/etc/etd")
_ANY_MACHINE = "pi4"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--name", default="main", help="the daemon's name (default: %(default)s)")
    parser.add_argument("--config", type=Path, metavar="FILE", help="default: /etc/etd/NAME.toml")
    parser.add_argument("--board", metavar="FILE", help="a board file, or a shipped board's name")
    parser.add_argument("--machine", metavar="FILE", help="a machine file, or a shipped one's name")
    parser.add_argument(
        "--board-socket", type=Path, metavar="PATH", help="the fake board process at PATH"
    )
    parser.add_argument(
        "--state", type=Path, metavar="FOLDER", help="the daemon's, where it was started with one"
    )
    parser.add_argument("--json", action="store_true", help="answer with one JSON object")


def run(args: argparse.Namespace) -> int:
    """Drives the lines, even if other devices are missing.

    Raises: FileError (no board file), HardwareMissing (no lines), BusError (a board process).
    """
    if not re.search(NAME_PATTERN, args.name):
        args.misused(f"--name {args.name!r}: give 1 to 32 letters, digits, hyphens or underscores")
    settings, board = _settings_and_board(args)
    if settings.backend == "fake" and args.board_socket is None:
        return _answer(args, "fake", "", (), "nothing to do: the fake board ended with its engine")
    machine = _machine(settings)
    backend, missing = _open(board, args.board_socket)
    try:
        ports = backend.spi, backend.gpio, backend.clock
        failed = Board(board, machine, backend.codec, *ports).safe_off()
    finally:
        backend.close()
    supply = "" if "hv_enable" in board.absent_guards else ", supply off"
    done = f"{board.name}: outputs off{supply}, DAC at zero, nothing selected"
    problems = tuple(dict.fromkeys((*missing, *failed)))
    return _answer(args, backend.name, board.name, problems, done)


@dataclass(frozen=True, slots=True)
class _Settings:
    """The board's settings in `etd.toml` or the options; file names are relative to `folder`."""

    backend: str
    board: str
    machine: str
    folder: Path

    def path(self, kind: Kind, name: str) -> Path:
        return find(kind, name, self.folder)


def _settings_and_board(args: argparse.Namespace) -> tuple[_Settings, BoardFile]:
    """As the last engine was started with them, or as they are: an edit since then may have made
    the files unreadable, or name other lines than those that it has moved, or the fake board. Of
    that one no copy counts: what an engine had on Linux is a real board.
    """
    now: tuple[_Settings, BoardFile] | FileError
    try:
        settings = _settings(args)
        now = settings, load_board(settings.path("boards", settings.board))
    except FileError as error:
        now = error
    copy = _as_started(args)
    if copy is None:
        return _or_raised(now)
    try:
        then = load_board(copy)
    except FileError as error:
        print(f"{error}: the board's file is used as it is now", file=sys.stderr)
        return _or_raised(now)
    if isinstance(now, FileError):
        _tell_as_started(str(now), copy)
        return _Settings("linux", str(copy), _ANY_MACHINE, copy.parent), then
    settings = replace(now[0], backend=_backend(args, "linux"))
    if now != (settings, then):
        _tell_as_started("the settings or the board's file are not as they were", copy)
    return settings, then


def _or_raised(found: tuple[_Settings, BoardFile] | FileError) -> tuple[_Settings, BoardFile]:
    if isinstance(found, FileError):
        raise found
    return found


def _as_started(args: argparse.Namespace) -> Path | None:
    """The copy that the engine keeps, if it counts: of any board that the settings named, or of the
    file that the command names.
    """
    file: Path | None = None
    try:
        if args.board is not None:
            file = find("boards", args.board, Path.cwd()).resolve()
        elif not _settings_file(args).exists():
            return None  # Without settings this computer need not have that board any more.
    except FileError:
        return None
    # What is loaded with the command is little, and this is not.
    from etd.files.as_started import as_started

    return as_started(args.name, file, args.state)


def _tell_as_started(why: str, copy: Path) -> None:
    said = f"{why}: the board is made safe as the engine was started with it ({copy})"
    print(said, file=sys.stderr)


def _backend(args: argparse.Namespace, said: str) -> str:
    return said if args.board_socket is None else "fake"


def _settings(args: argparse.Namespace) -> _Settings:
    if args.board is not None and args.machine is not None:
        return _Settings(_backend(args, "linux"), args.board, args.machine, Path.cwd())
    if args.board is not None:
        args.misused("--board needs --machine: pi4, or pi3 for a Raspberry Pi 3 or Zero 2 W")
    path = _settings_file(args)
    said = _read(path)
    for key in ("backend", "board"):
        if not isinstance(said.get(key), str):
            raise FileError(str(path), key, "it is missing", "run `etd check` on this file")
    return _Settings(
        _backend(args, said["backend"]),
        said["board"],
        args.machine or str(said.get("machine", "(none is named)")),
        path.resolve().parent,
    )


def _settings_file(args: argparse.Namespace) -> Path:
    named: Path | None = args.config
    return named or _CONFIG_FOLDER / f"{args.name}.toml"


def _read(path: Path) -> dict[str, Any]:
    try:
        return read_toml(path)
    except FileError as error:
        allowed = "name the board: --board and --machine"
        raise FileError(error.file, error.key, error.value, allowed) from error


def _machine(settings: _Settings) -> MachineFile:
    """The machine file, or a shipped one if it cannot be used: nothing is fired, so its times do
    not matter, and the board must be made safe without it.
    """
    try:
        return load_machine(settings.path("machines", settings.machine))
    except FileError as error:
        print(f"the machine file is ignored, and not needed here: {error}", file=sys.stderr)
        return load_machine(find("machines", _ANY_MACHINE))


def _open(board: BoardFile, board_socket: Path | None) -> tuple[Backend, tuple[str, ...]]:
    """The ports, and what is missing of them."""
    if board_socket is None:
        return open_linux_safe(board)
    outputs = range(board.switch.outputs)
    try:
        return open_fake(board, electrodes=outputs, board_socket=board_socket), ()
    except BusError as error:
        if error.kind != "busy":
            raise
        advice = f"{error.detail}; an engine is running: use `etd stop`"
        raise BusError("busy", error.device, error.operation, advice) from error


def _answer(
    args: argparse.Namespace, backend: str, board: str, problems: tuple[str, ...], done: str
) -> int:
    if args.json:
        answer = {"ok": not problems, "backend": backend, "board": board, "problems": problems}
        print(json.dumps(answer))
    elif problems:
        for problem in problems:
            print(f"NOT SAFE: {problem}", file=sys.stderr)
        print("cut the supply by hand; all other steps succeeded", file=sys.stderr)
    else:
        print(f"safe ({backend}): {done}")
    return 1 if problems else 0
