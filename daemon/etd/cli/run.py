"""`etd run`: the daemon, as two processes, or one of the two in the foreground.

Owns: which configuration is used, which backend is opened, and what is printed when it is ready or
ends. Must not know: what engine and gateway do.
"""

from __future__ import annotations

import argparse
import contextlib
import os
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from etd.cli import options
from etd.files.configuration import LoadedConfig, fake_config, load_config
from etd.files.paths import (
    CONTROL,
    prepare_runtime,
    runtime_folder,
    selftest_file,
    state_folder,
    why_unreachable,
)
from etd.files.resources import config_dir
from etd.protocol.errors import AlreadyRunning, FileError, PartEnded
from etd.selftest.subject import subject_of
from etd_hal.backend import Backend
from etd_hal.compose import open_fake, open_linux, system_clock
from etd_hal.wait_for_devices import open_when_there

NAME = "run"
HELP = "run the daemon: engine and gateway, until Ctrl-C"
EPILOG = """
examples:
  etd run --board fake                    no hardware: write a program against it
  etd run --board fake --trace bus.jsonl  and record everything that crosses its buses
  etd run --config my.toml                a board of yours, without installing a service

As a service (systemd), each part is a unit: etd run --part engine, etd run --part gateway.
"""

CONFIG_FOLDER = Path("/etc/etd")
PARTS = ("engine", "gateway")
_ENDINGS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_name(parser)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--config", type=Path, metavar="FILE", help="default: /etc/etd/NAME.toml")
    what.add_argument(
        "--board",
        type=options.fake_board,
        metavar="fake[:BOARD]",
        help="a fake board in place of hardware, with a configuration of its own",
    )
    parser.add_argument(
        "--array", help="with --board fake: a shipped array, or a file (eTactileKit's layouts too)"
    )
    parser.add_argument(
        "--trace", type=Path, metavar="FILE", help="record the fake's buses, as JSON lines"
    )
    parser.add_argument(
        "--board-socket", type=Path, metavar="PATH", help="use the fake board process at PATH"
    )
    parser.add_argument(
        "--timeout-factor",
        type=options.timeout_factor,
        metavar="N",
        help="on the fake, for a busy machine: a frame's ttl, the lease and the gateway's silence"
        " last N times as long; `etd status` says so",
    )
    parser.add_argument("--part", choices=PARTS, help="run one part in the foreground")
    parser.add_argument(
        "--folder", type=Path, metavar="DIR", help="keep sockets and calibrations in DIR"
    )
    parser.add_argument(
        "--selftest", type=Path, metavar="FILE", help="the self-test's report that arming looks at"
    )
    parser.add_argument(
        "--wait",
        type=options.positive,
        default=0.0,
        metavar="S",
        help="with --part engine: so long for devices that are not there, or not permitted, yet",
    )
    parser.add_argument("--lifeline", action="store_true", help="end when standard input ends")
    options.add_seconds(parser)


def run(args: argparse.Namespace) -> int:
    """Raises: FileError, AlreadyRunning, HardwareMissing, PartEnded and what a part raises."""
    loaded = loaded_config(args)
    _check_fake_only(args, loaded)
    if args.wait and args.part != "engine":
        args.misused("--wait goes with --part engine: as a service it may be started early")
    folder = args.folder if args.folder is not None else runtime_folder(args.name)
    prepare_runtime(folder)
    if args.part is None:
        return _run_both(args, loaded, folder)
    if args.lifeline:
        _end_with_standard_input()
    if args.part == "gateway":
        return _run_gateway(args, loaded, folder)
    return _run_engine(args, loaded, folder)


def loaded_config(args: argparse.Namespace) -> LoadedConfig:
    """Raises: FileError; for a missing configuration it names the fake board."""
    if args.board is not None:
        return fake_config(args.board.board, args.array)
    if args.array is not None:
        args.misused("--array goes with --board fake: otherwise the configuration names it")
    path = args.config or CONFIG_FOLDER / f"{args.name}.toml"
    if not path.is_file():
        raise FileError(
            str(path),
            "",
            "there is no such configuration",
            "without hardware: etd run --board fake; with hardware: `sudo make install` makes one,"
            " or name yours with --config",
        )
    return load_config(path)


