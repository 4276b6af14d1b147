"""Playing a pattern: each frame for its time, by telemetry.

Owns: holding a frame while the soft start clamps it, when the next frame is due, renewals in
between, and what is said of it all in the end. Must not know: sockets, the terminal, whether the
caller blocks or awaits.

It is a course. In its pauses reports of `scan` and `halt` are given to `hear`, and end the pause.
The engine's clock is not the client's (a fake's lags behind): durations are on the engine's.
"""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from etd.client.course import Course, Now, Pause, falling_silent
from etd.client.options import FrameOptions, frame_fields
from etd.client.session import Session
from etd.client.standing import Standing
from etd.client.steps import Report, Step, silent
from etd.protocol.errors import DaemonGone, Refused
from etd.protocol.messages import FrameReply, Halt, Scan
from etd.protocol.outcome import Clamp, Shortfall

_MS = 1_000_000
#: A frame's ttl exceeds its duration by this, so that it lasts until the next one.
SLACK_MS = 250
MAX_TTL_MS = 1_000
#: A frame that lasts longer is renewed when it has less than this left.
_RENEW_NS = 400 * _MS
_KEEP_NS = 300 * _MS
#: An accepted frame starts at once, and telemetry comes 30 times a second.
_BEGUN_WITHIN_NS = 3_000 * _MS
_BALANCED = (
    "pulses had both phases, since those of one would leave too much direct current (balance ="
    ' "biphasic" in the body site): name a polarity to have that one'
)


@dataclass(frozen=True)
class Played:
    """What became of a pattern: how many frames were shown, for how long (`played_s`), and for how
    long the soft start held frames before their time began (`soft_start_s`).

    `clamped` is the last clamp of each electrode and reason, without those of the soft start while
    it holds a frame; in `clamped_frames` of the pattern's frames. `not_fired` counts by reason.
    `slowed_to_hz`: the lowest rate that a frame was slowed to; None: none was. `told`: a sentence
    for each thing that was mended in the file, or is played otherwise than it says.
    """

    frames: int
    played_s: float
    soft_start_s: float
    clamped: tuple[Clamp, ...]
    clamped_frames: int
    not_fired: dict[str, int]
    slowed_to_hz: float | None
    told: tuple[str, ...]


@dataclass(slots=True)
class _Tally:
    """What adds up to a `Played`."""

    frames: int = 0
    clamped: dict[tuple[int, str], Clamp] = field(default_factory=dict)
    clamped_frames: set[int] = field(default_factory=set)
    not_fired: Counter[str] = field(default_factory=Counter)
    slowed_to_hz: float | None = None
    soft_start_s: float = 0.0


class _Over(Exception):
    """The seconds that it was to be played for are over."""


