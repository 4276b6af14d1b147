"""What clients may do with records: start, stop, list, get, delete, note.

Owns: who may do which, and the replies. Must not know: sockets, files, what a record says.
"""

from __future__ import annotations

import functools

import msgspec

from etd.gateway.config import Operators
from etd.gateway.engine_link import EngineLink
from etd.gateway.inbound import InboundMessage
from etd.gateway.lease import StandingLease
from etd.gateway.pending import Awaited, PendingRequests
from etd.gateway.record_store import RecordStore
from etd.gateway.recorder import Recorder
from etd.protocol.errors import Refused
from etd.protocol.link import Answer, RecordPulses
from etd.protocol.messages import Note, Record, RecordReply, Success
from etd_hal.ports import Clock

#: A stop is answered so late at most, however slow the disk is.
CLOSED_NS = 5_000_000_000


class RecordHandler:
    def __init__(
        self,
        store: RecordStore,
        recorder: Recorder,
        engine: EngineLink,
        pending: PendingRequests,
        clock: Clock,
        operators: Operators,
    ) -> None:
        self._store = store
        self._recorder = recorder
        self._engine = engine
        self._pending = pending
        self._clock = clock
        self._operators = operators
        #: The requests to stop that wait for the disk: their refs, and until when.
        self._awaiting: list[tuple[int, int]] = []

    def handle(self, request: Record, inbound: InboundMessage) -> Success | Awaited:
        """The reply, or what makes it of the engine's answer to its ref. Raises: Refused."""
        if request.do == "start":
            self.start(_name_of(request), inbound.uid)
        elif request.do == "stop":
            self._check_stop(inbound)
            if self._engine.is_there:
                # What the engine has gathered comes before its answer.
                ref, serial = self._pending.next_ref_of(inbound.uid), self._recorder.serial
                self._engine.command(RecordPulses(ref=ref, is_on=False))
                return Awaited(ref, functools.partial(self._stop, inbound.uid, serial))
            return self._stop(inbound.uid, self._recorder.serial)
        elif request.do == "get":
            name = _name_of(request)
            self._check_may(inbound, name, self._owner(name))
            data = self._store.piece(name, request.offset)
            return RecordReply(ok=True, now_ns=0, data=data)
        elif request.do == "delete":
            self._delete(_name_of(request), inbound)
        return self._reply()

    def note(self, request: Note, inbound: InboundMessage) -> Success:
        """Raises: Refused (`no_record`, `not_permitted`, `busy`)."""
        running = self._recorder.running
        if running is not None:
            self._check_may(inbound, running, self._recorder.uid)
        self._recorder.note(request.text, inbound.uid, self._clock.now_ns())
        return Success(ok=True, now_ns=0)

    def start(self, name: str, uid: int | None) -> None:
        """Raises: Refused (`wrong_state`, `record_failed`)."""
        engine = self._engine.engine_hello() if self._engine.is_there else None
        self._recorder.start(name, uid, engine, self._engine.state)

    def _reply(self) -> RecordReply:
        running, problem = self._recorder.running, self._recorder.problem
        records = self._store.facts(running)
        return RecordReply(ok=True, now_ns=0, records=records, problem=problem)

    def lease_begun(self, lease: StandingLease) -> None:
        self._recorder.lease_begun(lease, self._clock.now_ns())

    def _check_stop(self, inbound: InboundMessage) -> None:
        running = self._recorder.running
        if running is None:
            raise Refused("no_record", "no record is being written")
        self._check_may(inbound, running, self._recorder.uid)

    def _owner(self, name: str) -> int | None:
        """Raises: Refused (`not_found`, `record_failed`)."""
        is_running = name == self._recorder.running
        return self._recorder.uid if is_running else self._store.owner(name)

    def _check_may(self, inbound: InboundMessage, name: str, owner: int | None) -> None:
        """A record says what a person felt. Raises: Refused (`not_permitted`)."""
        if inbound.uid != owner and not self._operators.is_one(inbound.uid):
            raise Refused(
                "not_permitted",
                f"the record {name!r} is another user's: only who began it, an operator that the"
                " settings name, and root may read it, add a note, end it or delete it",
            )

    def written(self, now_ns: int) -> list[Answer]:
        """Called once a turn: answers the requests to stop once the disk has all, or is slow."""
        if not self._awaiting:
            return []
        is_closed = self._recorder.closing is None
        due = [ref for ref, until_ns in self._awaiting if is_closed or now_ns >= until_ns]
        self._awaiting = [it for it in self._awaiting if it[0] not in due]
        return [Answer(ref=ref) for ref in due]

    def _stop(self, uid: int, serial: int, _: Answer | None = None) -> Awaited:
        """The reply comes when the disk has all; meanwhile the gateway serves everyone. One that
        was begun since the request came goes on: it may be another user's.
        """
        ref, now_ns = self._pending.next_ref_of(uid), self._clock.now_ns()
        if serial == self._recorder.serial:
            self._recorder.stop("stopped", now_ns)
        self._awaiting.append((ref, now_ns + CLOSED_NS))
        return Awaited(ref, lambda _: self._stopped())

    def _stopped(self) -> RecordReply:
        reply, name = self._reply(), self._recorder.closing
        if name is None:
            return reply
        why = f"the disk is slow, and the end of {name!r} is still being written"
        return msgspec.structs.replace(reply, problem=why)

    def _delete(self, name: str, inbound: InboundMessage) -> None:
        self._check_may(inbound, name, self._owner(name))
        if name in (self._recorder.running, self._recorder.closing):
            raise Refused("wrong_state", f"{name!r} is being written: stop it first")
        self._store.delete(name)


def _name_of(request: Record) -> str:
    if request.name is None:
        raise Refused("bad_message", f"record with do = {request.do} needs the key name")
    return request.name
