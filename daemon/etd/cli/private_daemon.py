"""A private daemon on the fake board: real processes, real sockets, in a private folder.

Owns: the folder, and that both processes have ended when the `with` ends. Must not know: what is
played on it. It cannot touch a real board: the children are started with `--board fake`.
"""

from __future__ import annotations

import signal
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from etd.cli import Terminated
from etd.cli.extras import check_fake
from etd.cli.options import PRIVATE_TIMEOUT_FACTOR, finger_arguments
from etd.files.configuration import LoadedConfig
from etd.files.paths import prepare_runtime
from etd.protocol.errors import NO_TIME, DaemonGone, PartEnded, Refused
from etd_hal.modelled_fingers import Finger

if TYPE_CHECKING:
    from etd.cli.process_pair import ProcessPair

#: What a client waits by itself, and that of a verb's own daemon; at most: a person sits before the
#: screen.
_ANSWER_WITHIN_S, _OWN_ANSWER_WITHIN_S, _MOST_ANSWER_WITHIN_S = 2.0, 10.0, 60.0
_ENDINGS = (signal.SIGTERM, signal.SIGHUP)


@contextmanager
def private_daemon(
    name: str,
    loaded: LoadedConfig,
    trace: Path | None = None,
    machine: str | None = None,
    timeout_factor: int | None = None,
    finger: Finger | None = None,
    *,
    is_breathing: bool = False,
) -> Iterator[str]:
    """The control address of a daemon that is ready. `loaded` comes from `fake_config`; `machine`,
    `timeout_factor`, `finger` and `is_breathing` are those of `etd run`.

    The output of the two processes is shown only if one of them ends.
    Raises: PartEnded then (also in place of the client's error), DaemonGone if it does not become
    ready, FileError, PackageMissing, PythonTooOld.
    """
    check_fake()
    # After the check: it needs the daemon's Python.
    from etd.cli.process_pair import READY_WITHIN_S, ProcessPair

    with termination_as_ctrl_c(), tempfile.TemporaryDirectory(prefix="etd-") as temporary:
        folder = Path(temporary)
        prepare_runtime(folder)
        factor = timeout_factor or PRIVATE_TIMEOUT_FACTOR
        arguments = _arguments(name, loaded, folder, trace, machine, factor)
        arguments += finger_arguments(finger, is_breathing=is_breathing)
        with open(folder / "log", "w+", encoding="utf-8") as log:
            try:
                with ProcessPair(arguments, folder, log) as both:
                    both.wait_until_ready(READY_WITHIN_S * (timeout_factor or 1))
                    with _death_explains(both):
                        yield both.address
            except PartEnded:
                log.seek(0)
                sys.stderr.write(log.read())
                raise


def answer_within_s(timeout_factor: int | None) -> float:
    """How long its client waits for an answer: on a busy machine that has no time for the daemon
    either.
    """
    if timeout_factor is None:
        return _OWN_ANSWER_WITHIN_S
    return min(_ANSWER_WITHIN_S * timeout_factor, _MOST_ANSWER_WITHIN_S)


@contextmanager
def termination_as_ctrl_c() -> Iterator[None]:
    """SIGTERM must leave no folder behind, and no supply switched on. Raises: Terminated."""

    def interrupt(number: int, _frame: FrameType | None) -> None:
        raise Terminated(number)

    before = {ending: signal.signal(ending, interrupt) for ending in _ENDINGS}
    try:
        yield
    finally:
        for ending, handler in before.items():
            signal.signal(ending, handler)


@contextmanager
def _death_explains(both: ProcessPair) -> Iterator[None]:
    """Where a client is refused or not answered because a part died, report the dead part."""
    try:
        yield
    except Refused as error:
        if error.code == "engine_gone":
            both.check_dying()
        raise
    except DaemonGone as error:
        both.check_dying()
        raise DaemonGone(error.address, error.what, NO_TIME) from error


def _arguments(
    name: str,
    loaded: LoadedConfig,
    folder: Path,
    trace: Path | None,
    machine: str | None,
    timeout_factor: int,
) -> list[str]:
    config = loaded.config
    arguments = ["--name", name, "--folder", str(folder)]
    arguments += ["--board", f"fake:{config.board}", "--array", config.array]
    arguments += ["--timeout-factor", str(timeout_factor)]
    if machine is not None:
        arguments += ["--machine", machine]
    return arguments if trace is None else [*arguments, "--trace", str(trace)]
