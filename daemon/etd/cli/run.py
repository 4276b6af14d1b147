"""`etd run`: the daemon, as two processes, or one of the two in the foreground.

Owns: which configuration is used, which backend is opened, and what is printed when it is ready or
ends. Must not know: what engine and gateway do.
"""

from __future__ import annotations

import argparse
import contextlib
import fcntl
import os
import select
import shlex
import signal
import socket
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from etd.cli import options
from etd.cli.extras import check_fake
from etd.cli.part_ending import status_of_part
from etd.files.as_started import keep_as_started
from etd.files.configuration import LoadedConfig, fake_config, load_config
from etd.files.exclusive import BOTH_PARTS, ENGINE, NameLock
from etd.files.paths import (
    CONTROL,
    board_as_started_file,
    calibrations_folder,
    check_name,
    make_own,
    prepare_runtime,
    runtime_folder,
    selftest_file,
    state_folder,
    supply_note_file,
    why_unreachable,
)
from etd.files.resources import config_dir
from etd.protocol.errors import AlreadyRunning, FileError, PartEnded
from etd.protocol.text import shown
from etd.selftest.subject import subject_of
from etd_hal.backend import Backend
from etd_hal.compose import open_fake, open_linux, system_clock
from etd_hal.confinement import close_memory
from etd_hal.modelled_fingers import OWN
from etd_hal.wait_for_devices import open_when_there

HELP = "run the daemon: engine and gateway, until Ctrl-C"
EPILOG = """
examples:
  etd run --board fake                    without hardware, for writing programs
  etd run --board fake --trace bus.jsonl  also records all traffic on its buses
  etd run --board fake --finger sweat:3   another modelled finger (docs/body.md)
  etd run --config my.toml                your own board, without installing a service

As a service (systemd), each part is a unit: etd run --part engine, etd run --part gateway.
"""

CONFIG_FOLDER = Path("/etc/etd")
PARTS = ("engine", "gateway")
_ENDINGS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_name(parser)
    options.add_configuration(
        parser, "a fake board instead of hardware, with a configuration of its own"
    )
    options.add_machine(parser)
    options.add_finger(parser)
    options.add_breathing(parser)
    parser.add_argument(
        "--trace", type=Path, metavar="FILE", help="record the fake's buses, as JSON lines"
    )
    parser.add_argument(
        "--board-socket", type=Path, metavar="PATH", help="use the fake board process at PATH"
    )
    options.add_timeout_factor(parser, "`etd status` shows it")
    parser.add_argument(
        "--record",
        metavar="NAME",
        help="write a record of all that is asked and fired, from the beginning on (etd record)",
    )
    parser.add_argument("--part", choices=PARTS, help="run one part in the foreground")
    parser.add_argument(
        "--folder", type=Path, metavar="DIR", help="keep sockets, calibrations and records in DIR"
    )
    parser.add_argument(
        "--state",
        type=Path,
        metavar="DIR",
        help="keep calibrations and records in DIR (default: the daemon's own, or in --folder)",
    )
    parser.add_argument(
        "--selftest", type=Path, metavar="FILE", help="the self-test report that arming requires"
    )
    parser.add_argument(
        "--wait",
        type=options.positive,
        default=0.0,
        metavar="S",
        help="with --part engine: wait up to S seconds for devices that are missing or not yet"
        " permitted",
    )
    parser.add_argument("--lifeline", action="store_true", help="end when standard input ends")
    options.add_seconds(parser)


def run(args: argparse.Namespace) -> int:
    """Raises: FileError, AlreadyRunning, HardwareMissing, PartEnded and what a part raises."""
    loaded = loaded_config(args)
    _check_fake_only(args, loaded)
    if loaded.config.backend == "fake" and args.part != "gateway":
        check_fake()
    if args.wait and args.part != "engine":
        args.misused("--wait needs --part engine: only a service can start before its devices")
    if args.seconds is not None and args.part is not None:
        args.misused("--seconds goes without --part: a part runs until it is told to end")
    folder = args.folder if args.folder is not None else runtime_folder(args.name)
    prepare_runtime(folder)
    if args.record is not None:
        check_name(args.record, "the record's name")
    if args.part is None:
        return _run_both(args, loaded, folder)
    if args.lifeline:
        _end_with_standard_input()
    run_part = _run_gateway if args.part == "gateway" else _run_engine
    return status_of_part(lambda on_ready: run_part(args, loaded, folder, on_ready))


