"""The log: holders of the lease, states of the board, causes of disarming, refusals.

Owns: which events are logged, and that logging never blocks a turn: lines go through a bounded
queue to a thread that writes them, and lines that do not fit are counted and reported. Must not
know: sockets.

The engine itself logs nothing: its scan thread must not wait for a disk or a full pipe.
"""

from __future__ import annotations

import logging
import logging.handlers
import queue
import sys
from collections import Counter
from typing import TextIO

from etd.gateway.inbound import InboundMessage
from etd.gateway.lease import StandingLease
from etd.gateway.lease_log import LeaseLog
from etd.gateway.state_log import Act, StateLog
from etd.gateway.summed_up import SummedUp
from etd.protocol.link import EngineHello
from etd.protocol.messages import Arm, Clear, Request, StateReport
from etd.protocol.text import shown

_QUEUE_LENGTH = 1_000
_LOST = "engine gone: nothing is stimulated, and no lease stands"
_CUT_OFF = (
    "engine cut off, since it did not answer a stop: whether it runs is not known, and no lease"
    " stands; if anything is felt, press the stop button or run `etd safe`"
)
#: Counters of the engine, each logged once it begins to count: measurements that are rejected, so
#: that stabilizers leave the pulse as the frame has it.
_REJECTED = {
    "rejected_adc": "the ADC's samples did not change, or the source's node was not at rest before"
    " a pulse",
    "rejected_compliance": "the source was at its compliance limit, so no resistance is known",
    "rejected_implausible": "a measured resistance is out of the range of skin",
    "rejected_flicker": "resistances flicker (a noisy ADC, a shaking hand)",
    "rejected_bound": "a law has requested its widest pulse for 10 s on one electrode, which is"
    " rare on skin and typical of a wrong ADC gain: etd selftest measures the gain",
    "rejected_common": "a law by resistance has requested wider pulses on all electrodes alike for"
    " many seconds: the ADC's gain is wrong (etd selftest measures it), or all of the skin has"
    " changed since the calibration; the common part of the change widens no pulse",
    "rejected_old": "an electrode was not measured for a second: a silence, or a slow rate",
    "rejected_probe": "the ADC's samples did not change in the probe before a pulse, or the node"
    " was not at rest",
}
_COUNTED = {
    **{
        key: (logging.WARNING, f"not stabilized for a while: {_REJECTED[key]}") for key in _REJECTED
    },
    # Suspicious, but still in use.
    "rejected_narrow": (
        logging.WARNING,
        "a law by resistance has given one electrode almost nothing for 10 s: its resistance is"
        " high at the edge of the skin, on skin that has dried since the calibration, or by a"
        " wrong ADC gain (etd selftest measures it)",
    ),
    "probes_alone": (
        logging.INFO,
        "a pulse was withheld: the probe before it found no contact, or was too late",
    ),
}
#: After so long without a problem, a sensor's next problem is logged again.
_EPISODE_NS = 10_000_000_000
#: Refusals are summed up at most this often.
SUM_UP_NS = 10_000_000_000


class _OneLine(logging.Formatter):
    """An event is a single line, and not a long one, whatever text it quotes."""

    def format(self, record: logging.LogRecord) -> str:
        return shown(super().format(record))


class _Queue(logging.handlers.QueueHandler):
    """Drops what does not fit, and counts it."""

    dropped = 0

    def enqueue(self, record: logging.LogRecord) -> None:
        try:
            self.queue.put_nowait(record)
        except queue.Full:
            self.dropped += 1


class _Writer(logging.handlers.QueueListener):
    """Writes in a thread of its own."""

    def enqueue_sentinel(self) -> None:
        # At the end it may block until the queue has room.
        self.queue.put(self._sentinel)  # type: ignore[attr-defined]


