"""`etd bench`: what this machine takes for a pulse, and a machine file from it.

Owns: which machine file and board are measured, and where the result is stored. Must not know: how
anything is measured (etd.bench).
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Callable
from pathlib import Path

import msgspec

from etd.bench.machine_file import measured_machine, toml_of
from etd.bench.messages import Messages
from etd.bench.result import lines_of
from etd.bench.run import Parts, measure
from etd.bench.subject import BOARD
from etd.cli import options
from etd.cli.new_file import check_new_file
from etd.cli.run import CONFIG_FOLDER
from etd.files.atomic_file import write_atomically
from etd.files.configuration import LoadedConfig, fake_config, load_config
from etd.files.resources import find
from etd.protocol.errors import BoardFault, HardwareMissing
from etd_hal.board import Board
from etd_hal.boardfile import MachineFile, load_machine
from etd_hal.compose import (
    codec_of,
    machine_facts,
    machine_problem,
    open_linux,
    scan_core,
    set_up_realtime,
    system_clock,
    thread_time_ns,
    wall_time,
)

HELP = "measure what this machine takes for a pulse, with or without a board"
EPILOG = """
examples:
  etd bench                                  a minute, compared with the machine file
  etd bench --report bench.json              and the result as a JSON file
  etd bench --write-machine mine.toml        and a machine file with this machine's figures
  etd bench --machine pi3                    compared with the model of a Raspberry Pi 3

Nothing is connected and the supply stays off: the processor, the wake-ups and the loop are measured
on ports that lead to no wire. Where /etc/etd/NAME.toml names a real board that no daemon uses, its
messages are timed as well, at DAC code 0. As root, or with the rights of the service, everything
runs at the engine's priority; otherwise the table says what was not granted.

exit status: 0 measured, 2 wrong usage, or a file cannot be read or written
"""
_SECONDS = 60.0
#: As the shipped configuration asks for.
_PRIORITY = 80
_MODE = 0o644


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_name(parser)
    parser.add_argument("--config", type=Path, metavar="FILE", help="default: /etc/etd/NAME.toml")
    parser.add_argument(
        "--machine",
        metavar="MACHINE",
        help="compare with this shipped machine file (default: the configuration's, else pi4)",
    )
    parser.add_argument(
        "--seconds",
        type=options.positive,
        default=_SECONDS,
        metavar="N",
        help="measure for about N seconds (default: %(default).0f)",
    )
    parser.add_argument(
        "--report", type=Path, metavar="FILE", help="write the result to this new file"
    )
    parser.add_argument(
        "--write-machine",
        type=Path,
        metavar="FILE",
        help="write a machine file with what was found to this new file",
    )
    options.add_json(parser)


def run(args: argparse.Namespace) -> int:
    """Files that cannot be read or written are wrong use: status 2."""
    with options.wrong_use(args):
        return _run(args)


def _run(args: argparse.Namespace) -> int:
    """Raises: FileError."""
    check_new_file(args.report)
    check_new_file(args.write_machine)
    if _are_one(args.report, args.write_machine):
        args.misused("--report and --write-machine are two files")
    loaded = _configured(args)
    machine = _machine(args, loaded)
    problem = machine_problem(machine) if args.write_machine is not None else None
    if problem is not None:
        args.misused(f"--write-machine: {problem}")
    tell = _told_nothing if args.json else _told
    result = measure(_parts(loaded, machine), args.seconds, tell)
    if args.json:
        print(msgspec.json.encode(result).decode())
    else:
        print("\n".join(lines_of(result, machine)))
    if args.report is not None:
        text = msgspec.json.format(msgspec.json.encode(result), indent=1)
        write_atomically(args.report, text, _MODE)
    if args.write_machine is not None:
        measured = measured_machine(machine, result)
        write_atomically(args.write_machine, toml_of(measured, result).encode(), _MODE)
        tell(f"wrote {args.write_machine}: name it as `machine` in the configuration")
    return 0


def _are_one(report: Path | None, machine: Path | None) -> bool:
    return report is not None and machine is not None and report.resolve() == machine.resolve()


def _told(sentence: str) -> None:
    print(f"etd bench: {sentence}", file=sys.stderr, flush=True)


def _told_nothing(_: str) -> None:
    pass


def _configured(args: argparse.Namespace) -> LoadedConfig | None:
    """None: no configuration is there, and none was named. Raises: FileError."""
    path = args.config or CONFIG_FOLDER / f"{args.name}.toml"
    if args.config is None and not path.is_file():
        return None
    return load_config(path)


def _machine(args: argparse.Namespace, loaded: LoadedConfig | None) -> MachineFile:
    if args.machine is not None:
        return load_machine(find("machines", args.machine))
    return fake_config(BOARD).machine if loaded is None else loaded.machine


def _parts(loaded: LoadedConfig | None, machine: MachineFile) -> Parts:
    engine = None if loaded is None or loaded.config.backend == "fake" else loaded.config.engine
    priority, core = _PRIORITY, None
    if engine is not None:
        priority = _PRIORITY if engine.priority == "none" else engine.priority
        core = engine.scan_core
    return Parts(
        machine=machine,
        codec=codec_of(fake_config(BOARD).board.source),
        clock=system_clock(),
        processor_ns=thread_time_ns,
        now=wall_time(),
        facts=machine_facts(),
        set_up_realtime=lambda: set_up_realtime(priority, core),
        scan_core=scan_core,
        timed_board=lambda timed: _with_board(loaded, timed),
    )


def _with_board(loaded: LoadedConfig | None, timed: Callable[[Board], Messages]) -> Messages:
    """Raises: HardwareMissing, BusError, BoardFault."""
    if loaded is None or loaded.config.backend == "fake":
        raise HardwareMissing(("no configuration of a real board: sudo make install writes one",))
    backend = open_linux(loaded.board, loaded.machine)
    try:
        ports = backend.spi, backend.gpio, backend.clock
        board = Board(loaded.board, loaded.machine, backend.codec, *ports)
        problems = board.safe_off()
        if problems:
            raise BoardFault("the board", "; ".join(problems), "a safe board: etd selftest")
        return timed(board)
    finally:
        backend.close()
