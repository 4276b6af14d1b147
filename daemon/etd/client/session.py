"""The client's side of the protocol, without input or output.

Owns: the order of requests (hello, open, numbered frames, keep while waiting), requests as bytes,
replies matched by id, and refusals as `Refused`.
Must not know: sockets, clocks, whether the caller blocks or awaits.

Each method is a generator: it yields an `Ask`, is sent the reply, and returns the result. `Display`
and `AsyncDisplay` differ only in how they send an `Ask` and receive its reply.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Generator, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias, TypeVar

import msgspec

from etd.client import values
from etd.client.daemon_clock import DaemonClock
from etd.client.meant import Meant, check_limits, names_of
from etd.client.numbering import FrameNumbers
from etd.protocol.calibration import Calibration
from etd.protocol.errors import ErrorCode, Refused
from etd.protocol.facts import RecordFacts
from etd.protocol.messages import (
    MAX_MESSAGE_BYTES,
    REPLY_OF_OP,
    AccountReply,
    ArmReply,
    CalibrationReply,
    Failure,
    FeltReply,
    FrameReply,
    HelloReply,
    Id,
    LeaseReply,
    MarkReply,
    MeasureReply,
    RecordReply,
    StateReport,
    StatusReply,
    Success,
)
from etd.protocol.opening import LeaseCalibration
from etd.protocol.outcome import Account
from etd.protocol.text import escaped

#: While a slow request is under way, the lease is renewed this often.
KEEP_S = 0.3
#: The end of a record is answered when the disk has it, or after five seconds.
_DISK_S = 10.0
#: A frame of the program that others have overtaken is sent again so often.
_OVERTAKEN = 5
#: Gateway and engine read calibrations within eight seconds each; after 15 s it is answered.
_READ_S = 16.0


@dataclass(frozen=True, slots=True)
class Ask:
    """A request to be sent, and how to wait for its reply.

    `keep` makes the request that renews the lease, to be sent a few times a second while waiting.
    """

    op: str
    id: int
    data: bytes
    timeout_s: float
    keep: Callable[[], bytes] | None = None
    #: The lease that the request names.
    lease: str | None = None


R = TypeVar("R")
Flow: TypeAlias = Generator[Ask, Any, R]


class _Envelope(msgspec.Struct):
    id: Id | None = None
    ok: bool = False


#: What decoding can raise for bytes that are no reply.
UNREADABLE = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)

_envelope_decoder = msgspec.json.Decoder(_Envelope)
_failure_decoder = msgspec.json.Decoder(Failure)
#: Made while this module is imported, by one thread: two that are the first to decode into the same
#: struct crash msgspec 0.22 (a segmentation fault while it looks at the annotations).
_reply_decoders: dict[str, msgspec.json.Decoder[Any]] = {
    op: msgspec.json.Decoder(kind) for op, kind in REPLY_OF_OP.items()
}


class Session:
    """A client's state: the daemon's facts, its lease, and the last seq it used."""

    def __init__(
        self,
        client: str,
        *,
        calibration: str | Sequence[str] | None = None,
        digest: str | Sequence[str] | None = None,
        max_current_ua: int | None = None,
        width_us: int | None = None,
        timeout_s: float = 2.0,
    ) -> None:
        #: What is known of the daemon's, by which frames are stamped.
        self.daemon_clock = DaemonClock(is_here=True)
        calibrations = names_of(calibration)
        check_limits(calibrations, max_current_ua, width_us)
        self.facts: HelloReply | None = None
        self.lease: str | None = None
        #: The halt that ended the newest lease.
        self._halted: Refused | None = None
        self._client = escaped(client)[:64] or "client"
        self._calibrations, self._meant = calibrations, Meant(digest)
        self._max_current_ua = max_current_ua
        self._width_us = width_us
        self._timeout_s = values.above_zero_s("timeout_s", timeout_s)
        self._ids = itertools.count(1)
        self.numbers = FrameNumbers()

    @property
    def calibration_names(self) -> tuple[str, ...]:
        """Those that its lease is opened with, as far as they are known; empty: with limits."""
        if self._calibrations or self._max_current_ua is not None:
            return self._calibrations
        default = None if self.facts is None else self.facts.default_calibration
        return () if default is None else (default,)

    def greet(self) -> Flow[HelloReply]:
        """Read the facts. Raises: Refused (`engine_gone`) while no engine runs."""
        self.facts = yield self._ask("hello")
        return self.facts

    def status(self) -> Flow[StateReport]:
        reply: StatusReply = yield self._ask("status")
        return reply.status

    def stop(self, why: str = "") -> Flow[None]:
        said = escaped(f", {why}" if why else "")[:64]
        yield self._ask("stop", {"client": f"{self._client[: 64 - len(said)]}{said}"})

    def clear(self) -> Flow[None]:
        """Leave HALTED. No lease outlives a halt, so the next `arm` opens a new one."""
        yield self._ask("clear")
        self.lease = self._halted = None

    def arm(self, timeout_s: float) -> Flow[tuple[LeaseCalibration, ...]]:
        """Open a lease if there is none, then arm it; it is renewed while arming lasts."""
        yield from self._standing_lease()
        reply: ArmReply = yield self._ask("arm", timeout_s=timeout_s, keep=self._keep_data)
        try:
            self._meant.check(reply.calibrations)
        except Refused:
            yield from self.disarm()
            raise
        return reply.calibrations

    def arm_holder(self, timeout_s: float) -> Flow[tuple[LeaseCalibration, ...]]:
        """Arm the lease of its present holder: the operator's part."""
        reply: ArmReply = yield self._ask("arm", timeout_s=timeout_s)
        return reply.calibrations

    def disarm(self) -> Flow[None]:
        self.numbers.disarm()
        if self.lease is not None:
            yield self._ask("disarm", {"lease": self.lease})

    def keep(self) -> Flow[None]:
        yield self._ask("keep", {"lease": self._held_lease()})

    def close(self) -> Flow[None]:
        """Give the lease back. A lease that has already ended counts as closed."""
        if self.lease is None:
            return
        lease, self.lease = self.lease, None
        try:
            yield self._ask("close", {"lease": lease})
        except Refused as refusal:
            if refusal.code not in ("no_lease", "other_lease", "engine_gone", "halted"):
                raise

    def measure(self, timeout_s: float) -> Flow[MeasureReply]:
        yield from self._standing_lease()
        reply: MeasureReply = yield self._ask(
            "measure", {"lease": self.lease}, timeout_s=timeout_s, keep=self._keep_data
        )
        return reply

    def mark(self, tag: int | str | None) -> Flow[MarkReply]:
        given = values.mark_tag(tag)
        reply: MarkReply = yield self._ask("mark", {"lease": self._held_lease(), "tag": given})
        return reply

    def felt(self, answer: str, electrodes: Iterable[int] | None) -> Flow[FeltReply]:
        """With the program's lease where it holds one; without one it can only lower."""
        given = values.felt(answer, electrodes)
        if self.lease is not None:
            given["lease"] = self.lease
        reply: FeltReply = yield self._ask("felt", given)
        return reply

    def frame(
        self,
        fields: dict[str, object],
        after: int | None = None,
        lease: str | None = None,
        of: object = None,
    ) -> Flow[FrameReply]:
        """One frame with an answer, under this lease; without one, under that of the program, which
        is opened if none was. Raises: Refused (`old_seq`) if the newest frame is not the one
        `after` which this is to be sent; `no_lease`, `halted`, if the lease has ended. `of`: what
        it is a frame of (`FrameNumbers.newest_of`).
        """
        if lease is None:
            yield from self.opened()
        for _ in range(_OVERTAKEN):
            try:
                numbered = self._numbered(fields, after, lease, of)
                reply: FrameReply = yield self._ask("frame", numbered)
            except Refused as refusal:
                # A frame that goes on beside the program was numbered later, and came first.
                if refusal.code != "old_seq" or after is not None:
                    raise
            else:
                return reply
        raise Refused("old_seq", "other frames of this program are faster: send one at a time")

    def preview(self, fields: dict[str, object], lease: str | None = None) -> Flow[FrameReply]:
        """As `frame`, for a frame that is not shown: no number is used up."""
        if lease is None:
            yield from self.opened()
        held, asked = self._held_lease(lease), {**fields, "preview": True}
        numbered = self._stamped({"lease": held, "seq": self.numbers.newest + 1, **asked})
        reply: FrameReply = yield self._ask("frame", numbered)
        return reply

    def account(self, seq: int, lease: str | None = None) -> Flow[Account]:
        """Of a frame that was sent with `account`; waits until it is over. `lease`: the one that it
        was sent under, if that may have ended.
        """
        asked = {"lease": lease or self._held_lease(), "seq": seq}
        reply: AccountReply = yield self._ask("account", asked, keep=self._keeping)
        return reply.account

    def streamed(self, fields: dict[str, object]) -> bytes:
        """A frame for the frames socket. Raises: Refused (`no_lease`, `too_large`)."""
        self._held_lease()
        return _encoded({"op": "frame", **self._numbered(fields)})

    def calibrations(self) -> Flow[tuple[str, ...]]:
        reply: CalibrationReply = yield self._ask("calibration", {"do": "list"})
        return reply.names

    def get_calibration(self, name: str) -> Flow[Calibration]:
        wait_s, keep = max(_READ_S, self._timeout_s), self._keeping
        asked: dict[str, object] = {"do": "get", "name": name}
        reply: CalibrationReply = yield self._ask("calibration", asked, wait_s, keep)
        if reply.calibration is None:
            raise Refused("not_found", f"the daemon sent no calibration {name!r}")
        return reply.calibration

    def start_record(self, name: str) -> Flow[None]:
        yield self._ask("record", {"do": "start", "name": name})

    def stop_record(self) -> Flow[None]:
        """Raises: Refused (`no_record`; `record_failed`, if its end is not on the disk)."""
        reply: RecordReply = yield self._ask(
            "record", {"do": "stop"}, timeout_s=max(_DISK_S, self._timeout_s), keep=self._keeping
        )
        if reply.problem is not None:
            raise Refused("record_failed", f"its end is missing: {reply.problem}")

    def end_record(self, name: str) -> Flow[None]:
        """As `stop_record`, of this record. Raises: Refused (`record_failed`), if it had ended by
        itself.
        """
        listed: RecordReply = yield self._ask("record", {"do": "list"})
        if any(facts.is_running and facts.name == name for facts in listed.records):
            yield from self.stop_record()
            return
        why = listed.problem or "another client stopped it, or the daemon was restarted"
        raise Refused("record_failed", f"the record {name!r} ended too early: {why}")

    def records(self) -> Flow[tuple[RecordFacts, ...]]:
        reply: RecordReply = yield self._ask("record", {"do": "list"})
        return reply.records

    def fetch_record(self, name: str, write: Callable[[bytes], object]) -> Flow[int]:
        """Piece by piece, up to what was written when the last piece was read."""
        offset = 0
        while True:
            asked = {"do": "get", "name": name, "offset": offset}
            reply: RecordReply = yield self._ask("record", asked)
            if not reply.data:
                return offset
            write(reply.data)
            offset += len(reply.data)

    def delete_record(self, name: str) -> Flow[None]:
        yield self._ask("record", {"do": "delete", "name": name})

    def note(self, text: str) -> Flow[None]:
        yield self._ask("note", {"text": text})

    def settle(self, ask: Ask, data: bytes) -> Success | None:
        """The reply to `ask`; None if it answers another.

        Raises: Refused, as the daemon says; UNREADABLE.
        """
        envelope = _envelope_decoder.decode(data)
        if envelope.id != ask.id:
            return None
        if envelope.ok:
            reply: Success = _reply_decoders[ask.op].decode(data)
            return reply
        failure = _failure_decoder.decode(data)
        refusal = Refused(
            failure.error,
            failure.reason,
            failure.electrode,
            failure.achievable_hz,
            failure.bound_by,
        )
        if refusal.code in ("no_lease", "other_lease", "halted") and ask.lease == self.lease:
            self.lease = None
            self._halted = refusal if refusal.code == "halted" else None
        raise refusal

    def _standing_lease(self) -> Flow[None]:
        """Renew the lease, or open a new one if it has lapsed."""
        if self.lease is not None:
            try:
                yield self._ask("keep", {"lease": self.lease})
            except Refused as refusal:
                if refusal.code not in ("no_lease", "other_lease"):
                    raise
                self.lease = None
        yield from self.opened()

    def opened(self) -> Flow[None]:
        """Have a lease: opened if there is none."""
        if self.lease is not None:
            return
        limits = yield from self._limits()
        asked = {"client": self._client, **limits, **self._meant.fields}
        wait_s = self._timeout_s if "limits" in limits else max(_READ_S, self._timeout_s)
        reply: LeaseReply = yield self._ask("open", asked, timeout_s=wait_s)
        self.lease, self._halted = reply.lease, None
        self.numbers.begin_lease()
        try:
            self._meant.check(reply.calibrations)
        except Refused:
            yield from self.close()
            raise

    def _limits(self) -> Flow[dict[str, object]]:
        """The limits of the lease: given here, or else the daemon's default calibration."""
        if self._calibrations:
            first, *others = self._calibrations
            return {"calibration": self._calibrations if others else first}
        if self._max_current_ua is not None:
            return {"limits": {"max_current_ua": self._max_current_ua, "width_us": self._width_us}}
        if self.facts is None:
            yield from self.greet()
        if self.facts is not None and self.facts.default_calibration is not None:
            return {"calibration": self.facts.default_calibration}
        raise Refused("limits_missing", _TEACH_LIMITS)

    def _held_lease(self, wanted: str | None = None) -> str:
        """`wanted`: no other will do. Raises: Refused (`halted`, if a halt has ended it;
        `no_lease`).
        """
        held = self.lease
        if held is not None and wanted in (None, held):
            return held
        if self._halted is not None:
            raise Refused("halted", f"{self._halted.reason}; it ended the lease: call arm() first")
        if wanted is not None:
            why = (
                "the lease that it was shown under has ended (not renewed for too long, or closed)"
            )
            raise Refused("no_lease", f"{why}: call arm() first")
        raise Refused("no_lease", "this display holds no lease: call arm() first")

    @property
    def _keeping(self) -> Callable[[], bytes] | None:
        """What renews the lease, if there is one, while a reply is waited for."""
        return None if self.lease is None else self._keep_data

    def _keep_data(self) -> bytes:
        return self._ask("keep", {"lease": self.lease}).data

    def _numbered(
        self,
        fields: dict[str, object],
        after: int | None = None,
        lease: str | None = None,
        of: object = None,
    ) -> dict[str, object]:
        with self.numbers.lock:
            held = self._held_lease(lease)
            numbered = {"lease": held, "seq": self.numbers.take(after, of), **fields}
        return self._stamped(numbered)

    def _stamped(self, fields: dict[str, object]) -> dict[str, object]:
        """By the daemon's clock."""
        sent_ns = fields.get("sent_ns")
        if isinstance(sent_ns, int):
            return {**fields, "sent_ns": self.daemon_clock.at_least_ns(sent_ns)}
        return fields

    def _ask(
        self,
        op: str,
        fields: dict[str, object] | None = None,
        timeout_s: float | None = None,
        keep: Callable[[], bytes] | None = None,
    ) -> Ask:
        wait_s = self._timeout_s
        if timeout_s is not None:
            wait_s = values.above_zero_s("timeout_s", timeout_s)
        number = next(self._ids)
        given = {key: value for key, value in (fields or {}).items() if value is not None}
        data = _encoded({"op": op, "id": number, **given})
        lease = given.get("lease")
        return Ask(op, number, data, wait_s, keep, lease if isinstance(lease, str) else None)


_TEACH_LIMITS = (
    "no limits are given for this person: use Display(calibration='NAME'), or"
    " Display(max_current_ua=..., width_us=...), or set default_calibration in the daemon's"
    " configuration"
)


def _encoded(message: dict[str, object]) -> bytes:
    data = msgspec.json.encode(message)
    if len(data) > MAX_MESSAGE_BYTES:
        code: ErrorCode = "too_large"
        raise Refused(
            code,
            f"this {message['op']} has {len(data)} bytes, and {MAX_MESSAGE_BYTES} are allowed: give"
            " one value where all electrodes have the same, and a ring instead of explicit returns",
        )
    return data
