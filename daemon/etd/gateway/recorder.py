"""Writes a record of all that passes the gateway while one runs: asked, fired, and why less.

Owns: which event becomes which line, the relation of the clocks, and how a record ends. Must not
know: sockets, how a line reaches the disk (`record_file.py`), what else an event means.
"""

from __future__ import annotations

import datetime
import functools
from collections.abc import Callable
from typing import Any, Literal

import msgspec

from etd.gateway.allowance import BYTES_A_SECOND, MOST_BYTES, Allowance
from etd.gateway.inbound import InboundMessage
from etd.gateway.last_frames import LastFrames
from etd.gateway.lease import LeaseView, StandingLease
from etd.gateway.record_file import DISK_SHORT, RecordFile
from etd.gateway.record_store import RecordStore
from etd.protocol.errors import Refused
from etd.protocol.frame import Frame
from etd.protocol.link import EngineHello, PulseBatch, RecordBegins, Report, ToGateway
from etd.protocol.link import LeaseEnded as LeaseEndedMessage
from etd.protocol.messages import (
    VERSION,
    Failure,
    RefusedReport,
    Request,
    StateReport,
    Success,
)
from etd.protocol.pulse_row import PulseRow, rows_of
from etd.record import lines
from etd.version import __version__

#: Clocks and state are written again this often.
MINUTE_NS = 60_000_000_000
#: Of a line, so that each stays far within a message.
_ROWS_A_LINE = 200
#: What changes nothing and tells nothing is not recorded.
_UNRECORDED = ("hello", "status", "account", "record", "note")
#: Whose allowance a line takes: a user's, that of all users together, or none.
_Payer = int | None | Literal["together", "unlimited"]
#: CLOCK_MONOTONIC and the wall's time in ns, read together, and how long that took.
ReadClocks = Callable[[], tuple[int, int, int]]


