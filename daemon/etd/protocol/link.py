"""The messages between gateway and engine, and the two Unix sockets they cross.

Owns: the messages of both processes, and a channel that never blocks: a datagram is taken whole or
not at all, and a datagram that does not fit is dropped and counted. Must not know: ZeroMQ, JSON and
clients (the gateway handles them), devices (the engine handles them).

Commands and frames have a socket each, so that no command waits behind a frame. Both carry
msgpack of the structs below; each end decodes only the other's union.
"""

from __future__ import annotations

import contextlib
import errno
import os
import select
import socket
from collections import deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, Generic, Literal, TypeVar

import msgspec
from msgspec import Meta

from etd.protocol.carried import CarriedOver
from etd.protocol.errors import AlreadyRunning, ErrorCode, Refused, TimePart, Undecodable
from etd.protocol.facts import ArrayFacts, BoardFacts, MaximaFacts
from etd.protocol.felt import FeltDone, Named
from etd.protocol.frame import ClientName, Frame, MarkTag, Polarity
from etd.protocol.messages import (
    Contact,
    Halt,
    Limits,
    Marked,
    Modelled,
    RefusedReport,
    Scan,
    StateReport,
)
from etd.protocol.opening import LeaseCalibration, WantedCalibrations
from etd.protocol.outcome import Account, Clamp, Shortfall
from etd.protocol.peer import Peer, peer_of
from etd.protocol.who import Uid, Who
from etd.stabilize.offset_estimate import Answer as FeltAnswer
from etd.stabilize.shape import PLAIN, Shape

#: The gateway sends at least this often; after SILENCE_NS without a message the skin is silent.
ALIVE_NS = 50_000_000
SILENCE_NS = 250_000_000
#: A datagram is never larger: a frame of 256 electrodes with explicit returns fits.
MAX_DATAGRAM_BYTES = 192 * 1024
#: Asked for, of frames that are not over: the gateway asks for no more at once.
MOST_ACCOUNTS = 32

#: A lease's token. Its length, and that of a client's name, is bounded so that every report has
#: room.
Token = Annotated[str, Meta(max_length=64)]


class _Message(msgspec.Struct, frozen=True, kw_only=True, tag=True):
    """Tagged by its class name."""


class Command(_Message, frozen=True, kw_only=True):
    """Gateway to engine. `ref` comes back in the `Answer`; 0 wants none."""

    ref: int = 0


class Alive(Command, frozen=True, kw_only=True):
    """The gateway is there."""


class OpenLease(Command, frozen=True, kw_only=True):
    """A new lease with the limits of the person; enters in SAFE only. `calibrations`: of one
    person, each made with another polarity; the engine reads them itself. The answer comes when it
    has.
    """

    lease: Token
    client: ClientName
    calibrations: WantedCalibrations = ()
    limits: Limits | None = None


class KeepLease(Command, frozen=True, kw_only=True):
    lease: Token


class CloseLease(Command, frozen=True, kw_only=True):
    lease: Token


class DisarmBoard(Command, frozen=True, kw_only=True):
    lease: Token


class ArmBoard(Command, frozen=True, kw_only=True):
    """The answer comes when the board is armed, or when that has failed."""


class ClearHalt(Command, frozen=True, kw_only=True):
    """`uid`: of the user who asks, by the kernel; None: nobody's."""

    uid: Uid | None = None
    is_operator: bool = False


class StopNow(Command, frozen=True, kw_only=True):
    """`client`: so that the halt says whose stop it was. `uid`: as in `ClearHalt`."""

    client: Who
    uid: Uid | None = None


class MeasureContact(Command, frozen=True, kw_only=True):
    lease: Token


class SetMark(Command, frozen=True, kw_only=True):
    lease: Token
    tag: MarkTag | None = None


class SayFelt(Command, frozen=True, kw_only=True):
    """What the person says of the strength. `lease` None: of somebody who can only lower."""

    answer: FeltAnswer
    electrodes: Named | None = None
    lease: Token | None = None


class AskAccount(Command, frozen=True, kw_only=True):
    """The answer comes when the frame is over."""

    lease: Token
    seq: int


class RecordPulses(Command, frozen=True, kw_only=True):
    """From now on every pulse that is fired is told, or none any more."""

    is_on: bool


class NewFrame(_Message, frozen=True, kw_only=True):
    """A frame of the right shape, with the token of its lease.

    `ref` 0: streamed, answered by a `RefusedReport` if it is refused and by nothing otherwise.
    """

    ref: int
    frame: Frame


