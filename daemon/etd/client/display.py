"""The display, as an application uses it.

Owns: sending each request of `Session` to the daemon and blocking until the answer comes.
Must not know: the order of requests (session), the options of a frame (options).

    with Display() as display:
        display.arm()
        display.hold(levels, seconds=2)
"""

from __future__ import annotations

import contextlib
import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

import zmq

from etd.client import clock, course
from etd.client.beside import Keeper, Underway
from etd.client.connection import KEPT_S, Connection
from etd.client.course import Course
from etd.client.exchange import Exchange
from etd.client.options import FrameOptions, Kind
from etd.client.owner import Owner
from etd.client.patterns import PatternOptions, playing_pattern, steps_to_play
from etd.client.playing import Played
from etd.client.presented import Presented
from etd.client.presenting import MOST_BEGUN_S, WAIT_S, presenting
from etd.client.session import Flow, R
from etd.client.telemetry import Telemetry
from etd.client.values import Numbers, up_to_s
from etd.client.way import silent
from etd.protocol.calibration import Calibration
from etd.protocol.errors import DaemonGone, EtdError, Refused
from etd.protocol.facts import RecordFacts
from etd.protocol.messages import (
    FeltReply,
    FrameReply,
    HelloReply,
    MarkReply,
    MeasureReply,
    StateReport,
    Topic,
)
from etd.protocol.opening import LeaseCalibration
from etd.stabilize.offset_estimate import Answer as FeltAnswer