class Recorder:
    """Does nothing while no record runs."""

    def __init__(
        self,
        name: str,
        store: RecordStore,
        leases: LeaseView,
        frames: LastFrames,
        read_clocks: ReadClocks,
        turn: Callable[[bool], bool],
    ) -> None:
        """`frames`: the last ones that were passed on. `turn` has the engine tell every pulse, or
        none any more; False: it was not told.
        """
        self._daemon = name
        self._store = store
        self._leases = leases
        self._frames = frames
        self._read_clocks = read_clocks
        self._turn = turn
        #: Whether the engine tells every pulse.
        self._is_told = False
        self._file: RecordFile | None = None
        #: One that has ended, while the disk takes the rest of it; and its record's name.
        self._closing: RecordFile | None = None
        self.closing: str | None = None
        self.running: str | None = None
        #: Who started it.
        self.uid: int | None = None
        #: Why the last record ended by itself.
        self.problem: str | None = None
        #: Which of this gateway's records runs, or ran last.
        self.serial = 0
        self._clocks_due_ns = 0
        #: The requests in this record to which no reply was sent yet: by number, whose allowance
        #: the reply takes; the holder's takes none.
        self._unanswered: dict[int, _Payer] = {}
        self._state: tuple[object, ...] = ()
        #: By user: what they may still add to this record; of all: what they may make it tell.
        self._allowances: dict[_Payer, Allowance] = {}
        #: Requests and replies beyond that, since they were last told; and lines of all.
        self._left_out = 0
        self._lines_left_out = 0
        #: Of the board's clock, as the engine told it last: each second, and at each change.
        self._lag_us = 0

    # --- beginning and end -----------------------------------------------------------------------

    def start(
        self, name: str, uid: int | None, engine: EngineHello | None, state: StateReport | None
    ) -> None:
        """Raises: Refused (`wrong_state`, `record_failed`)."""
        if self.running is not None:
            raise Refused(
                "wrong_state",
                f"the record {self.running!r} is being written: stop it first (`etd record stop`)",
            )
        self._look_whether_closed()
        if self.closing is not None:
            raise Refused(
                "wrong_state",
                f"the end of the record {self.closing!r} is still being written: the disk is slow,"
                " so try again later",
            )
        self._file = self._store.create(name)
        self.running, self.uid, self.problem = name, uid, None
        self.serial += 1
        # The request that ended the record before had them turned off, perhaps in this turn.
        self._is_told = False
        self._state = ()
        self._unanswered.clear()
        self._allowances.clear()
        self._left_out = self._lines_left_out = 0
        now_ns, wall_ns, uncertainty_ns = self._read_clocks()
        begun = datetime.datetime.fromtimestamp(wall_ns / 1e9, datetime.UTC)
        self._put(
            lines.Header(
                format=lines.FORMAT,
                name=name,
                etd=__version__,
                daemon=self._daemon,
                protocol=VERSION,
                begun=begun.isoformat(timespec="milliseconds"),
                begun_ns=now_ns,
                uid=uid,
                columns=PulseRow.__struct_fields__,
            )
        )
        self._put_clocks(now_ns, wall_ns, uncertainty_ns)
        if engine is not None:
            self.engine_found(engine, now_ns)
        if self._leases.standing is not None:
            self.lease_begun(self._leases.standing, now_ns)
        if state is not None:
            self._put_state(state, now_ns)

    def stop(self, why: lines.Why, now_ns: int) -> None:
        """Idempotent. `closing` is the record's name until the disk has the rest of it."""
        file = self._file
        if file is None:
            return
        self._close(file, why, now_ns)

    def _close(
        self, file: RecordFile, why: lines.Why, now_ns: int, detail: str | None = None
    ) -> None:
        """What was left out is told, then the end: both are let past the bound. No turn waits for a
        disk.
        """
        lost, left_out = file.take_lost() + self._lines_left_out, self._left_out
        if lost or left_out:
            told = lines.Lost(t_ns=now_ns, lines=lost, requests=left_out)
            file.put(lines.encoded(told), is_last=True)
        file.put(lines.encoded(lines.End(t_ns=now_ns, why=why, detail=detail)), is_last=True)
        file.close()
        self._closing, self.closing = file, self.running
        self._file = self.running = None

    def wait_closed(self, timeout_s: float) -> None:
        """Blocks: only for a gateway at its end."""
        if self._closing is not None:
            self._closing.wait_closed(timeout_s)

    def _look_whether_closed(self) -> None:
        file = self._closing
        if file is None or not file.is_closed:
            return
        self._closing = self.closing = None
        if file.problem is not None and self.problem is None:
            self.problem = f"{file.path.name}: {file.problem}"

    def look(self, now_ns: int) -> None:
        """Once a turn: the clocks each minute, lines that were lost, and a disk that failed."""
        file = self._file
        self._look_whether_closed()
        self._have_pulses_told()
        if file is None:
            return
        if file.problem is not None:
            name = self.running
            self.stop("ended", now_ns)
            self.problem = f"the record {name!r} ended: {file.path}: {file.problem}"
            return
        if file.is_disk_short:
            self.problem = f"the record {self.running!r} has ended: {DISK_SHORT}"
            self._close(file, "full", now_ns, DISK_SHORT)
            return
        lost = file.take_lost()
        if lost:
            self._put(lines.Lost(t_ns=now_ns, lines=lost))
        if now_ns >= self._clocks_due_ns:
            self._state = ()
            self._put_clocks(*self._read_clocks())
            if self._left_out or self._lines_left_out:
                requests, told = self._left_out, self._lines_left_out
                self._left_out = self._lines_left_out = 0
                self._put(lines.Lost(t_ns=now_ns, lines=told, requests=requests))

    # --- what is written -------------------------------------------------------------------------

    def engine_found(self, engine: EngineHello, now_ns: int) -> None:
        if self._file is not None:
            self._put(lines.Engine(t_ns=now_ns, facts=engine))
            self._have_pulses_told()

    def _standing_frames(self, message: RecordBegins) -> tuple[dict[str, Any], ...]:
        """Without its contents, what a frame fires says nothing."""
        lease, shown = self._leases.standing, message.carried.shown_seq
        if lease is None or shown is None:
            return ()
        frames = self._frames.since(lease.token, shown)
        return tuple({"op": "frame", **_given(frame)} for frame in frames)

    def _have_pulses_told(self) -> None:
        """Tried again each turn, until the engine has taken it."""
        is_wanted = self._file is not None
        if is_wanted is not self._is_told and self._turn(is_wanted):
            self._is_told = is_wanted

    def engine_gone(self, now_ns: int) -> None:
        self._is_told = False
        self._lag_us = 0
        self._put(lines.EngineGone(t_ns=now_ns))

    def lease_begun(self, lease: StandingLease, now_ns: int) -> None:
        if self._file is None:
            return
        first = lease.calibrations[0] if lease.calibrations else None
        self._put(
            lines.LeaseBegun(
                t_ns=now_ns,
                client=lease.client,
                uid=lease.uid,
                calibration_name=None if first is None else first.name,
                calibration_digest=None if first is None else first.digest,
                calibration=None if first is None else first.calibration,
                others=lease.calibrations[1:],
                limits=lease.limits,
            )
        )

    def asked(self, request: Request, inbound: InboundMessage, now_ns: int) -> None:
        """Of the lease's holder, all; of others, within what their user may add: else any user
        could fill the disk with requests that are refused.
        """
        file = self._file
        if file is None or _op_of(request) in _UNRECORDED:
            return
        line = lines.Asked(
            t_ns=now_ns,
            number=inbound.number,
            client=self._client_of(request),
            uid=inbound.uid,
            request={"op": _op_of(request), **_given(request)},
        )
        payer: _Payer = "unlimited" if self._is_holders(request, inbound.uid) else inbound.uid
        if not self._may_add(line, payer, now_ns):
            self._left_out += 1
            return
        self._unanswered[inbound.number] = payer
        self._put(line)

    def streamed(self, frame: Frame, uid: int | None, now_ns: int) -> None:
        """A frame that was passed on."""
        if self._file is not None:
            request = {"op": "frame", **_given(frame)}
            client = self._client_of(frame)
            self._put(lines.Asked(t_ns=now_ns, number=0, client=client, uid=uid, request=request))

    def replied(self, inbound: InboundMessage, reply: Success | Failure, now_ns: int) -> None:
        if inbound.number not in self._unanswered:
            return
        payer = self._unanswered.pop(inbound.number)
        said = msgspec.to_builtins(reply)
        told = {key: value for key, value in said.items() if key not in _ENVELOPE}
        line = lines.Replied(t_ns=now_ns, number=inbound.number, ok=reply.ok, reply=told)
        self._put_within(line, payer, now_ns)

    def refused_stream(self, report: RefusedReport, now_ns: int) -> None:
        """Frames that were not passed on: any user can send such."""
        self._put_within(lines.Refusal(report=report), "together", now_ns)

    def heard(self, message: ToGateway, now_ns: int) -> None:
        """Of the engine. Raises: Undecodable, for pulses that are none."""
        if isinstance(message, Report) and message.state is not None:
            # Also while no record runs: one that begins has clocks that hold.
            self._lag_us = message.state.clock_lag_us
        if self._file is None:
            return
        if isinstance(message, PulseBatch):
            self._put_pulses(message, now_ns)
        elif isinstance(message, LeaseEndedMessage):
            self._put(lines.LeaseEnded(t_ns=now_ns, reason=message.reason))
        elif isinstance(message, EngineHello):
            self.engine_found(message, now_ns)
        elif isinstance(message, RecordBegins):
            frames = self._standing_frames(message)
            self._put(lines.Carried(carried=message.carried, frames=frames))
        elif isinstance(message, Report):
            self._put_report(message, now_ns)

    def note(self, text: str, uid: int | None, now_ns: int) -> None:
        """Raises: Refused (`no_record`, `busy`)."""
        if self._file is None:
            raise Refused("no_record", "no record is being written: etd record start NAME")
        board_ns = now_ns - self._lag_us * 1_000
        line = lines.Note(t_ns=board_ns, text=text, uid=uid)
        if not self._may_add(line, uid, now_ns):
            raise Refused(
                "busy",
                f"this user has added {MOST_BYTES // 1024} KiB to the record, and may add"
                f" {BYTES_A_SECOND // 1024} KiB more each second: send it again later, or begin a"
                " new record",
            )
        self._put(line)

    def _may_add(self, line: lines.Line, payer: _Payer, now_ns: int) -> bool:
        if payer == "unlimited":
            return True
        allowance = self._allowances.setdefault(payer, Allowance(now_ns))
        return allowance.take(len(lines.encoded(line)), now_ns)

    def _put_within(self, line: lines.Line, payer: _Payer, now_ns: int) -> None:
        """Beyond what its payer may add it is left out, and counted."""
        if self._file is None:
            return
        if self._may_add(line, payer, now_ns):
            self._put(line)
        elif payer == "together":
            self._lines_left_out += 1
        else:
            self._left_out += 1

    def _put_pulses(self, batch: PulseBatch, now_ns: int) -> None:
        if batch.lost:
            self._put(lines.Lost(t_ns=now_ns, pulses=batch.lost))
        rows = tuple(rows_of(batch.rows))
        for at in range(0, len(rows), _ROWS_A_LINE):
            self._put(lines.Pulses(rows=rows[at : at + _ROWS_A_LINE]))

    def _put_report(self, report: Report, now_ns: int) -> None:
        if report.scan is not None:
            scan = report.scan
            fields = {name: getattr(scan, name) for name in lines.Scans.__struct_fields__}
            self._put(lines.Scans(**fields))
        elif report.state is not None:
            self._put_state(report.state, now_ns)
        elif report.contact is not None:
            self._put(lines.Touched(report=report.contact))
        elif report.halt is not None:
            self._put(lines.Halted(report=report.halt))
        elif report.refused is not None:
            self._put(lines.Refusal(report=report.refused))

    def _put_state(self, report: StateReport, now_ns: int) -> None:
        """At each change of what a reader looks for; counters alone are no change. Any user can
        make it change by answers, without end.
        """
        told = (
            report.state,
            report.halt,
            report.holder,
            report.not_granted,
            report.session and report.session.participant,
            tuple(report.sensor_problems),
            report.felt and report.felt.laws_off,
            report.felt and report.felt.answers,
        )
        if told != self._state:
            payer: _Payer = "together" if told[:-1] == self._state[:-1] else "unlimited"
            self._state = told
            self._put_within(lines.State(report=report), payer, now_ns)

    def _put_clocks(self, now_ns: int, wall_ns: int, uncertainty_ns: int) -> None:
        self._clocks_due_ns = now_ns + MINUTE_NS
        self._put(
            lines.Clocks(
                t_ns=now_ns,
                wall_ns=wall_ns,
                uncertainty_ns=uncertainty_ns,
                clock_lag_us=self._lag_us,
            )
        )

    def _put(self, line: lines.Line) -> None:
        file = self._file
        if file is not None and not file.put(lines.encoded(line)):
            self.problem = f"the record {self.running!r} is full and has ended"
            now_ns, _, _ = self._read_clocks()
            self._close(file, "full", now_ns)

    def _client_of(self, request: Request | Frame) -> str:
        named = getattr(request, "client", "")
        if named:
            return str(named)
        lease = self._leases.standing
        # Who does not name the lease does not hold it.
        is_holder = lease is not None and getattr(request, "lease", None) == lease.token
        return lease.client if lease is not None and is_holder else ""

    def _is_holders(self, request: Request, uid: int | None) -> bool:
        lease = self._leases.standing
        if lease is None or lease.uid != uid:
            return False
        return getattr(request, "lease", None) == lease.token


#: Of a reply: what is in the line itself, and the lease's token.
_ENVELOPE = ("ok", "now_ns", "id", "lease")


def _op_of(request: Request | Frame) -> str:
    tag = request.__struct_config__.tag
    return str(tag)


def _given(request: msgspec.Struct) -> dict[str, Any]:
    """What has no default there, without the lease's token and the reply's address."""
    return {
        name: msgspec.to_builtins(value)
        for name, default in _defaults_of(type(request))
        if (value := getattr(request, name)) != default
    }


@functools.cache
def _defaults_of(kind: type[msgspec.Struct]) -> tuple[tuple[str, object], ...]:
    fields = msgspec.structs.fields(kind)
    return tuple((it.name, it.default) for it in fields if it.name not in ("id", "lease"))