class Playing:
    """Plays steps over a session. `on_frame` is called with the number of frames shown.

    `playing` raises: Refused (naming the frame; `halted`), DaemonGone.
    """

    def __init__(
        self,
        session: Session,
        address: str,
        now_ns: Now,
        tell: Report,
        on_frame: Callable[[int], None],
    ) -> None:
        """`address`: as errors name the daemon."""
        self._session = session
        self._address = address
        self._now_ns = now_ns
        self._tell = tell
        self._on_frame = on_frame
        self._heard: deque[object] = deque()
        #: How far the engine's time is behind, or a little more.
        self._lag_ns = 0
        self._kept_ns = 0
        #: When it is to end, without what the soft start holds; None: with the last frame.
        self._end_ns: int | None = None
        self._tally = _Tally()
        self._told: list[str] = []
        self._is_balanced = False

    def hear(self, report: object) -> None:
        """Of the topics `scan` and `halt`."""
        self._heard.append(report)

    def tell(self, sentence: str) -> None:
        """A deviation from the file."""
        self._told.append(sentence)
        self._tell(sentence)

    def playing(
        self, steps: Sequence[Step], repeat: int | None = 1, seconds: float | None = None
    ) -> Course[Played]:
        """Until the last frame has ended; then nothing is stimulated. `repeat` None: until the
        seconds are over.
        """
        begun_ns = self._now_ns()
        if seconds is not None:
            self._end_ns = begun_ns + int(seconds * 1e9)
        rounds = 0
        try:
            while repeat is None or rounds < repeat:
                rounds += 1
                for step in steps:
                    yield from self._finish((yield from self._stand(step)))
        except _Over:
            pass
        except Refused:
            yield from self._raise_halted()
            yield from self._fall_silent(steps[-1])
            raise
        except BaseException:
            yield from self._fall_silent(steps[-1])
            raise
        lasted_s = (self._now_ns() - begun_ns) / 1e9
        yield from self._send(silent(steps[-1], 0), SLACK_MS)
        tally = self._tally
        return Played(
            frames=tally.frames,
            played_s=lasted_s - tally.soft_start_s,
            soft_start_s=tally.soft_start_s,
            clamped=tuple(tally.clamped.values()),
            clamped_frames=len(tally.clamped_frames),
            not_fired=dict(tally.not_fired),
            slowed_to_hz=tally.slowed_to_hz,
            told=tuple(self._told),
        )

    # --- standing ----------------------------------------------------------------------------

    def _finish(self, standing: Standing) -> Course[None]:
        """Return when it has been shown for its time. Raises: _Over."""
        while (due_ns := standing.due_ns) is None or self._engine_ns() < due_ns:
            self._check_over(standing)
            if due_ns is None and self._now_ns() - standing.sent_ns > _BEGUN_WITHIN_NS:
                yield from self._raise_not_shown(standing.step)
            yield from self._wait(standing)
        held_s = standing.held_ms / 1e3
        self._tally.soft_start_s += held_s
        if standing.step.ends_frame:
            self._tally.frames += 1
            self._on_frame(self._tally.frames)

    def _check_over(self, standing: Standing) -> None:
        """What the soft start holds does not count: a frame's time begins after it."""
        if self._end_ns is None or standing.due_ns is None:
            return
        held_ns = int((self._tally.soft_start_s + standing.held_ms / 1e3) * 1e9)
        if self._now_ns() >= self._end_ns + held_ns:
            self._tally.soft_start_s += standing.held_ms / 1e3
            raise _Over

    def _wait(self, standing: Standing) -> Course[None]:
        """Until telemetry comes or something is due; then do what is due."""
        if not self._heard:
            left_ns = self._wake_ns(standing) - self._now_ns()
            yield Pause(max(0.001, left_ns / 1e9))
        if self._heard:
            self._take(self._heard.popleft(), standing)
        now_ns = self._now_ns()
        if self._stands_on(standing) and now_ns >= standing.expires_ns - _RENEW_NS:
            yield from self._renew(standing)
        elif now_ns >= self._kept_ns + _KEEP_NS:
            yield self._session.keep()
            self._kept_ns = now_ns

    def _wake_ns(self, standing: Standing) -> int:
        moments_ns = [self._kept_ns + _KEEP_NS]
        if standing.due_ns is not None:
            moments_ns.append(standing.due_ns + self._lag_ns)
            if self._end_ns is not None:
                moments_ns.append(self._end_ns)
        if self._stands_on(standing):
            moments_ns.append(standing.expires_ns - _RENEW_NS)
        return min(moments_ns)

    def _stands_on(self, standing: Standing) -> bool:
        """Its duration exceeds its ttl."""
        if standing.due_ns is None:
            return standing.is_held
        return standing.due_ns + self._lag_ns > standing.expires_ns

    def _engine_ns(self) -> int:
        return self._now_ns() - self._lag_ns

    # --- telemetry ---------------------------------------------------------------------------

    def _take(self, report: object, standing: Standing) -> None:
        if isinstance(report, Halt):
            raise _halted(report)
        if isinstance(report, Scan):
            # Below 0 where the engine's computer is another one, whose clock is ahead.
            self._lag_ns = self._now_ns() - report.now_ns
            standing.hear(report, self._now_ns())
            self._count(report, standing)

    def _count(self, scan: Scan, standing: Standing) -> None:
        for clamp in scan.clamped:
            if clamp.reason != "soft_start" or not standing.is_held:
                self._tally.clamped[clamp.electrode, clamp.reason] = clamp
                self._tally.clamped_frames.add(-1 if scan.tag is None else scan.tag)
        for shortfalls in scan.not_fired:
            self._note_rate(shortfalls)
            if shortfalls.pulses:
                self._tally.not_fired[shortfalls.reason] += shortfalls.pulses

    def _raise_halted(self) -> Course[None]:
        """A frame may be refused before the halt that ended the lease is reported."""
        report = yield self._session.status()
        if report.halt is not None:
            raise _halted(report.halt)

    def _raise_not_shown(self, step: Step) -> Course[None]:
        report = yield self._session.status()
        if report.state != "ARMED":
            raise Refused("not_armed", f"the state is {report.state} ({report.last_disarm})")
        raise DaemonGone(
            self._address, f"frame {step.options.get('tag')} was accepted but not shown"
        )

    # --- sending -----------------------------------------------------------------------------

    def _stand(self, step: Step, is_held: bool = False, is_again: bool = False) -> Course[Standing]:
        ttl_ms = MAX_TTL_MS if is_held else min(MAX_TTL_MS, step.duration_ms + SLACK_MS)
        sent_ns = self._now_ns()
        reply = yield from self._send(step, ttl_ms, is_again)
        return Standing(step, {reply.seq}, sent_ns, sent_ns + ttl_ms * _MS)

    def _renew(self, standing: Standing) -> Course[None]:
        """Send the same frame again; its duration continues."""
        again = yield from self._stand(standing.step, standing.is_held, is_again=True)
        standing.seqs |= again.seqs
        standing.sent_ns, standing.expires_ns = again.sent_ns, again.expires_ns

    def _send(self, step: Step, ttl_ms: int, is_again: bool = False) -> Course[FrameReply]:
        try:
            reply: FrameReply = yield self._session.frame(self._fields(step, ttl_ms))
        except Refused as refusal:
            raise _named(refusal, step) from None
        self._kept_ns = self._now_ns()
        for shortfalls in reply.slowed:
            self._note_rate(shortfalls)
            if shortfalls.reason == "balanced" and not self._is_balanced:
                self._is_balanced = True
                self.tell(_BALANCED)
            lasts_ms = shortfalls.lasts_ms
            if not is_again and lasts_ms is not None and lasts_ms < step.duration_ms:
                raise _named(_too_long(shortfalls, step), step)
        return reply

    def _fall_silent(self, step: Step) -> Course[None]:
        yield from falling_silent(self._session, self._fields(step, SLACK_MS), self._now_ns)

    def _fields(self, step: Step, ttl_ms: int) -> dict[str, object]:
        options: FrameOptions = {**step.options, "ttl_ms": ttl_ms}
        return {**frame_fields(step.kind, step.numbers, options), "sent_ns": self._now_ns()}

    def _note_rate(self, shortfalls: Shortfall) -> None:
        """The lowest rate that frames were slowed to, in a reply or while they were shown."""
        if shortfalls.rate_hz is not None:
            lowest_hz = self._tally.slowed_to_hz or shortfalls.rate_hz
            self._tally.slowed_to_hz = min(lowest_hz, shortfalls.rate_hz)


def _too_long(told: Shortfall, step: Step) -> Refused:
    slower = f" at rate_hz {told.lasting_hz:.1f}," if told.lasting_hz else ""
    return Refused(
        "over_maximum",
        f"electrode {told.electrode}: the frame is to stand for {step.duration_ms} ms, and its net"
        f" charge lets it last {told.lasts_ms} ms: show it for less long,{slower} or with polarity"
        ' "biphasic" (docs/protocol.md, net charge)',
        told.electrode,
    )


def _halted(halt: Halt) -> Refused:
    return Refused("halted", f"halted by {halt.cause} ({halt.source}: {halt.detail})")


def _named(refusal: Refused, step: Step) -> Refused:
    """The refusal with the frame's number."""
    reason = f"frame {step.options.get('tag')}: {refusal.reason}"
    return Refused(refusal.code, reason, refusal.electrode, refusal.achievable_hz, refusal.bound_by)