def _check_fake_only(args: argparse.Namespace, loaded: LoadedConfig) -> None:
    if args.trace is not None and args.board_socket is not None:
        args.misused("a board process writes its own trace: give --trace to that process")
    if loaded.config.backend == "linux" and (args.trace or args.board_socket):
        raise FileError(
            "--trace" if args.trace else "--board-socket",
            "",
            "real buses cannot be recorded or replaced",
            "leave it out, or run with --board fake",
        )
    if loaded.config.backend == "linux" and args.timeout_factor is not None:
        raise FileError(
            "--timeout-factor",
            "",
            "with a real board nothing lengthens a timeout",
            "leave it out, or run with --board fake",
        )


# --- both parts ------------------------------------------------------------------------------


def _run_both(args: argparse.Namespace, loaded: LoadedConfig, folder: Path) -> int:
    # Here and below: no part loads what only another one needs. The engine holds no ZeroMQ.
    from etd.cli.process_pair import ProcessPair

    if why_unreachable(folder / CONTROL) is None:
        raise AlreadyRunning(args.name, f"it answers at {folder / CONTROL}")
    for sentence in loaded.mended:
        print(f"mended: {sentence}", file=sys.stderr)
    both = ProcessPair(_arguments(args, loaded, folder), folder)
    # A second Ctrl-C, too, finds the handlers of `_endings`: nothing breaks off the way to safety.
    with _endings() as wakeup:
        try:
            with both:
                both.wait_until_ready()
                print(_ready_line(args.name, loaded, both.address), flush=True)
                both.wait(args.seconds, wakeup)
        finally:
            ended = both.not_ended_well()
            _make_safe_after(ended, args, loaded)
    if ended:
        raise ended[0]
    return 0


def _arguments(args: argparse.Namespace, loaded: LoadedConfig, folder: Path) -> list[str]:
    """The arguments of the parts: the same again."""
    arguments = ["--name", args.name, "--folder", str(folder)]
    arguments += ["--selftest", str(_selftest_file(args, loaded))]
    if args.board is not None:
        arguments += ["--board", f"fake:{args.board.board or ''}"]
    for key in ("config", "array", "trace", "board_socket", "timeout_factor"):
        value = getattr(args, key)
        if value is not None:
            arguments += [f"--{key.replace('_', '-')}", str(value)]
    return arguments


def _ready_line(name: str, loaded: LoadedConfig, address: str) -> str:
    return (
        f"etd {name} is ready (backend: {loaded.config.backend}; board {loaded.board.name},"
        f" array {loaded.array.name}, {loaded.array.count} electrodes) at {address}"
    )


@contextmanager
def _endings() -> Iterator[socket.socket]:
    """A socket that can be read once this process has been told to end."""
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
    command = [sys.executable, "-m", "etd", "safe", "--name", args.name]
    if args.config is not None:
        command += ["--config", str(args.config)]
    if args.board is not None:
        command += ["--board", loaded.config.board, "--machine", loaded.config.machine]
    if args.board_socket is not None:
        command += ["--board-socket", str(args.board_socket)]
    return command


# --- one part --------------------------------------------------------------------------------


def _run_engine(args: argparse.Namespace, loaded: LoadedConfig, folder: Path) -> int:
    from etd.engine.process import run_engine

    selftest = _selftest_file(args, loaded)
    return run_engine(loaded, _open_backend(args, loaded), folder, selftest)


def _selftest_file(args: argparse.Namespace, loaded: LoadedConfig) -> Path:
    """A fake in a folder of its own has its own report; a board has one report for all users."""
    if args.selftest is not None:
        return Path(args.selftest)
    if args.folder is not None and loaded.config.backend == "fake":
        return Path(args.folder) / "state" / "selftest-fake.json"
    return kept_selftest(args.name, loaded)


def kept_selftest(name: str, loaded: LoadedConfig) -> Path:
    """Where the last self-test of this configuration is. Raises: FileError."""
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
    )


def _run_gateway(args: argparse.Namespace, loaded: LoadedConfig, folder: Path) -> int:
    from etd.engine.notify import Notifier
    from etd.gateway.config import GatewayConfig
    from etd.gateway.process import run_gateway

    config = GatewayConfig(
        name=args.name,
        runtime_folder=folder,
        state_dir=state_folder(args.name) if args.folder is None else folder / "state",
        shipped_calibrations=config_dir() / "calibrations",
        default_calibration=loaded.config.default_calibration,
        operators=loaded.config.operators,
    )
    with contextlib.closing(Notifier()) as notifier:
        return run_gateway(config, system_clock(), lambda: notifier.ready("serving clients"))


def _end_with_standard_input() -> None:
    def wait() -> None:
        while os.read(0, 64):
            pass
        os.kill(os.getpid(), signal.SIGTERM)

    threading.Thread(target=wait, name="lifeline", daemon=True).start()
