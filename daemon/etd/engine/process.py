"""The engine as a process: threads, signals, and the loop that ends in the safe state.

Owns: the order of starting and ending. Must not know: what a step does, which backend there is.

What works beside the scan starts before the main thread asks for its core and its priority, and so
inherits neither: a process each where the ports can be shared with one, else a thread
(docs/decisions/0047). However the loop ends, the
board is made safe first and everything else after.
"""

from __future__ import annotations

import signal
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType

from etd.engine.loop import Engine
from etd.engine.notify import Notifier
from etd.engine.stopper import StopperThread
from etd.files.calibration_process import CalibrationProcess
from etd.files.configuration import LoadedConfig
from etd.planning.duty import busy_fraction, told_of
from etd.protocol.link import Listener
from etd.selftest.arming_gate import SelftestGate
from etd.selftest.subject import subject_of
from etd.sensing.process import start as start_sensors
from etd.sensing.sensors import SensorThread
from etd_hal.backend import Backend, SideTask, StopperTask
from etd_hal.stopper import Stopper
from etd_hal.supply_note import SupplyNote

_ENDINGS = (signal.SIGTERM, signal.SIGINT, signal.SIGHUP)
#: The watchdog is fed this many times within its period.
_FEEDINGS = 4


def run_engine(
    loaded: LoadedConfig,
    backend: Backend,
    folder: Path,
    selftest: Path,
    on_ready: Callable[[], None] = lambda: None,
    supply_note: Path | None = None,
    note_refusal: str | None = None,
    calibrations: CalibrationProcess | None = None,
    is_of_one_user: bool = False,
) -> int:
    """Drive the board until SIGTERM, SIGINT or SIGHUP. Main thread only.

    `folder` is the daemon's runtime folder, where the gateway finds the link, `is_of_one_user` says
    that no other user's does; `selftest` is where
    the last self-test's report is kept; `calibrations` reads what leases are opened with (None:
    limits only); `supply_note` is what a crash is known by, and `note_refusal` why there must be
    none, so that nothing is armed. Returns the exit status: 0, or 1 when the board could not be
    made safe at the end.
    Raises: AlreadyRunning, BoardFault, BusError; the board has been made safe then.
    """
    note = None if supply_note is None else SupplyNote(supply_note)
    listener = Listener(folder, is_of_one_user=is_of_one_user)
    notifier = Notifier()
    engine = Engine(
        loaded,
        backend,
        feed_watchdog=_Feeder(notifier),
        untested=SelftestGate(selftest, subject_of(loaded, backend.name, backend.identity)),
        supply_note=note,
        calibrations=calibrations,
    )
    if note_refusal is not None:
        engine.components.stopper_liveness.refuse_note(note_refusal)
    try:
        problems = _drive(engine, listener, notifier, note, on_ready)
    finally:
        # In every case: `end` never raises, and may be called again.
        engine.supervisor.end()
        backend.close()
        if calibrations is not None:
            calibrations.end()
        listener.close()
        notifier.close()
    for problem in problems:
        _print(f"not safe: {problem}")
    return 1 if problems else 0


def _drive(
    engine: Engine,
    listener: Listener,
    notifier: Notifier,
    supply_note: SupplyNote | None,
    on_ready: Callable[[], None],
) -> tuple[str, ...]:
    asked_to_end: list[int] = []
    loaded = engine.components.loaded

    def note(number: int, _: FrameType | None) -> None:
        asked_to_end.append(number)

    before = {ending: signal.signal(ending, note) for ending in _ENDINGS}
    beside: list[SideTask] = []
    try:
        stopper = _stopper_beside(engine, supply_note)
        beside.append(stopper)
        beside.append(_sensors_beside(engine))
        engine.supervisor.supply.watched = stopper.watch
        # All have come up, and the thread is real-time, before timing is calibrated: timing is
        # measured as it will be used.
        refusals = [sentence for task in beside for sentence in task.refusals]
        engine.supervisor.not_granted = (*_realtime(engine), *refusals)
        for sentence in (*engine.components.backend.facts, _scan_core(engine)):
            _print(sentence)
        engine.supervisor.begin(_print)
        state, backend = engine.supervisor.states.state, engine.components.backend.name
        notifier.ready(f"{state}, {loaded.board.name} on {backend}")
        on_ready()
        while not asked_to_end:
            _accept_gateway(engine, listener)
            engine.step()
    except BaseException:
        # No signal asked for this end. A refusal comes before the supply has ever been on.
        supervisor = engine.supervisor
        supervisor.supply.remember_defect(is_powered=supervisor.is_powered)
        raise
    finally:
        # First of all; the caller calls it again, which does nothing more.
        problems = engine.supervisor.end()
        notifier.stopping()
        for task in beside:
            task.end()
        _note_defect(engine)
        for ending, handler in before.items():
            signal.signal(ending, handler)
    return problems


def _note_defect(engine: Engine) -> None:
    """The stopper has ended: its note stands, if this cannot be written."""
    try:
        engine.supervisor.supply.note_defect()
    except OSError as error:
        _print(f"that it was ended by a defect cannot be noted ({error.strerror})")


def _print(sentence: str) -> None:
    print(f"etd engine: {sentence}", file=sys.stderr)  # noqa: T201


def _accept_gateway(engine: Engine, listener: Listener) -> None:
    """One gateway at a time; the next waits until this gateway is gone."""
    if engine.has_gateway:
        return
    channels = listener.accept()
    if channels is not None:
        engine.attach(*channels)


def _stopper_beside(engine: Engine, supply_note: SupplyNote | None) -> StopperTask:
    """Its priority is above the scan thread's."""
    parts, wanted = engine.components, engine.components.loaded.config.engine
    backend, board = parts.backend, parts.board
    priority = wanted.stopper_priority
    if backend.beside is not None:
        note = None if supply_note is None else supply_note.path
        safe, core = board.safe_changes, wanted.scan_core
        return backend.beside.stopper(board.cut, safe, note, priority, core)
    stopper = Stopper(board.cut.words, backend.clock.now_ns, board.blank_now, supply_note)
    thread = StopperThread(
        stopper,
        lambda: None if priority is None else backend.set_up_urgent_thread(priority),
    )
    thread.start()
    return thread


def _sensors_beside(engine: Engine) -> SideTask:
    parts, loaded = engine.components, engine.components.loaded
    if parts.backend.beside is not None:
        return start_sensors(
            parts.backend.beside,
            loaded.board,
            loaded.array,
            parts.readings,
            loaded.config.engine.scan_core,
        )
    thread = SensorThread(parts.rail, parts.pressure, parts.scan_core)
    thread.start()
    return thread


def _realtime(engine: Engine) -> tuple[str, ...]:
    wanted = engine.components.loaded.config.engine
    if wanted.priority == "none":
        return ("real-time scheduling was not asked for (engine.priority is none)",)
    return engine.components.backend.set_up_realtime(wanted.priority, wanted.scan_core)


def _scan_core(engine: Engine) -> str:
    """By the scan's own thread, before the loop waits for it."""
    found = engine.components.backend.scan_core()
    return told_of(busy_fraction(found.is_left_alone), str(found))


class _Feeder:
    """Feeds systemd's watchdog from the scan loop itself, no more often than needed."""

    def __init__(self, notifier: Notifier) -> None:
        self._notifier = notifier
        self._period_ns = (notifier.watchdog_ns or 0) // _FEEDINGS
        self._fed_ns = 0

    def __call__(self, now_ns: int) -> None:
        if self._period_ns and now_ns - self._fed_ns >= self._period_ns:
            self._fed_ns = now_ns
            self._notifier.alive()