def loaded_config(args: argparse.Namespace) -> LoadedConfig:
    """Raises: FileError; for a missing configuration it names the fake board."""
    if args.board is not None:
        return fake_config(args.board.board, args.array, machine=args.machine or "pi4")
    if args.machine is not None:
        args.misused("--machine needs --board fake: otherwise the configuration names the machine")
    if args.array is not None:
        args.misused("--array needs --board fake: otherwise the configuration names the array")
    path = args.config or CONFIG_FOLDER / f"{args.name}.toml"
    if not path.is_file():
        what = "it is no regular file" if path.exists() else "there is no such configuration"
        raise FileError(
            str(path),
            "",
            what,
            "without hardware: etd run --board fake; with hardware: `sudo make install` writes it,"
            " or name another with --config",
        )
    return load_config(path)


def _check_fake_only(args: argparse.Namespace, loaded: LoadedConfig) -> None:
    if args.trace is not None and args.board_socket is not None:
        args.misused("--trace: a board process writes its own trace; give the option to it")
    if args.machine is not None and args.board_socket is not None:
        args.misused("--machine: a board process has the times of a pi4")
    if args.board_socket is not None and (args.finger is not None or args.breathing):
        args.misused("--finger, --breathing: on a board process lies a finger that only conducts")
    for option, given, why in (
        ("--trace", args.trace, "real buses cannot be recorded or replaced"),
        ("--board-socket", args.board_socket, "real buses cannot be recorded or replaced"),
        ("--timeout-factor", args.timeout_factor, "a real board's time-outs cannot be lengthened"),
        ("--finger", args.finger, "a real board is worn by a real finger"),
        ("--breathing", args.breathing or None, "a real board is worn by a real finger"),
    ):
        if loaded.config.backend == "linux" and given is not None:
            raise FileError(option, "", why, "omit it, or use --board fake")


# --- both parts ------------------------------------------------------------------------------


def _run_both(args: argparse.Namespace, loaded: LoadedConfig, folder: Path) -> int:
    if why_unreachable(folder / CONTROL) is None:
        raise AlreadyRunning(args.name, f"a daemon answers at {folder / CONTROL}")
    with contextlib.closing(NameLock(folder, args.name, BOTH_PARTS)):
        return _run_alone(args, loaded, folder)


def _run_alone(args: argparse.Namespace, loaded: LoadedConfig, folder: Path) -> int:
    # Imported here: no process loads what only another part needs. The engine has no ZeroMQ.
    from etd.cli.process_pair import READY_WITHIN_S, ProcessPair

    for sentence in loaded.mended:
        print(f"mended: {shown(sentence)}", file=sys.stderr)
    both = ProcessPair(_arguments(args, loaded, folder), folder)
    # The handlers of `_endings` also take a second Ctrl-C: it must not interrupt making it safe.
    with _endings() as wakeup:
        try:
            with both:
                both.wait_until_ready(READY_WITHIN_S * (args.timeout_factor or 1))
                print(
                    f"etd {args.name} is ready (backend: {loaded.config.backend};"
                    f" board {loaded.board.name}, array {loaded.array.name},"
                    f" {loaded.array.count} electrodes) at {both.address}",
                    flush=True,
                )
                if args.folder is not None:
                    folder_named = shlex.quote(str(folder.absolute()))
                    print(f"to stop it: etd stop --folder {folder_named}", flush=True)
                both.wait(args.seconds, wakeup)
        finally:
            ended = both.not_ended_well()
            _make_safe_after(ended, args, loaded)
    if ended:
        raise ended[0]
    return 0


