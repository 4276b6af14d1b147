"""The display, as an application uses it.

Owns: sending each request of `Session` to the daemon and blocking until the answer comes.
Must not know: the order of requests (session), the options of a frame (options).

    with Display() as display:
        display.arm()
        display.hold(levels, seconds=2)
"""

from __future__ import annotations

import contextlib
from typing import Self, Unpack

import zmq

from etd.client import clock, values, wire
from etd.client.connection import Connection
from etd.client.opening import Opening
from etd.client.options import FrameOptions, Kind, frame_fields, renewal_s, silent_fields
from etd.client.session import KEEP_S, Ask, Flow, R
from etd.client.telemetry import Telemetry
from etd.client.values import Numbers
from etd.protocol.calibration import Calibration
from etd.protocol.errors import DaemonGone, EtdError, Refused
from etd.protocol.messages import (
    FrameReply,
    HelloReply,
    MarkReply,
    MeasureReply,
    StateReport,
    Success,
    Topic,
)


class Display(Connection["zmq.Socket[bytes]"]):
    """Blocking; for one thread at a time. `Connection` describes the arguments."""

    def _new_context(self) -> zmq.Context[zmq.Socket[bytes]]:
        return zmq.Context()

    def _begin(self) -> None:
        try:
            wire.check_there(self.address)
            self._greet()
        except BaseException:
            self._hang_up()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def facts(self) -> HelloReply:
        """Board, array with positions, maxima, calibrations. Raises: Refused (`engine_gone`)."""
        return self._session.facts or self._run(self._session.greet())

    @property
    def electrodes(self) -> int:
        """How many values a frame has."""
        return self.facts.array.electrodes

    def status(self) -> StateReport:
        """The state now; answered even while the engine is gone."""
        return self._run(self._session.status())

    def arm(self, timeout_s: float = 10.0, *, open_to: Numbers | float | None = None) -> None:
        """Open the lease if none stands, check the board and enable the supply; blocks for it.

        `open_to`: then fire these levels (one number: on all electrodes) until the soft start lets
        them through, and be silent. It is felt: it takes a second for each 4 mA. Once a session is
        enough, see docs/protocol.md. Raises: Refused (`wrong_state`) if they do not get through.
        """
        self._run(self._session.arm(timeout_s))
        if open_to is not None:
            self._open_to(open_to)

    def arm_holder(self, timeout_s: float = 10.0) -> None:
        """The operator's `arm`: arms the lease of its present holder."""
        self._run(self._session.arm_holder(timeout_s))

    def disarm(self) -> None:
        """Supply off; the lease stays. Does nothing without a lease."""
        self._run(self._session.disarm())

    def keep(self) -> None:
        """Renew the lease, without a frame."""
        self._run(self._session.keep())

    def show(self, levels: Numbers, **options: Unpack[FrameOptions]) -> FrameReply:
        """One frame of levels for all electrodes: 0 is silent, 0..1 from threshold to comfortable.
        Returns when it is accepted, with the clamps of its limits.
        """
        return self._run(self._session.frame(frame_fields("level", levels, options)))

    def show_current(self, current_ua: Numbers, **options: Unpack[FrameOptions]) -> FrameReply:
        """One frame of currents, in uA for each electrode: an upper bound, whatever stabilizers the
        body site has. Widths that `strength_duration` would change are refused.
        """
        return self._run(self._session.frame(frame_fields("current_ua", current_ua, options)))

    def hold(self, levels: Numbers, seconds: float, **options: Unpack[FrameOptions]) -> None:
        """Show levels for `seconds`, then silence. Blocks; renews the frame within its ttl.

        Ctrl-C ends it silent.
        """
        self._hold("level", levels, seconds, options)

    def hold_current(
        self, current_ua: Numbers, seconds: float, **options: Unpack[FrameOptions]
    ) -> None:
        """Show currents for `seconds`, then silence; as `hold`."""
        self._hold("current_ua", current_ua, seconds, options)

    def stream(self, levels: Numbers, **options: Unpack[FrameOptions]) -> None:
        """One frame without an answer; the newest wins. A refusal comes as telemetry `refused`."""
        self._stream(frame_fields("level", levels, options))

    def stream_current(self, current_ua: Numbers, **options: Unpack[FrameOptions]) -> None:
        """The same for currents in uA."""
        self._stream(frame_fields("current_ua", current_ua, options))

    def measure(self, timeout_s: float = 10.0) -> MeasureReply:
        """Contact of all electrodes, with probe pulses; from SAFE back to SAFE."""
        return self._run(self._session.measure(timeout_s))

    def mark(self, tag: int | None = None) -> MarkReply:
        """Mark this time in telemetry, with an edge on SYNC if the board has that line."""
        return self._run(self._session.mark(tag))

    def stop(self) -> None:
        """Silence at once, whichever client holds the lease; HALTED until `clear`."""
        self._run(self._session.stop())

    def clear(self) -> None:
        """Leave HALTED for SAFE; then `arm()` anew."""
        self._run(self._session.clear())

    def calibrations(self) -> tuple[str, ...]:
        """The names that the daemon knows."""
        return self._run(self._session.calibrations())

    def calibration(self, name: str) -> Calibration:
        """Raises: Refused (`not_found`)."""
        return self._run(self._session.get_calibration(name))

    def set_calibration(self, name: str, calibration: Calibration) -> None:
        """Keep a calibration under a name; in SAFE only, needs operate rights."""
        self._run(self._session.set_calibration(name, calibration))

    def delete_calibration(self, name: str) -> None:
        """Have the daemon forget it; needs operate rights. Raises: Refused (`not_found`)."""
        self._run(self._session.delete_calibration(name))

    def telemetry(self, *topics: Topic, timeout_s: float | None = None) -> Telemetry:
        """`with display.telemetry("scan") as reports: for topic, report in reports: ...`"""
        address = self._telemetry_address()
        return Telemetry(self._context, address, topics, timeout_s, join_s=self._timeout_s)

    def close(self) -> None:
        """Give the lease back (which disarms) and hang up. Idempotent."""
        if self._context.closed:
            return
        try:
            self._run(self._session.close())
        except DaemonGone:
            pass  # nobody is there to be told; the lease has ended with the daemon, or lapses
        finally:
            self._hang_up()

    def _hold(self, kind: Kind, numbers: Numbers, seconds: float, options: FrameOptions) -> None:
        fields = frame_fields(kind, numbers, options)
        held_s = values.above_zero_s("seconds", seconds)
        end_ns = clock.now_ns() + int(held_s * 1e9)
        try:
            while (left_s := (end_ns - clock.now_ns()) / 1e9) > 0:
                self._run(self._session.frame({**fields, "sent_ns": clock.now_ns()}))
                clock.sleep_s(min(renewal_s(options), left_s))
        except KeyboardInterrupt:
            with contextlib.suppress(EtdError):  # the frame expires by itself
                self._run(self._session.frame(silent_fields(fields)))
            raise
        self._run(self._session.frame(silent_fields(fields)))

    def _open_to(self, levels: Numbers | float) -> None:
        opening = Opening(levels, self.electrodes, clock.now_ns())
        while not opening.is_done(self._run(self._session.frame(opening.frame())), clock.now_ns()):
            clock.sleep_s(opening.renewal_s)
        self._run(self._session.frame(opening.silence()))

    def _stream(self, fields: dict[str, object]) -> None:
        self._run(self._session.opened())
        data = self._session.streamed(fields)
        frames = self._frames_socket()
        if not frames.poll(int(self._timeout_s * 1000), zmq.POLLOUT):
            raise DaemonGone(self.address, f"no frame was taken within {self._timeout_s:g} s")
        frames.send(data)

    def _greet(self) -> None:
        """Learn the facts; without an engine there are none, and `status` and `stop` still work."""
        try:
            self._run(self._session.greet())
        except Refused as refusal:
            if refusal.code != "engine_gone":
                raise

    def _run(self, flow: Flow[R]) -> R:
        """Drive one of the session's generators to its end."""
        try:
            ask = next(flow)
            while True:
                try:
                    reply = self._exchange(ask)
                except Refused as refusal:
                    ask = flow.throw(refusal)
                else:
                    ask = flow.send(reply)
        except StopIteration as end:
            result: R = end.value
            return result

    def _exchange(self, ask: Ask) -> Success:
        """Send one request and wait for its reply, keeping the lease if it is a slow one."""
        socket = self._connected()
        deadline_ns = clock.now_ns() + int(ask.timeout_s * 1e9)
        if socket.poll(int(ask.timeout_s * 1000), zmq.POLLOUT):
            socket.send(ask.data)
            while (left_s := (deadline_ns - clock.now_ns()) / 1e9) > 0:
                wait_s = left_s if ask.keep is None else min(left_s, KEEP_S)
                if socket.poll(max(1, int(wait_s * 1000))):
                    reply = self._session.settle(ask, socket.recv_multipart()[-1])
                    if reply is not None:
                        return reply
                elif ask.keep is not None:
                    socket.send(ask.keep())
        self._drop_control()
        raise DaemonGone(self.address, f"no answer to {ask.op} within {ask.timeout_s:g} s")