ToEngine = (
    Alive
    | OpenLease
    | KeepLease
    | CloseLease
    | DisarmBoard
    | ArmBoard
    | ClearHalt
    | StopNow
    | MeasureContact
    | SetMark
    | SayFelt
    | AskAccount
    | RecordPulses
)


class EngineHello(_Message, frozen=True, kw_only=True):
    """The engine's first message on the command socket: the board, the array and their maxima."""

    board: BoardFacts
    array: ArrayFacts
    body_site: str
    maxima: MaximaFacts
    default_width_us: int
    default_rate_hz: float
    default_polarity: Polarity
    shape: Shape = PLAIN
    stabilizers: tuple[str, ...] = ()
    felt_may_raise: bool = False
    balance: Literal["biphasic"] | None = None
    #: SHA-256 of each file of the configuration, by what it describes.
    digests: dict[str, str] = {}


class Answer(_Message, frozen=True, kw_only=True):
    """The answer to the command or frame with this `ref`. `error` None: done."""

    ref: int
    error: ErrorCode | None = None
    reason: str = ""
    electrode: int | None = None
    achievable_hz: float | None = None
    bound_by: TimePart | None = None
    rate_hz: float | None = None
    calibrated_hz: float | None = None
    clamped: tuple[Clamp, ...] = ()
    slowed: tuple[Shortfall, ...] = ()
    contact: Contact | None = None
    account: Account | None = None
    felt: FeltDone | None = None
    marked_ns: int | None = None
    sync: bool = False
    trigger_ns: int | None = None
    #: With which a lease was opened, or armed.
    calibrations: tuple[LeaseCalibration, ...] = ()

    @classmethod
    def refusing(cls, ref: int, refusal: Refused) -> Answer:
        """The answer to a command or frame that was refused."""
        return cls(ref=ref, **refusal.fields)


class LeaseEnded(_Message, frozen=True, kw_only=True):
    """The lease has ended, and why: lapsed, closed, halted."""

    lease: str
    reason: str


class Report(_Message, frozen=True, kw_only=True):
    """Telemetry for all clients: exactly one of these."""

    state: StateReport | None = None
    scan: Scan | None = None
    contact: Contact | None = None
    refused: RefusedReport | None = None
    halt: Halt | None = None
    mark: Marked | None = None
    modelled: Modelled | None = None


class PulseBatch(_Message, frozen=True, kw_only=True):
    """Pulses that were fired, of `pulse_row.ROW_BYTES` each, and how many were lost before."""

    rows: bytes
    lost: int = 0


class RecordBegins(_Message, frozen=True, kw_only=True):
    """Every pulse is told from now on; and what decides over them from before."""

    carried: CarriedOver


ToGateway = EngineHello | Answer | LeaseEnded | Report | PulseBatch | RecordBegins

In = TypeVar("In")
_encoder = msgspec.msgpack.Encoder()


class Channel(Generic[In]):
    """One end of a SEQPACKET connection. Never blocks; a send that does not fit is dropped."""

    def __init__(self, connection: socket.socket, incoming: type[In] | object) -> None:
        connection.setblocking(False)
        for option in (socket.SO_SNDBUF, socket.SO_RCVBUF):
            connection.setsockopt(socket.SOL_SOCKET, option, 2 * MAX_DATAGRAM_BYTES)
        self._socket = connection
        #: Polled before a read: a read that finds nothing costs three times as much.
        self._poller = select.poll()
        self._poller.register(connection, select.POLLIN)
        self._decoder: msgspec.msgpack.Decoder[In] = msgspec.msgpack.Decoder(incoming)
        self.is_open = True
        #: Read when the other end was found to be gone: a stop may be among it.
        self._left: deque[bytes] = deque()
        self.dropped = 0
        self.received_bytes = 0

    @property
    def peer(self) -> Peer:
        """Who is at the other end. Raises: OSError."""
        return peer_of(self._socket)

    def fileno(self) -> int:
        """For a poller."""
        return self._socket.fileno()

    @property
    def has_come(self) -> bool:
        """A message, or the end, is there to be received."""
        return bool(self._poller.poll(0))

    def send(self, message: object) -> bool:
        """True if the other end will get it; otherwise it is dropped and counted."""
        if not self.is_open:
            return False
        try:
            self._socket.send(_encoder.encode(message))
        except BlockingIOError:
            self.dropped += 1
            return False
        except OSError as error:
            if error.errno in (errno.EMSGSIZE, errno.ENOBUFS):
                self.dropped += 1
            else:
                self._keep_what_has_come()
                self.close()
            return False
        return True

    def _keep_what_has_come(self) -> None:
        """No more than the kernel's buffer holds."""
        with contextlib.suppress(OSError):
            while data := self._socket.recv(MAX_DATAGRAM_BYTES):
                self._left.append(data)

    def receive(self) -> In | None:
        """The next message, or None; also what had come before the other end was gone. Raises:
        Undecodable for bytes that are none.
        """
        if self._left:
            data = self._left.popleft()
            self.received_bytes += len(data)
            return decoded(self._decoder, data)
        if not self.is_open or not self._poller.poll(0):
            return None
        try:
            data = self._socket.recv(MAX_DATAGRAM_BYTES)
        except (BlockingIOError, InterruptedError):
            return None
        except OSError:
            self.close()
            return None
        if not data:
            self.close()
            return None
        self.received_bytes += len(data)
        return decoded(self._decoder, data)

    def close(self) -> None:
        """Idempotent."""
        self.is_open = False
        self._socket.close()