class Journal:
    """Writes a line for each event to `stream`; under systemd that is the journal."""

    def __init__(self, name: str, stream: TextIO = sys.stderr) -> None:
        room: queue.Queue[logging.LogRecord] = queue.Queue(_QUEUE_LENGTH)
        writing = logging.StreamHandler(stream)
        writing.setFormatter(_OneLine(f"etd {name}: %(message)s"))
        self._queue = _Queue(room)
        self._writer = _Writer(room, writing)
        self._log = logging.Logger("etd.journal", logging.INFO)
        self._log.addHandler(self._queue)
        #: Of what was not granted, what this engine's log has already.
        self._told: set[str] = set()
        #: Why laws are off, by what the person says.
        self._laws_off = ""
        self._rejections: set[str] = set()
        self._counted: dict[str, int] = {}
        #: When each reported sensor last had a problem.
        self._silent_ns: dict[str, int] = {}
        self._leases = LeaseLog(self._log)
        self._states = StateLog(self._log)
        self._engines = SummedUp(self._log, "lines of an engine that came or went", "gone")
        self._records = SummedUp(self._log, "lines of records", "problems")
        #: Requests that are not answered yet, of which the log tells who asked; by number.
        self._asked: dict[int, Act] = {}
        #: The record that is written, who began it, and why the last one ended by itself.
        self._record: tuple[str | None, int | None, str | None] = None, None, None
        self._refused: Counter[str] = Counter()
        self._summed_ns = 0
        self._is_closed = False
        self._writer.start()

    @property
    def dropped(self) -> int:
        """Lines that did not fit since the last summary."""
        return self._queue.dropped

    def close(self) -> None:
        """Write what is there. Idempotent."""
        if not self._is_closed:
            self._is_closed = True
            self._states.close()
            self._sum_up()
            self._writer.stop()

    def engine_found(self, engine_hello: EngineHello) -> None:
        board, electrodes = engine_hello.board, engine_hello.array.electrodes
        absent = ", ".join(board.absent_guards) or "none"
        self._engines.tell(
            "",
            logging.INFO,
            f"engine there: {board.name} ({board.backend}), {electrodes} electrodes; absent guards:"
            f" {absent}",
        )

    def engine_lost(self, *, is_cut_off: bool) -> None:
        self._states.engine_lost()
        self._silent_ns.clear()
        self._told.clear()
        self._engines.tell("", logging.ERROR, _CUT_OFF if is_cut_off else _LOST)

    def asked_to_end(self) -> None:
        self._log.info("asked to end")

    def asked(self, request: Request, inbound: InboundMessage) -> None:
        """Each request has one reply."""
        if isinstance(request, Arm | Clear):
            self._asked[inbound.number] = "arm" if isinstance(request, Arm) else "clear"

    def replied(self, inbound: InboundMessage, *, is_done: bool) -> None:
        act = self._asked.pop(inbound.number, None)
        if act is not None and is_done:
            self._states.done(act, f"user {inbound.uid}")

    def state(self, report: StateReport, lease: StandingLease | None = None) -> None:
        """Log each change of state with its cause, what was not granted once for each engine, each
        kind of rejected measurement once while the board is live, and the beginning and end of each
        sensor's problems. `lease`: the one that stands.
        """
        if report.engine == "there":
            self._log_sensors(report)
        if report.state == "SAFE":
            self._rejections.clear()
        else:
            self._log_rejections(report.counters)
        self._log_laws_off("" if report.felt is None else report.felt.laws_off)
        if not self._states.heard(report, lease):
            return
        for sentence in report.not_granted:
            if sentence not in self._told:
                self._told.add(sentence)
                self._log.warning("%s", sentence)

    def _log_laws_off(self, why: str) -> None:
        if why and why != self._laws_off:
            self._log.warning("%s", why)
        self._laws_off = why

    def _log_rejections(self, counters: dict[str, int]) -> None:
        for key, (level, sentence) in _COUNTED.items():
            if self._has_begun(key, counters):
                self._log.log(level, "%s", sentence)
        self._counted = {key: counters.get(key, 0) for key in _COUNTED}

    def _log_sensors(self, report: StateReport) -> None:
        for name, why in report.sensor_problems.items():
            if name not in self._silent_ns:
                self._log.warning("%s of the array gives no readings: %s", name, why)
            self._silent_ns[name] = report.now_ns
        for name, silent_ns in list(self._silent_ns.items()):
            if report.now_ns - silent_ns > _EPISODE_NS:
                self._log.info("%s of the array has worked again for 10 s", name)
                del self._silent_ns[name]

    def _has_begun(self, key: str, counters: dict[str, int]) -> bool:
        """For the first time while this board is live."""
        if key in self._rejections or counters.get(key, 0) <= self._counted.get(key, 0):
            return False
        self._rejections.add(key)
        return True

    def record(self, running: str | None, problem: str | None, begun_by: int | None = None) -> None:
        """Log the beginning and the end of a record, and why it ended by itself. `begun_by`: who
        began the one that is written, or was written last.
        """
        (before, by, before_problem), now = self._record, (running, begun_by, problem)
        self._record = now
        if before is not None and running != before:
            self._records.tell(f"user {by}", logging.INFO, f"record {before!r} ended")
        if running is not None and running != before:
            self._records.tell(f"user {begun_by}", logging.INFO, f"record {running!r} begun")
        if problem is not None and problem != before_problem:
            self._records.tell("", logging.ERROR, problem)

    def lease(self, standing: StandingLease | None) -> None:
        """Log a change of the holder."""
        self._leases.changed(standing)

    def _sum_up(self) -> None:
        for each in (self._leases, self._engines, self._states, self._records):
            each.sum_up()

    def refusals(self, counters: Counter[str], now_ns: int) -> None:
        """What was refused or dropped since the last summary, in one line; leases and changes of
        state that had none of their own.
        """
        if now_ns - self._summed_ns < SUM_UP_NS:
            return
        self._summed_ns = now_ns
        self._sum_up()
        news = counters - self._refused
        self._refused = Counter(counters)
        if news:
            counts = ", ".join(f"{count} {what}" for what, count in sorted(news.items()))
            self._log.info("since the last summary: %s", counts)
        if self._queue.dropped:
            self._log.warning(
                "%d lines of this log were lost: the queue was full", self._queue.dropped
            )
            self._queue.dropped = 0
