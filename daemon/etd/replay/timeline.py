"""What an engine was told in a record, and when by the board's clock.

Owns: the order and times of leases, arming, frames, stops. Must not know: engines, files.

Requests have the gateway's times. What they led to has the board's: a state that changed, the first
scan of a frame. So each is told again when it took effect.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Literal

from etd.protocol.calibration_set import digest_of
from etd.protocol.carried import CarriedOver
from etd.protocol.errors import FileError
from etd.protocol.felt import FeltFacts
from etd.protocol.messages import Limits, Shown, StateReport
from etd.protocol.messages import State as StateName
from etd.protocol.opening import NamedCalibration
from etd.record.lines import (
    Asked,
    Carried,
    Engine,
    EngineGone,
    LeaseBegun,
    LeaseEnded,
    Line,
    Scans,
    State,
)

Act = Literal[
    "open", "arm", "measure", "frame", "disarm", "close", "stop", "clear", "resume", "felt"
]

#: So long before a record its lease is opened and its board armed, one after the other.
_READY_NS, _APART_NS = 2_000_000_000, 50_000_000
#: What is known of contact and skin does not reach farther back.
SETTLED_NS = 5_000_000_000

#: A frame that is replaced would have stood for so long beyond the beginning of the next one.
_STOOD_NS = 1_000_000


@dataclass(slots=True)
class Told:
    """`request`: of a frame; it is shown until `until_ns`. `lease`: of `open`. `carried`: of
    `resume`. `felt`: of `felt`, what the person said.
    """

    t_ns: int
    act: Act
    request: dict[str, Any] | None = None
    lease: LeaseBegun | None = None
    until_ns: int = 0
    is_replaced: bool = False
    carried: CarriedOver | None = None
    felt: FeltFacts | None = None


class Timeline:
    """`told`, in order, which begins with what makes an engine as the record's was. Pulses before
    `compared_from_ns` are not those of a whole scan. `caveats`: why pulses may differ, a sentence
    each. `is_whole`: the record has one engine from its beginning on.

    Raises, when made: FileError, for a record in which no engine told how it stood.
    """

    def __init__(self, record: Iterable[Line], place: str = "the record") -> None:
        self.told: list[Told] = []
        self.caveats: list[str] = []
        self.is_whole = True
        self.begun_ns = self.compared_from_ns = 0
        self._now_ns = 0
        self._state: StateName = "SAFE"
        self._carried: CarriedOver | None = None
        #: Until that power-up is over.
        self._began_in_probe = False
        self._engine: Engine | None = None
        #: The one that stands.
        self._lease: LeaseBegun | None = None
        self._asked_power: list[Act] = []
        #: How often the person had said something of the strength since arming.
        self._answers = 0
        self._asked_frames: dict[int, dict[str, Any]] = {}
        self._frames: dict[int, Told] = {}
        for line in record:
            if isinstance(line, EngineGone) and self._carried is not None:
                self.is_whole = False
                self.caveats.append("its engine ended within it: it is replayed up to there")
                break
            if isinstance(line, Carried):
                self._begin(line)
            elif self._carried is None:
                self._heed_before(line)
            else:
                self._heed(line)
        if self._carried is None:
            raise FileError(
                place, "", "no engine was there while it was written", "a record with pulses in it"
            )
        self.told.sort(key=lambda told: told.t_ns)

    # --- its beginning ---------------------------------------------------------------------------

    def _heed_before(self, line: Line) -> None:
        """What stands, or is asked for, when the engine tells how it stands."""
        if isinstance(line, Engine):
            self._engine = line
        elif isinstance(line, LeaseBegun):
            self._lease = line
        elif isinstance(line, LeaseEnded | EngineGone):
            self._lease = None
        elif isinstance(line, Asked):
            self._heed_request(line.request)

    def _begin(self, line: Carried) -> None:
        carried = self._carried = line.carried
        self._state, self._now_ns = carried.state, carried.t_ns
        self.begun_ns = self.compared_from_ns = carried.t_ns
        self._began_in_probe = carried.state == "PROBE"
        self._make_ready(carried)
        self.told.append(Told(carried.t_ns, "resume", carried=carried))
        if carried.state == "HALTED":
            self._tell("stop")
        for request in line.frames:
            self._heed_request(request)
        if carried.shown_seq is not None and carried.next_scan_ns is not None:
            self.compared_from_ns = max(carried.t_ns, carried.next_scan_ns)
        self._warn(carried)

    def _make_ready(self, carried: CarriedOver) -> None:
        """In the time before the record: with the lease, armed, or the person's session begun."""
        lease, is_new = self._lease, False
        if lease is None and carried.has_session:
            lease, is_new = self._lease_of(carried), True
        if lease is None or carried.state == "HALTED":
            return
        before_ns = carried.t_ns - _READY_NS
        acts: list[Act] = ["open"]
        if carried.state in ("ARMED", "PROBE"):
            acts.append(carried.power_up or "arm")
        elif carried.has_session:
            # Current has flowed to this person.
            acts.append("measure")
        self.told += [
            Told(before_ns + place * _APART_NS, act, lease=lease) for place, act in enumerate(acts)
        ]
        if is_new:
            self.told.append(Told(carried.t_ns - _APART_NS, "close"))

    def _lease_of(self, carried: CarriedOver) -> LeaseBegun | None:
        """One whose session stands; without a calibration, one of anyone, whose session stands for
        nobody else: the board has been armed before.
        """
        limits = None
        if carried.calibration is None:
            if self._engine is None:
                return None
            facts = self._engine.facts
            most_ua = facts.maxima.probe_current_ua
            limits = Limits(max_current_ua=most_ua, width_us=facts.default_width_us)
        calibration = carried.calibration
        others = tuple(
            NamedCalibration(name="", digest=digest_of(other), calibration=other)
            for other in carried.others
        )
        return LeaseBegun(
            t_ns=0, client="", uid=None, calibration=calibration, others=others, limits=limits
        )

    def _warn(self, carried: CarriedOver) -> None:
        if carried.state == "PROBE":
            self.caveats.append(
                "the record began while contact was measured: the pulses of that measurement are"
                " left out"
            )
        elif carried.state == "ARMED":
            self.caveats.append(
                "the record began while the board was armed: what was known of contact and skin is"
                f" not in it, so pulses of its first {SETTLED_NS // 1_000_000_000} s may differ"
            )
        if carried.shown_seq is not None:
            after_ms = (self.compared_from_ns - carried.t_ns) / 1e6
            self.caveats.append(
                f"the record began while frame {carried.shown_seq} was shown: pulses of its first"
                f" {after_ms:.1f} ms, the scan under way, are left out"
            )
        if self._engine is not None and "pressure" in self._engine.facts.stabilizers:
            self.caveats.append(
                "the site goes by pressure, which is in the record thirty times a second only and"
                " is not replayed: its pulses may differ"
            )
        if carried.has_session:
            self.caveats.append(
                "the board was in use before the record began: pulses of its first scans may begin"
                " 0.1 ms later in the replay, and differ where a step of the soft start falls there"
            )
        if carried.recent_pulses:
            self.caveats.append(
                f"{carried.recent_pulses} pulses of the second before the record count against the"
                " bounds of charge, and are not in it: a pulse of its first second that they kept"
                " back is fired in the replay"
            )

    # --- what follows ----------------------------------------------------------------------------

    def _heed(self, line: Line) -> None:
        if isinstance(line, LeaseBegun):
            self._asked_frames.clear()
            self._frames.clear()
            self._lease = line
            self._tell("open", lease=line)
        elif isinstance(line, LeaseEnded):
            if self._lease is not None and self._state != "HALTED":
                self._tell("close")
            self._lease = None
        elif isinstance(line, Asked):
            self._heed_request(line.request)
        elif isinstance(line, State):
            self._heed_state(line.report)
        elif isinstance(line, Scans):
            for shown in line.shown:
                self._heed_shown(shown)

    def _heed_request(self, request: dict[str, Any]) -> None:
        op = request.get("op")
        if op in ("arm", "measure"):
            self._asked_power.append(op)
        elif op == "frame" and not request.get("preview"):
            self._asked_frames[request["seq"]] = request

    def _heed_state(self, report: StateReport) -> None:
        before, self._state = self._state, report.state
        self._now_ns = max(self._now_ns, report.now_ns)
        self._heed_felt(report.felt)
        if report.state == before:
            return
        if before == "PROBE" and self._began_in_probe:
            self._began_in_probe = False
            self.compared_from_ns = report.now_ns
        if report.state == "PROBE" and self._asked_power:
            self._tell(self._asked_power.pop(0))
            self._asked_power.clear()
        elif report.state == "HALTED":
            self._tell("stop")
            self._lease = None
        elif before == "HALTED":
            self._tell("clear")
        elif report.state == "SAFE" and report.last_disarm == "disarmed":
            self._tell("disarm")

    def _heed_felt(self, felt: FeltFacts | None) -> None:
        before, self._answers = self._answers, 0 if felt is None else felt.answers
        if felt is None or felt.answers == before or felt.answer is None:
            return
        if felt.said_ns >= self.begun_ns:
            self.told.append(Told(felt.said_ns, "felt", felt=felt))
            before += 1
        if felt.answers > before:
            self.caveats.append(
                f"{felt.answers - before} of the person's answers on the strength are not in the"
                " record: pulses after them may differ"
            )

    def _heed_shown(self, shown: Shown) -> None:
        self._now_ns = max(self._now_ns, shown.begun_ns)
        frame = self._frames.get(shown.seq)
        if frame is None:
            request = self._asked_frames.pop(shown.seq, None)
            if request is None:
                return  # it was asked for before the record began
            if shown.begun_ns < self.begun_ns:
                # It is begun again with its next scan; what it has had of its pulses is had.
                request = {key: value for key, value in request.items() if key != "pulses"}
            begun_ns = max(shown.begun_ns, self.compared_from_ns)
            frame = self._frames[shown.seq] = Told(begun_ns, "frame", request)
            self.told.append(frame)
            before = None if shown.replaces is None else self._frames.get(shown.replaces)
            if before is not None:
                # It stood until this frame came, and so the rhythm of its scans went on.
                frame.t_ns = max(before.t_ns, min(before.until_ns, shown.begun_ns))
                before.is_replaced, before.until_ns = True, shown.begun_ns + _STOOD_NS
        if not frame.is_replaced:
            frame.until_ns = shown.ended_ns or (shown.last_ns or shown.begun_ns) + _STOOD_NS

    def _tell(self, act: Act, lease: LeaseBegun | None = None) -> None:
        self.told.append(Told(self._now_ns, act, lease=lease))