def _arguments(args: argparse.Namespace, loaded: LoadedConfig, folder: Path) -> list[str]:
    arguments = ["--name", args.name, "--folder", str(folder)]
    arguments += ["--selftest", str(_selftest_file(args, loaded))]
    arguments += ["--state", str(_state_folder(args, folder))]
    if args.board is not None:
        arguments += ["--board", "fake" if args.board.board is None else f"fake:{args.board.board}"]
    for key in ("config", "array", "machine", "trace", "board_socket", "timeout_factor", "record"):
        value = getattr(args, key)
        if value is not None:
            arguments += [f"--{key.replace('_', '-')}", str(value)]
    return arguments + options.finger_arguments(args.finger, is_breathing=args.breathing)


@contextmanager
def _endings() -> Iterator[socket.socket]:
    """A socket that becomes readable when a signal asks this process to end."""
    reading, writing = socket.socketpair()
    writing.setblocking(False)
    with reading, writing:
        before_fd = signal.set_wakeup_fd(writing.fileno())
        before = {ending: signal.signal(ending, lambda *_: None) for ending in _ENDINGS}
        try:
            yield reading
        finally:
            for ending, handler in before.items():
                signal.signal(ending, handler)
            signal.set_wakeup_fd(before_fd)


def _make_safe_after(
    endings: tuple[PartEnded, ...], args: argparse.Namespace, loaded: LoadedConfig
) -> None:
    """Makes the board safe after an engine that was killed. A fake board in the engine's process
    died with it; any other board outlives it.
    """
    outlives = loaded.config.backend == "linux" or args.board_socket is not None
    killed = [
        ending for ending in endings if ending.part == "engine" and ending.how.startswith("killed")
    ]
    if not (killed and outlives):
        return
    print(f"the engine ended ({killed[0].how}): `etd safe` makes the board safe", file=sys.stderr)
    # A group of its own: Ctrl-C is for this process.
    subprocess.run(_safe_command(args, loaded), check=False, process_group=0)


def _safe_command(args: argparse.Namespace, loaded: LoadedConfig) -> list[str]:
    from etd.cli.process_pair import ETD

    command = [*ETD, "safe", "--name", args.name]
    if args.config is not None:
        command += ["--config", str(args.config)]
    if args.board is not None:
        command += ["--board", loaded.config.board, "--machine", loaded.config.machine]
    if args.board_socket is not None:
        command += ["--board-socket", str(args.board_socket)]
    if (given := _given_state_folder(args)) is not None:
        command += ["--state", str(given)]
    return command


# --- one part --------------------------------------------------------------------------------


def _run_engine(
    args: argparse.Namespace, loaded: LoadedConfig, folder: Path, on_ready: Callable[[], None]
) -> int:
    from etd.engine.process import run_engine
    from etd.files.calibration_process import CalibrationProcess

    # Before it has a device. The maxima are in it.
    close_memory()
    is_fake, core = loaded.config.backend == "fake", loaded.config.engine.core
    calibrations = CalibrationProcess(
        _calibrations_folder(args, folder),
        _shipped_calibrations() if is_fake else None,
        None if core == "any" else core,
    )
    with contextlib.ExitStack() as held:
        note, refusal = _kept_by_engine(args, loaded, held)
        return run_engine(
            loaded,
            _open_backend(args, loaded),
            folder,
            _selftest_file(args, loaded),
            on_ready,
            calibrations=calibrations,
            is_of_one_user=args.lifeline,
            supply_note=note,
            note_refusal=refusal,
        )


def _kept_by_engine(
    args: argparse.Namespace, loaded: LoadedConfig, held: contextlib.ExitStack
) -> tuple[Path | None, str | None]:
    """Where the supply is noted, and why nothing must be armed. The board's file is kept there too,
    by one engine at a time and before it has a line: `etd safe` must find the lines that were
    moved. Where that cannot be, arming is refused; the board is made safe anyway.

    Raises: AlreadyRunning.
    """
    backend, given = loaded.config.backend, _given_state_folder(args)
    note = supply_note_file(args.name, backend, given)
    try:
        make_own(note.parent, 0o700)
        held.enter_context(contextlib.closing(NameLock(note.parent, args.name, ENGINE[backend])))
        keep_as_started(board_as_started_file(args.name, backend, given), loaded.board_file)
    except FileError as error:
        return None, str(error)
    except OSError as error:
        advice = "let the engine's user write there, or name another folder with --state"
        return note, f"{error}: {advice}"
    return note, None