if TYPE_CHECKING:
    from typing_extensions import Self, Unpack

    from etd.files.pattern import Pattern


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
    ) -> tuple[LeaseCalibration, ...]:
        """Open the lease if none stands, check the board and enable the supply; blocks for it.
        Returns the calibrations that are in force, as the engine has read them.

        `open_to`: then fire these levels (one number: on all electrodes that are felt; a
        `UserWarning` names the others) until the soft start lets them through, and be silent;
        `open_to_ua` the same for currents (one number: on all electrodes). It is felt: it takes a
        second for each 4 mA. Once a session is enough, see docs/protocol.md. Raises: Refused
        (`wrong_state`) if they do not get through, `over_limit` for more than a cap.
        """
        openings = self._openings(open_to, open_to_ua)
        taken = self._run(self._session.arm(timeout_s))
        self._leave_out_unfelt(openings, taken)
        for made in openings:
            self._play(course.opening(self._session, made, clock.now_ns))
        return taken

    def arm_holder(self, timeout_s: float = 10.0) -> tuple[LeaseCalibration, ...]:
        """The operator's `arm`: arms the lease of its present holder; returns its calibrations."""
        return self._run(self._session.arm_holder(timeout_s))

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
        self,
        levels: Numbers,
        seconds: float,
        *,
        wait_s: float = WAIT_S,
        **options: Unpack[FrameOptions],
    ) -> Presented:
        """Show levels for `seconds`, then silence; returns what was fired. Blocks.

        First it waits, for a tenth of a second where need be, until it is known what the returns
        carry. With `on_trigger=True` it then waits for an edge on TRIGGER, for `wait_s` (30 s at
        most), and begins with it: `trigger_ns` and `latency_ns` say when. Ctrl-C ends it silent;
        after a program was killed it goes on for what was asked, for a second at most. Raises:
        CutShort (`halted`, `no_lease`, `over_maximum` for its net charge) with what was fired until
        then, if it is cut short; Refused (`expired`), if no edge came.
        """
        fields = self._fields("level", levels, options)
        return self._play(presenting(self._session, fields, seconds, clock.now_ns, None, wait_s))

    def present_current(
        self,
        current_ua: Numbers,
        seconds: float,
        *,
        wait_s: float = WAIT_S,
        **options: Unpack[FrameOptions],
    ) -> Presented:
        """The same for currents in uA."""
        fields = self._fields("current_ua", current_ua, options)
        return self._play(presenting(self._session, fields, seconds, clock.now_ns, None, wait_s))

    def begin(
        self,
        levels: Numbers,
        seconds: float,
        *,
        wait_s: float = WAIT_S,
        **options: Unpack[FrameOptions],
    ) -> Underway[Presented]:
        """Present while the program goes on, for 30 s at most; `wait()` says what was fired.
        Another frame of this display ends it, and so does `disarm`.
        """
        return self._begun("level", levels, seconds, wait_s, options)

    def begin_current(
        self,
        current_ua: Numbers,
        seconds: float,
        *,
        wait_s: float = WAIT_S,
        **options: Unpack[FrameOptions],
    ) -> Underway[Presented]:
        """The same for currents in uA."""
        return self._begun("current_ua", current_ua, seconds, wait_s, options)

    def kept(self, at_most_s: float = KEPT_S) -> Keeper:
        """`with display.kept(): ...` holds the lease over pauses; frames expire as always.

        A program that hangs must not hold it for ever: the lease is kept until no method of this
        display was called for `at_most_s`.
        """
        longest_s = up_to_s("at_most_s", at_most_s, 24 * 3_600.0)
        return Keeper(self._new_exchange, self._session, lambda: self._exchange.used_ns, longest_s)

    def play(
        self, pattern: Pattern | str | os.PathLike[str], **options: Unpack[PatternOptions]
    ) -> Played:
        """Play a pattern (an `etd.Pattern`, or the path of a pattern file of ours or of
        eTactileKit) on the armed display, then silence; returns what became of it. Blocks.

        A frame that the soft start cuts is held until it does not; its time begins then. Ctrl-C
        ends it silent. Raises: PatternError, Refused, with the number of the frame.
        """
        self._owner.check()
        playing = self._playing(options)
        with self.telemetry("scan", "halt") as reports:

            def listen(seconds: float) -> None:
                item = reports.receive(seconds)
                if item is not None:
                    playing.hear(item[1])

            exchange = self._new_exchange(listen)
            try:
                return exchange.play(playing_pattern(self._session, playing, pattern, options))
            finally:
                self._exchange.used_ns = exchange.used_ns
                exchange.hang_up()

    def check_pattern(
        self, pattern: Pattern | str | os.PathLike[str], **options: Unpack[PatternOptions]
    ) -> tuple[str, ...]:
        """What `play` would do otherwise than the pattern says, in sentences; nothing is shown.
        Raises: PatternError, Refused, if it cannot be played.
        """
        told: list[str] = []
        self._play(steps_to_play(self._session, pattern, options, told.append))
        return tuple(told)

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
        """Contact of all electrodes, with probe pulses; from SAFE back to SAFE. Where limits leave
        no room for a probe, as soon after strong pulses, contact is None (unknown): `withheld` has
        the electrode, the limit, and in how many ms there is room (None: not until it changes).

        It puts the supply on, so it needs the right to operate, as `arm` does (Refused,
        `not_permitted`).
        """
        return self._run(self._session.measure(timeout_s))

    def mark(self, tag: int | str | None = None) -> MarkReply:
        """Mark this time in telemetry, with an edge on SYNC if the board has that line. `tag`: a
        whole number, or at most 64 characters of text.
        """
        return self._run(self._session.mark(tag))

    def felt(self, answer: FeltAnswer, electrodes: Iterable[int] | None = None) -> FeltReply:
        """What the person says of the strength: "too_weak", "good" or "too_strong", of these
        electrodes or of all (None). Too strong lowers at once by 5 %, of all with the lease by 2 %;
        again of the same within half a minute by a fifth, then half, within three minutes by twice
        as much as before. Where a soft start or cap had left less than was asked for, it takes of
        what was fired in the last seconds, and nothing passes that: no soft start either. Good and
        too weak give back, at most 5 % a minute, not within one of too strong. Too weak raises
        levels above the frame's own, by no more and 20 % in all, where the body site allows it
        (`facts.felt_may_raise`; no shipped one does) and the calibration tells that they feel less
        in use. If it tells how fast, good makes up for a minute of use, not after too strong. All
        is gone when the board is disarmed. Without the lease a program can only lower.
        `did` of the reply: "lowered", "gives_back", "raises", "nothing"; `reason`: why no more.
        Raises: Refused (`not_armed`, `other_lease`, `no_lease`; `wrong_state`: not fired in the
        last minute; `bad_message`).
        """
        return self._run(self._session.felt(answer, electrodes))

    def note(self, text: str) -> None:
        """A remark in the record that is being written, if it is this user's. Raises: Refused
        (`no_record`, `not_permitted`; `busy`, after a thousand kilobytes of them).
        """
        self._run(self._session.note(text))

    def start_record(self, name: str) -> None:
        """Begin a record that other programs end; `record` ends its own. Raises: Refused
        (`wrong_state`, `record_failed`).
        """
        self._run(self._session.start_record(name))

    def stop_record(self) -> None:
        """End the record that is being written. Raises: Refused (`no_record`, `record_failed`)."""
        self._run(self._session.stop_record())

    def records(self) -> tuple[RecordFacts, ...]:
        """Those on the daemon's disk, with their sizes."""
        return self._run(self._session.records())

    def fetch_record(self, name: str, write: Callable[[bytes], object]) -> int:
        """Write a record piece by piece, as it is on the daemon's disk; returns its length in
        bytes. Raises: Refused (`not_found`, `not_permitted`: it is another user's).
        """
        return self._run(self._session.fetch_record(name, write))

    def delete_record(self, name: str) -> None:
        """One of this user's. Raises: Refused (`not_found`, `not_permitted`, `wrong_state`)."""
        self._run(self._session.delete_record(name))

    @contextmanager
    def record(self, name: str) -> Iterator[None]:
        """`with display.record("p01-block2"): ...` has the daemon write a record of all that is
        asked and fired, on its own disk; `etd record` shows and fetches it. It goes on while the
        block does, whichever client asks, and ends with it, not with this program's death.

        Raises: Refused (`wrong_state` while another is written, `record_failed`: also at the end,
        if it could not be written whole).
        """
        self._run(self._session.start_record(name))
        try:
            yield
        except BaseException:
            with contextlib.suppress(EtdError):  # what ended the block matters more
                self._run(self._session.end_record(name))
            raise
        self._run(self._session.end_record(name))

    def stop(self, why: str = "") -> None:
        """Silence at once, whichever client holds the lease; HALTED until `clear`, which is told
        with `why`. Any thread may call it, and any process that forked from the one that made it.
        """
        # A copy of a context works for no child.
        context = self._new_context() if self._owner.has_forked else self._context
        exchange = Exchange(context, self._way, self._session, clock.sleep_s)
        try:
            exchange.run(self._session.stop(why))
        finally:
            exchange.hang_up()
            if context is not self._context:
                context.destroy(linger=0)

    def clear(self) -> None:
        """Leave HALTED for SAFE; then `arm()` anew."""
        self._run(self._session.clear())

    def calibrations(self) -> tuple[str, ...]:
        """The names that the daemon knows."""
        return self._run(self._session.calibrations())

    def calibration(self, name: str) -> Calibration:
        """Raises: Refused (`not_found`)."""
        return self._run(self._session.get_calibration(name))

    def check_may_store(self) -> None:
        """Before a person answers for an hour: whether this process's user may store calibrations.
        Raises: Refused (`not_permitted`).
        """
        self._owner.check()
        self._way.check_may_store(self.facts)

    def set_calibration(self, name: str, calibration: Calibration) -> None:
        """Store a calibration under a name: this process writes the file (over ssh, one there), so
        its user must be an operator of that computer (docs/install.md). Raises: Refused
        (`bad_calibration`, `not_permitted`).
        """
        self._owner.check()
        self._way.put_calibration(self.facts, name, calibration)

    def delete_calibration(self, name: str) -> None:
        """As `set_calibration`. Raises: Refused (`not_found`, `not_permitted`)."""
        self._owner.check()
        self._way.delete_calibration(self.facts, name)

    def telemetry(self, *topics: Topic, timeout_s: float | None = None) -> Telemetry:
        """`with display.telemetry("scan") as reports: for topic, report in reports: ...`"""
        self._check_open()
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
            pass  # there is no daemon to tell; the lease has ended with the daemon, or lapses
        finally:
            self._exchange.hang_up()
            self._hang_up()

    def _begun(
        self, kind: Kind, numbers: Numbers, seconds: float, wait_s: float, options: FrameOptions
    ) -> Underway[Presented]:
        up_to_s("seconds", seconds, MOST_BEGUN_S)
        up_to_s("wait_s", wait_s, MOST_BEGUN_S)
        fields = self._fields(kind, numbers, options)
        self._run(self._session.opened())
        # Whatever the program sends from now on is newer.
        after = self._session.numbers.newest
        course = presenting(self._session, fields, seconds, clock.now_ns, after, wait_s)
        return Underway(self._new_exchange, course)

    def _stream(self, fields: dict[str, object]) -> None:
        self._run(self._session.opened())
        data = self._session.streamed(fields)
        frames = self._frames_socket()
        if not frames.poll(int(self._timeout_s * 1000), zmq.POLLOUT):
            raise silent(self._way, f"no frame was taken within {self._timeout_s:g} s")
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
