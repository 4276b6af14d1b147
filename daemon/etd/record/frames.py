"""The frames that were asked for in a lease, until they are shown: contents, rate and life.

Owns: which frame has a number, which of two goes on with what the other showed, and how far apart
its pulses are. Must not know: pulses, what is made of a stimulus.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from etd.protocol.frame import DEFAULT_TTL_MS
from etd.record.lines import Asked, Engine, LeaseBegun, LeaseEnded, Line, Refusal, Replied

#: Two pulses of a stimulus are at least so far apart before it counts as two.
LEAST_GAP_NS = 250_000_000
#: Of the period; scans that are late are no gap.
_PERIODS = 1.5
#: What makes no difference to what a frame shows.
_ENVELOPE = ("seq", "sent_ns", "ttl_ms", "account", "preview")
#: These end, or begin, by something else than their life.
_NOT_BY_LIFE = ("pulses", "on_trigger")
#: Of a streamed frame, to which there is no reply.
STREAMED = 0


@dataclass(slots=True)
class AskedFrame:
    """`fields`: what it shows. Its life, by the gateway's clock, is from `asked_ns` to `until_ns`.
    `rate_hz` None: not known.
    """

    seq: int
    number: int
    client: str
    fields: dict[str, Any]
    asked_ns: int
    until_ns: int
    rate_hz: float | None

    @property
    def is_silent(self) -> bool:
        return not any(_strengths(self.fields))

    @property
    def gap_ns(self) -> float:
        """Pulses that are further apart belong to two stimuli."""
        if self.rate_hz is None or "pulses" in self.fields:
            return LEAST_GAP_NS
        return max(LEAST_GAP_NS, _PERIODS * 1e9 / self.rate_hz)

    def goes_on_with(self, before: AskedFrame) -> bool:
        """It came while the one before lived, and shows the same."""
        is_by_life = not any(key in self.fields for key in _NOT_BY_LIFE)
        return is_by_life and self.fields == before.fields and self.asked_ns <= before.until_ns


class AskedFrames:
    """Tell it each line; `take` each frame that is shown."""

    def __init__(self) -> None:
        #: By seq, those that were refused taken out. Two of one seq: the newer one, unless refused.
        self._frames: dict[int, list[AskedFrame]] = {}
        #: Those to which there was no reply yet, by number.
        self._unanswered: dict[int, AskedFrame] = {}
        self._site_hz: float | None = None
        self._calibrated_hz: float | None = None

    def heed(self, line: Line) -> None:
        if isinstance(line, Asked):
            if line.request.get("op") == "frame" and not line.request.get("preview"):
                frame = self._frame(line)
                self._frames.setdefault(frame.seq, []).append(frame)
                if frame.number != STREAMED:
                    self._unanswered[frame.number] = frame
        elif isinstance(line, Replied):
            self._heed_reply(line)
        elif isinstance(line, Refusal) and line.report.seq is not None:
            self._forget(line.report.seq, STREAMED)
        elif isinstance(line, Engine):
            self._site_hz = line.facts.default_rate_hz
        elif isinstance(line, LeaseBegun | LeaseEnded):
            # Frames are numbered anew in each lease.
            self._frames.clear()
            calibration = line.calibration if isinstance(line, LeaseBegun) else None
            self._calibrated_hz = None if calibration is None else calibration.rate_hz

    def take(self, seq: int) -> AskedFrame | None:
        """None: it was asked for before the record began. Forgets this one and those before it."""
        newest = self._frames[seq][-1] if seq in self._frames else None
        for older in [known for known in self._frames if known <= seq]:
            del self._frames[older]
        return newest

    def between(self, after: int, until: int) -> Iterator[AskedFrame]:
        """Those numbered beyond the one and up to the other, in order."""
        for seq in sorted(seq for seq in self._frames if after < seq <= until):
            yield self._frames[seq][-1]

    def _frame(self, line: Asked) -> AskedFrame:
        request = line.request
        fields = {
            key: value
            for key, value in request.items()
            if key not in ("op", *_ENVELOPE) and value is not None
        }
        begun_ns = min(line.t_ns, request.get("sent_ns") or line.t_ns)
        lives_ns = (request.get("ttl_ms") or DEFAULT_TTL_MS) * 1_000_000
        return AskedFrame(
            request["seq"],
            line.number,
            line.client,
            fields,
            line.t_ns,
            begun_ns + lives_ns,
            self._rate_hz(fields),
        )

    def _rate_hz(self, fields: dict[str, Any]) -> float | None:
        """Of its fastest electrode."""
        asked_hz = fields.get("rate_hz")
        if asked_hz is None:
            return self._calibrated_hz or self._site_hz
        if not isinstance(asked_hz, list):
            return float(asked_hz)
        strengths = _strengths(fields)
        felt = [hz for hz, strength in zip(asked_hz, strengths, strict=False) if strength]
        return max(felt or asked_hz, default=None)

    def _heed_reply(self, line: Replied) -> None:
        frame = self._unanswered.pop(line.number, None)
        if frame is None:
            return
        rate_hz = line.reply.get("rate_hz")
        if not line.ok:
            self._forget(frame.seq, frame.number)
        elif isinstance(rate_hz, float) and rate_hz > 0:
            frame.rate_hz = rate_hz

    def _forget(self, seq: int, number: int) -> None:
        frames = self._frames.get(seq, [])
        for frame in reversed(frames):
            if frame.number == number:
                frames.remove(frame)
                break
        if not frames:
            self._frames.pop(seq, None)


def _strengths(fields: dict[str, Any]) -> list[float]:
    return fields.get("level") or fields.get("current_ua") or []