def _selftest_file(args: argparse.Namespace, loaded: LoadedConfig) -> Path:
    """A fake with `--folder` has its own report; a board has one report for all users."""
    if args.selftest is not None:
        return Path(args.selftest)
    if args.folder is not None and loaded.config.backend == "fake":
        return Path(args.folder) / "state" / "selftest-fake.json"
    return kept_selftest(args.name, loaded)


def _given_state_folder(args: argparse.Namespace) -> Path | None:
    """None: none was named."""
    named = args.state is not None or args.folder is not None
    return _state_folder(args, args.folder or Path()) if named else None


def _state_folder(args: argparse.Namespace, folder: Path) -> Path:
    """Not with the sockets, unless it was asked for: their folder is gone after a restart."""
    if args.state is not None:
        return Path(args.state).absolute()
    # A client is told of it, and may have another working folder.
    return state_folder(args.name) if args.folder is None else folder.absolute() / "state"


def _calibrations_folder(args: argparse.Namespace, folder: Path) -> Path:
    return calibrations_folder(folder, _state_folder(args, folder))


def _shipped_calibrations() -> Path:
    """Of the fake's own body."""
    return config_dir() / "calibrations"


def kept_selftest(name: str, loaded: LoadedConfig) -> Path:
    """The report file of this configuration's last self-test. Raises: FileError."""
    backend = loaded.config.backend
    return selftest_file(name, backend, subject_of(loaded, backend, "").configuration)


def _open_backend(args: argparse.Namespace, loaded: LoadedConfig) -> Backend:
    """Raises: HardwareMissing, BusError."""
    if loaded.config.backend == "linux":
        return open_when_there(
            lambda: open_linux(loaded.board, loaded.machine),
            system_clock(),
            int(args.wait * 1e9),
            lambda sentence: print(f"etd engine: {sentence}", file=sys.stderr),
        )
    return open_fake(
        loaded.board,
        electrodes=loaded.array.outputs(),
        positions_mm=list(zip(loaded.array.x_mm, loaded.array.y_mm, strict=True)),
        trace=args.trace,
        board_socket=args.board_socket,
        sensors=loaded.array.pressure,
        timeout_factor=args.timeout_factor or 1,
        machine=args.machine,
        finger=(args.finger or OWN)._replace(is_breathing=args.breathing),
    )


def _run_gateway(
    args: argparse.Namespace, loaded: LoadedConfig, folder: Path, on_ready: Callable[[], None]
) -> int:
    from etd.engine.notify import Notifier
    from etd.gateway.config import GatewayConfig
    from etd.gateway.process import run_gateway

    config = GatewayConfig(
        name=args.name,
        runtime_folder=folder,
        state_dir=_state_folder(args, folder),
        calibrations=_calibrations_folder(args, folder),
        shipped_calibrations=_shipped_calibrations(),
        default_calibration=loaded.config.default_calibration,
        operators=loaded.config.operators,
        record=args.record,
    )
    with contextlib.closing(Notifier()) as notifier:

        def ready() -> None:
            notifier.ready("serving clients")
            on_ready()

        return run_gateway(config, system_clock(), ready)


def _end_with_standard_input() -> None:
    """The kernel sends SIGTERM when it ends: the engine has no thread to wait for that."""
    fcntl.fcntl(0, fcntl.F_SETOWN, os.getpid())
    fcntl.fcntl(0, fcntl.F_SETSIG, signal.SIGTERM)
    fcntl.fcntl(0, fcntl.F_SETFL, fcntl.fcntl(0, fcntl.F_GETFL) | os.O_ASYNC)
    if select.select([0], (), (), 0)[0]:
        os.kill(os.getpid(), signal.SIGTERM)
