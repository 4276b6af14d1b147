"""Publishes telemetry: messages of two parts, a topic and a JSON object.

Owns: publishing, repeating `state`, sending it to new subscribers, and the counts in it.
Must not know: requests, leases.
"""

from __future__ import annotations

from collections import Counter

import msgspec

from etd.gateway.connection import Connection
from etd.gateway.engine_link import EngineLink
from etd.gateway.recorder import Recorder
from etd.gateway.subscribers import Subscribers
from etd.protocol.errors import Refused
from etd.protocol.link import Report
from etd.protocol.messages import RefusedReport, StateReport, Topic

#: `state` is repeated this often, for subscribers that came late.
STATE_NS = 1_000_000_000
#: An engine reports its state each second. One that hangs does not, and is told as silent.
SILENT_NS = 3 * STATE_NS

_encoder = msgspec.json.Encoder()


class Publisher:
    """Never blocks."""

    def __init__(
        self,
        subscribers: Subscribers,
        engine: EngineLink,
        counters: Counter[str],
        recorder: Recorder,
    ) -> None:
        self._recorder = recorder
        self._subscribers = subscribers
        self._engine = engine
        self._counters = counters
        self._state_due_ns = 0
        #: When the engine reported its state last.
        self._heard_ns = 0
        self._refused_here = 0
        self._refused_by_engine = 0

    def state(self, now_ns: int) -> StateReport:
        """The engine's last report with this process's counts added; without one, SAFE and `gone`.
        `now_ns` is the time of the engine's report; one that is stale says `silent`.
        """
        said, recorder = self._engine.state, self._recorder
        if said is None:
            return StateReport(
                state="SAFE",
                now_ns=now_ns,
                engine="gone",
                counters=dict(self._counters),
                record=recorder.running,
                record_problem=recorder.problem,
            )
        is_silent = self._engine.is_cut_off or (
            now_ns - self._heard_ns >= SILENT_NS * said.timeout_factor
        )
        return msgspec.structs.replace(
            said,
            engine="silent" if is_silent else said.engine,
            counters=dict(Counter(said.counters) + self._counters),
            record=recorder.running,
            record_problem=recorder.problem,
        )

    def publish_state(self, now_ns: int) -> None:
        self._state_due_ns = now_ns + STATE_NS
        self._publish("state", self.state(now_ns))

    def repeat_state(self, now_ns: int) -> None:
        """To all once a second, and at once to a new subscriber."""
        newcomers = self._subscribers.take_newcomers()
        if now_ns >= self._state_due_ns:
            self.publish_state(now_ns)
        elif newcomers:
            self._publish("state", self.state(now_ns), newcomers)

    def pass_on(self, report: Report, now_ns: int) -> None:
        """Publish the engine's report unchanged, except for the counts."""
        if report.state is not None:
            self._heard_ns = now_ns
            self.publish_state(now_ns)
        if report.refused is not None:
            self._refused_by_engine = report.refused.count
            self._publish("refused", msgspec.structs.replace(report.refused, count=self._refused))
        for topic in ("scan", "contact", "halt", "mark", "modelled"):
            body = getattr(report, topic)
            if body is not None:
                self._publish(topic, body)

    def refused_stream(
        self, refusals: list[tuple[int | None, Refused]], now_ns: int
    ) -> list[RefusedReport]:
        """Streamed frames refused in one turn: one report a code, and `count` has all of them.
        Returns what was published.
        """
        self._refused_here += len(refusals)
        newest = {refusal.code: (seq, refusal) for seq, refusal in refusals}
        reports = [
            RefusedReport(now_ns=now_ns, count=self._refused, seq=seq, **refusal.fields)
            for seq, refusal in newest.values()
        ]
        for report in reports:
            self._publish("refused", report)
        return reports

    def drop_engine(self) -> None:
        """A new engine counts from 0; the old one's refusals stay in the sum."""
        self._refused_here += self._refused_by_engine
        self._refused_by_engine = 0

    @property
    def _refused(self) -> int:
        return self._refused_here + self._refused_by_engine

    def _publish(
        self, topic: Topic, body: msgspec.Struct, only: set[Connection] | None = None
    ) -> None:
        self._subscribers.publish(topic.encode(), _encoder.encode(body), only)
