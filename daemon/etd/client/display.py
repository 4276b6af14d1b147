"""The display, as an application uses it.

Owns: sending each request of `Session` to the daemon and blocking until the answer comes.
Must not know: the order of requests (session), the options of a frame (options).

    with Display() as display:
        display.arm()
        display.hold(levels, seconds=2)
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Self, Unpack

import zmq

from etd.client import clock, course
from etd.client.beside import Keeper, Underway
from etd.client.connection import KEPT_S, Connection
from etd.client.course import Course
from etd.client.exchange import Exchange
from etd.client.options import FrameOptions, Kind
from etd.client.owner import Owner
from etd.client.presented import Presented
from etd.client.presenting import MOST_BEGUN_S, presenting
from etd.client.session import Flow, R
from etd.client.telemetry import Telemetry
from etd.client.values import Numbers, up_to_s
from etd.protocol.calibration import Calibration
from etd.protocol.errors import DaemonGone, Refused
from etd.protocol.messages import (
    FrameReply,
    HelloReply,
    MarkReply,
    MeasureReply,
    StateReport,
    Topic,
)


class Display(Connection["zmq.Socket[bytes]"]):
    """Blocking; for the thread that made it. `Connection` describes the arguments."""

    def _new_context(self) -> zmq.Context[zmq.Socket[bytes]]:
        return zmq.Context()

    def _begin(self) -> None:
        self._owner = Owner()
        self._exchange = self._new_exchange(clock.sleep_s)
        try:
            self._way.check_there()
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

    def arm(
        self,
        timeout_s: float = 10.0,
        *,
        open_to: Numbers | float | None = None,
        open_to_ua: Numbers | float | None = None,
    ) -> None:
        """Open the lease if none stands, check the board and enable the supply; blocks for it.

        `open_to`: then fire these levels (one number: on all electrodes) until the soft start lets
        them through, and be silent; `open_to_ua` the same for currents. It is felt: it takes a
        second for each 4 mA. Once a session is enough, see docs/protocol.md. Raises: Refused
        (`wrong_state`) if they do not get through.
        """
        self._run(self._session.arm(timeout_s))
        for made in self._openings(open_to, open_to_ua):
            self._play(course.opening(self._session, made, clock.now_ns))

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
        return self._run(self._session.frame(self._fields("level", levels, options)))

    def show_current(self, current_ua: Numbers, **options: Unpack[FrameOptions]) -> FrameReply:
        """One frame of currents, in uA for each electrode: an upper bound, whatever stabilizers the
        body site has. Widths that `strength_duration` would change are refused.
        """
        return self._run(self._session.frame(self._fields("current_ua", current_ua, options)))

    def preview(self, levels: Numbers, **options: Unpack[FrameOptions]) -> FrameReply:
        """The reply that `show` would get now, clamps and rate; nothing is shown."""
        return self._run(self._session.preview(self._fields("level", levels, options)))

    def present(
        self, levels: Numbers, seconds: float, **options: Unpack[FrameOptions]
    ) -> Presented:
        """Show levels for `seconds`, then silence; returns what was fired. Blocks.

        First it waits, for a tenth of a second where need be, until it is known what the returns
        carry. Ctrl-C ends it silent. Raises: Refused (`halted`, `no_lease`) if it is cut short.
        """
        fields = self._fields("level", levels, options)
        return self._play(presenting(self._session, fields, seconds, clock.now_ns))

    def present_current(
        self, current_ua: Numbers, seconds: float, **options: Unpack[FrameOptions]
    ) -> Presented:
        """The same for currents in uA."""
        fields = self._fields("current_ua", current_ua, options)
        return self._play(presenting(self._session, fields, seconds, clock.now_ns))

    def begin(
        self, levels: Numbers, seconds: float, **options: Unpack[FrameOptions]
    ) -> Underway[Presented]:
        """Present while the program goes on, for 30 s at most; `wait()` says what was fired.
        Another frame of this display ends it.
        """
        return self._begun("level", levels, seconds, options)

    def begin_current(
        self, current_ua: Numbers, seconds: float, **options: Unpack[FrameOptions]
    ) -> Underway[Presented]:
        """The same for currents in uA."""
        return self._begun("current_ua", current_ua, seconds, options)

    def kept(self, at_most_s: float = KEPT_S) -> Keeper:
        """`with display.kept(): ...` holds the lease over pauses; frames expire as always.

        A program that hangs must not hold it for ever: the lease is kept until no method of this
        display was called for `at_most_s`.
        """
        longest_s = up_to_s("at_most_s", at_most_s, 24 * 3_600.0)
        return Keeper(self._new_exchange, self._session, lambda: self._exchange.used_ns, longest_s)

    def hold(self, levels: Numbers, seconds: float, **options: Unpack[FrameOptions]) -> None:
        """Show levels for `seconds`, then silence. Blocks; renews the frame within its ttl.

        Ctrl-C ends it silent.
        """
        fields = self._fields("level", levels, options)
        self._play(course.holding(self._session, fields, seconds, clock.now_ns))

    def hold_current(
        self, current_ua: Numbers, seconds: float, **options: Unpack[FrameOptions]
    ) -> None:
        """Show currents for `seconds`, then silence; as `hold`."""
        fields = self._fields("current_ua", current_ua, options)
        self._play(course.holding(self._session, fields, seconds, clock.now_ns))

    def stream(self, levels: Numbers, **options: Unpack[FrameOptions]) -> None:
        """One frame without an answer; the newest wins. A refusal comes as telemetry `refused`."""
        self._stream(self._fields("level", levels, options))

    def stream_current(self, current_ua: Numbers, **options: Unpack[FrameOptions]) -> None:
        """The same for currents in uA."""
        self._stream(self._fields("current_ua", current_ua, options))

    def measure(self, timeout_s: float = 10.0) -> MeasureReply:
        """Contact of all electrodes, with probe pulses; from SAFE back to SAFE."""
        return self._run(self._session.measure(timeout_s))

    def mark(self, tag: int | None = None) -> MarkReply:
        """Mark this time in telemetry, with an edge on SYNC if the board has that line."""
        return self._run(self._session.mark(tag))

    def stop(self) -> None:
        """Silence at once, whichever client holds the lease; HALTED until `clear`. The one method
        that any thread may call.
        """
        exchange = self._new_exchange(clock.sleep_s)
        try:
            exchange.run(self._session.stop())
        finally:
            exchange.hang_up()

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
        address, join_s = self._way.telemetry, self._timeout_s
        return Telemetry(self._context, address, topics, timeout_s, join_s=join_s)

    def close(self) -> None:
        """Give the lease back (which disarms) and hang up. Idempotent."""
        if self._context.closed:
            return
        self._owner.check()
        try:
            self._run(self._session.close())
        except DaemonGone:
            pass  # nobody is there to be told; the lease has ended with the daemon, or lapses
        finally:
            self._exchange.hang_up()
            self._hang_up()

    def _begun(
        self, kind: Kind, numbers: Numbers, seconds: float, options: FrameOptions
    ) -> Underway[Presented]:
        up_to_s("seconds", seconds, MOST_BEGUN_S)
        fields = self._fields(kind, numbers, options)
        self._run(self._session.opened())
        # Whatever the program sends from now on is newer.
        after = self._session.last_seq
        course = presenting(self._session, fields, seconds, clock.now_ns, after)
        return Underway(self._new_exchange, course)

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
        self._owner.check()
        return self._exchange.run(flow)

    def _play(self, course: Course[R]) -> R:
        self._owner.check()
        return self._exchange.play(course)

    def _new_exchange(self, pause: Callable[[float], None]) -> Exchange:
        return Exchange(self._context, self._way, self._session, pause)
