"""The loop that plays a pattern: each frame for its time, by telemetry.

Owns: waiting for the operator, holding a frame while the soft start clamps it, when the next frame
is due, and renewals in between. Must not know: files, the terminal, which daemon it is.

The engine's clock may lag behind the client's (a fake's does): durations are on the engine's clock.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from etd.apps.standing import Standing
from etd.apps.steps import Report, Step, silent
from etd.client import Display, FrameOptions, Telemetry, clock
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


@dataclass(slots=True)
class Summary:
    """The result: frames shown, the last clamp of each electrode and reason (without those of the
    soft start, which holds the frame), pulses not fired by reason, and the lowest rate to which a
    frame was slowed. `soft_start_s`: how long frames were held, in all.
    """

    frames: int = 0
    clamped: dict[tuple[int, str], Clamp] = field(default_factory=dict)
    clamped_frames: set[int] = field(default_factory=set)
    not_fired: Counter[str] = field(default_factory=Counter)
    slowed_to_hz: float | None = None
    soft_start_s: float = 0.0
    played_s: float = 0.0


class Player:
    """Plays steps on a display. `on_frame` is called with the number of frames shown.

    Raises, from its methods: Refused (naming the frame; `halted`), DaemonGone.
    """

    def __init__(
        self, display: Display, steps: Sequence[Step], on_frame: Callable[[int], None]
    ) -> None:
        self._display = display
        self._steps = steps
        self._on_frame = on_frame
        #: How far the engine's time is behind, or a little more.
        self._lag_ns = 0
        self._kept_ns = 0
        self.summary = Summary()

    def wait_until_armed(self, tell: Report) -> None:
        """Keep the lease until the operator has armed it; silent frames test that."""
        probe = silent(self._steps[0], 0)
        is_reported = False
        with self._display.telemetry("state") as reports:
            while True:
                try:
                    self._show(probe, SLACK_MS)
                except Refused as refusal:
                    if refusal.code != "not_armed":
                        raise
                else:
                    return
                if not is_reported:
                    tell("waiting for the operator: `etd arm`")
                    is_reported = True
                self._display.keep()
                reports.receive(_KEEP_NS / 1e9)

    def play(self, repeat: int = 1) -> Summary:
        """Blocks until the last frame has ended; then nothing is stimulated."""
        with self._display.telemetry("scan", "halt") as reports:
            begun_ns = clock.now_ns()
            try:
                for _ in range(repeat):
                    for step in self._steps:
                        self._finish(reports, self._stand(step))
            except Refused:
                self._raise_halted()
                raise
            self.summary.played_s = (clock.now_ns() - begun_ns) / 1e9 - self.summary.soft_start_s
            self._send(silent(self._steps[-1], 0), SLACK_MS)
        return self.summary

    # --- standing ----------------------------------------------------------------------------

    def _finish(self, reports: Telemetry, standing: Standing) -> None:
        """Return when it has been shown for its time."""
        while (due_ns := standing.due_ns) is None or clock.now_ns() - self._lag_ns < due_ns:
            if due_ns is None and clock.now_ns() - standing.sent_ns > _BEGUN_WITHIN_NS:
                self._raise_not_shown(standing.step)
            self._wait(reports, standing)
        self.summary.soft_start_s += standing.held_ms / 1e3
        if standing.step.ends_frame:
            self.summary.frames += 1
            self._on_frame(self.summary.frames)

    def _wait(self, reports: Telemetry, standing: Standing) -> None:
        """Until telemetry comes or something is due; then do what is due."""
        left_ns = self._wake_ns(standing) - clock.now_ns()
        item = reports.receive(max(0.001, left_ns / 1e9))
        if item is not None:
            self._hear(item[1], standing)
        now_ns = clock.now_ns()
        if self._stands_on(standing) and now_ns >= standing.expires_ns - _RENEW_NS:
            self._renew(standing)
        elif now_ns >= self._kept_ns + _KEEP_NS:
            self._display.keep()
            self._kept_ns = now_ns

    def _wake_ns(self, standing: Standing) -> int:
        moments_ns = [self._kept_ns + _KEEP_NS]
        if standing.due_ns is not None:
            moments_ns.append(standing.due_ns + self._lag_ns)
        if self._stands_on(standing):
            moments_ns.append(standing.expires_ns - _RENEW_NS)
        return min(moments_ns)

    def _stands_on(self, standing: Standing) -> bool:
        """Its duration exceeds its ttl."""
        if standing.due_ns is None:
            return standing.is_held
        return standing.due_ns + self._lag_ns > standing.expires_ns

    # --- telemetry ---------------------------------------------------------------------------

    def _hear(self, report: object, standing: Standing) -> None:
        if isinstance(report, Halt):
            raise _halted(report)
        if isinstance(report, Scan):
            self._lag_ns = max(0, clock.now_ns() - report.now_ns)
            standing.hear(report, clock.now_ns())
            self._count(report, standing)

    def _count(self, scan: Scan, standing: Standing) -> None:
        for clamp in scan.clamped:
            if clamp.reason != "soft_start" or not standing.is_held:
                self.summary.clamped[clamp.electrode, clamp.reason] = clamp
                self.summary.clamped_frames.add(-1 if scan.tag is None else scan.tag)
        for shortfalls in scan.not_fired:
            self._note_rate(shortfalls)
            if shortfalls.pulses:
                self.summary.not_fired[shortfalls.reason] += shortfalls.pulses

    def _raise_halted(self) -> None:
        """A frame may be refused before the halt that ended the lease is reported."""
        halt = self._display.status().halt
        if halt is not None:
            raise _halted(halt)

    def _raise_not_shown(self, step: Step) -> None:
        report = self._display.status()
        if report.state != "ARMED":
            raise Refused("not_armed", f"the state is {report.state} ({report.last_disarm})")
        raise DaemonGone(
            self._display.address, f"frame {step.options.get('tag')} was accepted but not shown"
        )

    # --- sending -----------------------------------------------------------------------------

    def _stand(self, step: Step, is_held: bool = False) -> Standing:
        ttl_ms = MAX_TTL_MS if is_held else min(MAX_TTL_MS, step.duration_ms + SLACK_MS)
        sent_ns = clock.now_ns()
        reply = self._send(step, ttl_ms)
        return Standing(step, {reply.seq}, sent_ns, sent_ns + ttl_ms * _MS)

    def _renew(self, standing: Standing) -> None:
        """Send the same frame again; its duration continues."""
        again = self._stand(standing.step, is_held=standing.is_held)
        standing.seqs |= again.seqs
        standing.sent_ns, standing.expires_ns = again.sent_ns, again.expires_ns

    def _send(self, step: Step, ttl_ms: int) -> FrameReply:
        try:
            reply = self._show(step, ttl_ms)
        except Refused as refusal:
            raise _named(refusal, step) from refusal
        self._kept_ns = clock.now_ns()
        for shortfalls in reply.slowed:
            self._note_rate(shortfalls)
        return reply

    def _note_rate(self, shortfalls: Shortfall) -> None:
        """The lowest rate that frames were slowed to, in a reply or while they were shown."""
        if shortfalls.rate_hz is not None:
            lowest_hz = self.summary.slowed_to_hz or shortfalls.rate_hz
            self.summary.slowed_to_hz = min(lowest_hz, shortfalls.rate_hz)

    def _show(self, step: Step, ttl_ms: int) -> FrameReply:
        options: FrameOptions = {**step.options, "ttl_ms": ttl_ms}
        if step.kind == "level":
            return self._display.show(step.numbers, **options)
        return self._display.show_current(step.numbers, **options)


def _halted(halt: Halt) -> Refused:
    return Refused("halted", f"halted by {halt.cause} ({halt.source}: {halt.detail})")


def _named(refusal: Refused, step: Step) -> Refused:
    """The refusal with the frame's number and advice."""
    advice = ""
    if refusal.code == "too_fast":
        lower = "" if refusal.achievable_hz is None else f" {int(refusal.achievable_hz)}"
        by_rate = f"--max-rate{lower} or " if step.kind == "current_ua" else ""
        advice = f"; play it with {by_rate}--allow-slower"
    reason = f"frame {step.options.get('tag')}: {refusal.reason}{advice}"
    return Refused(refusal.code, reason, refusal.electrode, refusal.achievable_hz, refusal.bound_by)