def decoded(decoder: msgspec.msgpack.Decoder[In], data: bytes) -> In:
    """Raises: Undecodable for bytes that are no message."""
    try:
        return decoder.decode(data)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise Undecodable(str(error)) from None


def wait_for_any(channels: Sequence[Channel[Any]], timeout_s: float) -> bool:
    """Whether a message, or the end, of one of them has come within so many seconds."""
    if timeout_s <= 0.0:
        return any(channel.has_come for channel in channels)
    # Not with `poll`, which counts in milliseconds: a loop of one a millisecond would be late.
    return bool(select.select(channels, (), (), timeout_s)[0])


def socket_paths(folder: Path) -> tuple[Path, Path]:
    """Of commands and frames."""
    return folder / "engine-commands.sock", folder / "engine-frames.sock"


class Listener:
    """The engine's end: waits for the one gateway on both sockets, never blocking.
    `is_of_one_user`: gateway and engine are; else the gateway's user is in the folder's group, and
    no others are.
    """

    def __init__(self, folder: Path, *, is_of_one_user: bool = False) -> None:
        mode = 0o600 if is_of_one_user else 0o660
        self._listening = [_listen(path, folder.name, mode) for path in socket_paths(folder)]

    def accept(self) -> tuple[Channel[ToEngine], Channel[NewFrame]] | None:
        """Both channels of a gateway that has connected, or None."""
        try:
            commands, _ = self._listening[0].accept()
        except BlockingIOError:
            return None
        try:
            self._listening[1].settimeout(0.05)
            frames, _ = self._listening[1].accept()
        except OSError:
            commands.close()
            return None
        finally:
            self._listening[1].setblocking(False)
        return Channel(commands, ToEngine), Channel(frames, NewFrame)

    def close(self) -> None:
        for listening in self._listening:
            with contextlib.suppress(OSError):
                Path(listening.getsockname()).unlink()
            listening.close()


def _listen(path: Path, name: str, mode: int) -> socket.socket:
    listening = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    try:
        if _is_answered(path):
            raise AlreadyRunning(name, f"its engine answers at {path}")
        path.unlink(missing_ok=True)
        with _created_with(mode):
            listening.bind(str(path))
        listening.listen(1)
        listening.setblocking(False)
    except BaseException:
        listening.close()
        raise
    return listening


@contextlib.contextmanager
def _created_with(mode: int) -> Iterator[None]:
    """A socket has its mode from the start: a change of it later could follow a link."""
    before = os.umask(0o777 & ~mode)
    try:
        yield
    finally:
        os.umask(before)


def _is_answered(path: Path) -> bool:
    with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as probe:
        probe.setblocking(False)
        try:
            probe.connect(str(path))
        except BlockingIOError:
            return True  # by an engine that others wait for already
        except OSError:
            return False
    return True


def connect(folder: Path) -> tuple[Channel[ToGateway], Channel[ToGateway]] | None:
    """The gateway's end: both channels, or None while no engine listens there, or others wait for
    it already: waiting behind them, a gateway would hear no stop and no signal.
    """
    opened: list[socket.socket] = []
    try:
        for path in socket_paths(folder):
            connection = socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            opened.append(connection)
            connection.setblocking(False)
            connection.connect(str(path))
    except OSError:
        for connection in opened:
            connection.close()
        return None
    return Channel(opened[0], ToGateway), Channel(opened[1], ToGateway)
