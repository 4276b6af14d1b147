"""What an engine may have done, judged from the wires by rules of its own.

Owns: its own reckoning of limits, windows, opening, expiry and reports. It takes what was fired
from the decoded trace, who shared a current from the body itself, and what was told from the
reports. Must not know: the engine's limits, ledger, opening, contact map, shares.
"""

from __future__ import annotations

from bisect import bisect_left, bisect_right
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise

from etd.protocol.link import Report
from etd.protocol.messages import Scan
from net_by_hand import most_left_pc
from rise_witness import RISE_UA, Rise
from skin_witness import Skin
from trace_decoder import Facts, Phase, Record, decode, is_led, visits

SECOND_NS = 1_000_000_000
#: `commanded_ua` is rounded down to whole uA, charges to whole pC.
ROUNDING_PC = 1.0


@dataclass(frozen=True)
class Bounds:
    """The maxima that were in force: the smallest of code, board and body site, by hand."""

    charge_pc: int
    rate_hz: int
    mean_current_ua: int
    on_us_per_s: int
    array_mean_current_ua: int
    array_on_us_per_s: int
    net_charge_pc: int
    probe_current_ua: int
    probe_width_us: int
    #: The longest that one visit can take from the look at the clock to its last phase.
    slot_ns: int


@dataclass(frozen=True)
class SentFrame:
    """A frame that was accepted, and what it asked for. `returns` None: all others."""

    seq: int
    current_ua: Sequence[int]
    width_us: int
    sent_ns: int
    ttl_ms: int
    returns: tuple[tuple[int, ...], ...] | None
    pulses: int | None

    @property
    def expires_ns(self) -> int:
        return self.sent_ns + self.ttl_ms * 1_000_000


@dataclass
class Story:
    """What a test did and heard, in order of time."""

    bounds: Bounds
    electrodes: int
    frames: dict[int, SentFrame] = field(default_factory=dict)
    refused: set[int] = field(default_factory=set)
    #: (time, caps): each lease's, from its opening on.
    caps: list[tuple[int, tuple[int, ...]]] = field(default_factory=list)
    #: (time, electrode, conductance in S, 0 when lifted): the first ones from the beginning.
    contacts: list[tuple[int, int, float]] = field(default_factory=list)
    presses: list[int] = field(default_factory=list)
    #: (time, electrode, current, width): what a stabilizer asked for, where there was one.
    requests: list[tuple[int, int, int, int]] = field(default_factory=list)
    reports: list[Report] = field(default_factory=list)
    is_probe_first: bool = False


@dataclass(frozen=True)
class Visit:
    """One pulse, with all its phases."""

    phases: tuple[Phase, ...]
    electrode: int
    state: str
    frame: SentFrame | None
    caps_ua: tuple[int, ...]
    #: The part of its current that each electrode returned, as far as anybody could know.
    shares: dict[int, float]
    is_known_open: bool
    #: Itself and any of its returns, when it was made.
    touches: bool

    @property
    def begun_ns(self) -> int:
        return self.phases[0].from_ns

    @property
    def is_look(self) -> bool:
        """At an electrode that the frame leaves silent."""
        return self.frame is not None and not self.frame.current_ua[self.electrode]

    @property
    def current_ua(self) -> float:
        return max(phase.current_ua for phase in self.phases)

    @property
    def is_led(self) -> bool:
        """A probe went before its pulse."""
        return len(self.phases) > 1 and is_led(*self.phases[:2])

    @property
    def charge_pc(self) -> float:
        return sum(phase.charge_pc for phase in self.phases)

    @property
    def on_us(self) -> float:
        return sum(phase.width_us for phase in self.phases)

    @property
    def returns(self) -> tuple[int, ...] | None:
        """None: all others, as for every look, whatever the frame chose."""
        if self.frame is None or self.frame.returns is None or self.is_look:
            return None
        return self.frame.returns[self.electrode]


class Oracle:
    """Judges one story by its trace."""

    def __init__(self, story: Story, trace: Sequence[Record]) -> None:
        self.story = story
        self.facts = Facts.of(trace[0])
        self.trace = trace
        self.states = [
            (report.state.now_ns, report.state.state)
            for report in story.reports
            if report.state is not None
        ]
        self.scans = [report.scan for report in story.reports if report.scan is not None]
        self.visits = list(self._visits())

    @property
    def code_ua(self) -> float:
        return self.facts.full_scale_ua / (self.facts.codes - 1)

    def _state_at(self, t_ns: int) -> str:
        place = bisect_right(self.states, t_ns, key=lambda entry: entry[0])
        return self.states[place - 1][1] if place else "SAFE"

    def _visits(self) -> Iterator[Visit]:
        """Follows who was touched, and what the pulses could tell of it."""
        skin = Skin(self.story.contacts)
        known: dict[int, bool] = {}
        before_ns = 0
        for phases in visits(decode(self.trace)):
            begun_ns = phases[0].from_ns
            skin.until(begun_ns)
            if self._was_safe(before_ns, begun_ns):
                known.clear()
            before_ns = begun_ns
            visit = self._visit(phases, known, skin)
            yield visit
            known[visit.electrode] = visit.touches

    def _touches(self, electrode: int, chosen: Iterable[int] | None, skin: Skin) -> bool:
        opposite = range(self.story.electrodes) if chosen is None else chosen
        return skin.is_touched(electrode) and any(
            skin.is_touched(other) for other in opposite if other != electrode
        )

    def _was_safe(self, from_ns: int, to_ns: int) -> bool:
        return any(from_ns < t_ns <= to_ns and state in ("SAFE", "HALTED", "PROBE")
                   for t_ns, state in self.states)  # fmt: skip

    def _visit(self, phases: tuple[Phase, ...], known: dict[int, bool], skin: Skin) -> Visit:
        electrode, begun_ns = phases[0].electrode, phases[0].from_ns
        assert electrode is not None, "a pulse with no electrode alone on its side"
        state = self._state_at(begun_ns)
        frame = self.story.frames.get(phases[0].seq or -1) if state == "ARMED" else None
        caps = [caps for t_ns, caps in self.story.caps if t_ns <= begun_ns]
        was_open = known.get(electrode) is False
        visit = Visit(phases, electrode, state, frame, caps[-1], {}, was_open, touches=False)
        chosen = visit.returns
        shares = skin.shares(electrode) if chosen is None else dict.fromkeys(chosen, 1.0)
        return replace(visit, shares=shares, touches=self._touches(electrode, chosen, skin))

    # --- the judgments ---------------------------------------------------------------------------

    def check_all(self) -> None:
        self.check_states()
        self.check_caps()
        self.check_charges()
        self.check_probes()
        self.check_windows()
        self.check_net_charge()
        self.check_expiry()
        self.check_opening()
        self.check_stops()
        self.check_clamps_are_told()
        self.check_thinning_is_told()

    def check_states(self) -> None:
        """Probes in PROBE, frames in ARMED, nothing in SAFE and HALTED."""
        for visit in self.visits:
            self._check_state(visit)

    def _check_state(self, visit: Visit) -> None:
        assert visit.state in ("PROBE", "ARMED")
        if visit.state == "ARMED":
            assert visit.frame is not None, "a pulse of a frame that nobody sent"
            assert visit.phases[0].seq not in self.story.refused
        if visit.state == "PROBE" or visit.is_look:
            self._check_probe(visit)

    def _check_probe(self, visit: Visit) -> None:
        assert visit.current_ua <= self.story.bounds.probe_current_ua
        assert all(phase.width_us <= self.story.bounds.probe_width_us for phase in visit.phases)

    def check_caps(self) -> None:
        """Its own cap, and those of its returns."""
        for visit in self.visits:
            if visit.state == "ARMED":
                self._check_caps(visit)

    def _check_caps(self, visit: Visit) -> None:
        assert visit.current_ua <= visit.caps_ua[visit.electrode]
        for electrode, share in visit.shares.items():
            assert visit.current_ua * share <= visit.caps_ua[electrode] + 1e-6
        if visit.is_known_open:
            assert visit.current_ua <= self.story.bounds.probe_current_ua

    def check_charges(self) -> None:
        """Of each phase, with all that led into it."""
        most_pc = self.story.bounds.charge_pc + ROUNDING_PC
        for visit in self.visits:
            for way in (True, False):
                assert (
                    sum(phase.charge_pc for phase in visit.phases if phase.is_anodic is way)
                    <= most_pc
                )

    def check_probes(self) -> None:
        """One at most, weak and short, before the pulse of a frame; of what it finds open, no more
        is asked.
        """
        for visit in self.visits:
            if not visit.is_led:
                continue
            probe = visit.phases[0]
            assert visit.state == "ARMED"
            assert self.story.is_probe_first
            assert probe.current_ua <= self.story.bounds.probe_current_ua
            assert probe.width_us <= self.story.bounds.probe_width_us
            assert visit.touches, "a pulse after its probe has found the contact open"

    def check_windows(self) -> None:
        """Over every second that ends with a pulse."""
        bounds = self.story.bounds
        for last, visit in enumerate(self.visits):
            window = self._second_before(last)
            charge_pc, pulses, on_us = _sums(window, self.story.electrodes)
            rounded_pc = ROUNDING_PC * len(window)
            assert max(charge_pc.values()) <= bounds.mean_current_ua * 1e6 + rounded_pc
            assert pulses[visit.electrode] <= bounds.rate_hz
            assert on_us[visit.electrode] <= bounds.on_us_per_s
            assert sum(each.charge_pc for each in window) <= bounds.array_mean_current_ua * 1e6
            assert sum(each.on_us for each in window) <= bounds.array_on_us_per_s

    def check_net_charge(self) -> None:
        each = [(visit.phases, visit.returns) for visit in self.visits]
        left_pc = most_left_pc(each, self.story.electrodes)
        assert left_pc <= self.story.bounds.net_charge_pc + ROUNDING_PC * len(self.visits)

    def _second_before(self, last: int) -> list[Visit]:
        begun_ns = self.visits[last].begun_ns
        first = bisect_right(
            self.visits, begun_ns - SECOND_NS, hi=last + 1, key=lambda visit: visit.begun_ns
        )
        return self.visits[first : last + 1]

    def check_expiry(self) -> None:
        """A frame past its time gets at most the pulse that was being made."""
        late: Counter[int] = Counter()
        for visit in self.visits:
            frame = visit.frame
            if frame is not None and visit.begun_ns >= frame.expires_ns:
                late[frame.seq] += 1
                assert visit.begun_ns < frame.expires_ns + self.story.bounds.slot_ns
        assert all(count == 1 for count in late.values())

    def check_opening(self) -> None:
        """Within any 100 ms no pulse exceeds by more than 0.5 mA the highest that was fired before
        since arming; and none of an electrode that is touched again the highest of its own.
        """
        armed_ns, fired, touched = -1, Rise(), dict[int, Rise]()
        for visit in self.visits:
            if visit.state != "ARMED":
                continue
            if self._armed_ns(visit.begun_ns) != armed_ns:
                armed_ns, fired, touched = self._armed_ns(visit.begun_ns), Rise(), {}
            for rise in (fired, touched.get(visit.electrode)):
                if rise is not None:
                    assert rise.above_ua(visit.begun_ns, visit.current_ua) <= RISE_UA
            if visit.is_known_open and visit.touches:
                touched[visit.electrode] = Rise()

    def _armed_ns(self, t_ns: int) -> int:
        place = bisect_right(self.states, t_ns, key=lambda entry: entry[0]) - 1
        while place and self.states[place - 1][1] == "ARMED":
            place -= 1
        return self.states[place][0]

    def check_stops(self) -> None:
        """After a stop line opened, the pulse under way is the last until the next power-up."""
        for pressed_ns in self.story.presses:
            after = [visit for visit in self.visits if visit.begun_ns > pressed_ns]
            if after and after[0].begun_ns > pressed_ns + self.story.bounds.slot_ns:
                assert self._went_up(pressed_ns, after[0].begun_ns)
            if len(after) > 1:
                assert self._went_up(pressed_ns, after[1].begun_ns)

    def _went_up(self, from_ns: int, to_ns: int) -> bool:
        ups = [t_ns for t_ns, state in self.states if state in ("SAFE", "HALTED", "PROBE")]
        return any(from_ns <= t_ns <= to_ns for t_ns in ups)

    # --- what was told -----------------------------------------------------------------------

    def _report_after(self, t_ns: int) -> Scan | None:
        place = bisect_left(self.scans, t_ns, key=lambda scan: scan.now_ns)
        return self.scans[place] if place < len(self.scans) else None

    def _asked_ua(self, visit: Visit) -> int:
        """What was wanted of this pulse when the limits saw it."""
        assert visit.frame is not None
        asked_ua = visit.frame.current_ua[visit.electrode]
        for until_ns in sorted(phase.from_ns for phase in visit.phases):
            wished = [
                entry
                for entry in self.story.requests
                if entry[1] == visit.electrode and entry[0] <= until_ns
            ]
            # What was asked for before a probe bounds what is asked for behind it.
            if wished:
                is_first = until_ns == visit.begun_ns
                asked_ua = wished[-1][2] if is_first else min(asked_ua, wished[-1][2])
        return asked_ua

    def _has_only_a_probe(self, visit: Visit) -> bool:
        """Weak enough to be a probe with no pulse behind it."""
        is_weak = visit.current_ua <= self.story.bounds.probe_current_ua
        return self.story.is_probe_first and len(visit.phases) == 1 and is_weak

    def check_clamps_are_told(self) -> None:
        """Who got less than was asked for is named in the next report, with what it got."""
        for visit in self.visits:
            if visit.state != "ARMED" or visit.is_look:
                continue
            if visit.current_ua > self._asked_ua(visit) - self.code_ua:
                continue
            told = self._report_after(visit.begun_ns)
            assert told is not None
            clamps = [clamp for clamp in told.clamped if clamp.electrode == visit.electrode]
            if self._has_only_a_probe(visit) and self._is_excused(visit, told):
                continue
            assert clamps, f"electrode {visit.electrode} was clamped, and nobody was told"
            assert all(0 <= it.allowed_ua < it.wanted_ua and it.limited_by >= 0 for it in clamps)

    def _is_excused(self, visit: Visit, told: Scan) -> bool:
        """A probe with no pulse behind it: named as thinned, or its frame's time was over, or that
        is all that the stabilizer then wished for.
        """
        assert visit.frame is not None
        until_ns = visit.begun_ns + self.story.bounds.slot_ns
        if self._requested_nothing(visit.electrode, visit.begun_ns, until_ns):
            return True
        is_over = until_ns >= visit.frame.expires_ns
        return is_over or any(
            shortfall.electrode == visit.electrode for shortfall in told.not_fired
        )

    def check_thinning_is_told(self) -> None:
        """Of each scan but a frame's last, every active electrode got a pulse, or is named."""
        for electrode, from_ns, to_ns in self._missing():
            named: set[int | None] = set()
            for scan in self._reports_about(from_ns, to_ns):
                named |= {clamp.electrode for clamp in scan.clamped}
                named |= {shortfall.electrode for shortfall in scan.not_fired}
            assert electrode in named, f"electrode {electrode} had no pulse, and nobody was told"

    def _reports_about(self, from_ns: int, to_ns: int) -> Iterator[Scan]:
        """Those from one time to the first after another."""
        for scan in self.scans[bisect_left(self.scans, from_ns, key=lambda scan: scan.now_ns) :]:
            yield scan
            if scan.now_ns >= to_ns:
                return

    def _missing(self) -> Iterator[tuple[int, int, int]]:
        """Electrodes that a scan left out, and when it began and the next one did."""
        by_scan: dict[int, set[int]] = defaultdict(set)
        for visit in self.visits:
            if visit.phases[0].scan is not None:
                by_scan[visit.phases[0].scan].add(visit.electrode)
        fired: dict[int, Counter[int]] = defaultdict(Counter)
        remarks = _scan_remarks(self.trace)
        for index, (remark, following) in enumerate(pairwise(remarks)):
            seq = remark["seq"]
            frame = self.story.frames[seq]
            for electrode, current_ua in enumerate(frame.current_ua):
                if electrode in by_scan[index]:
                    fired[seq][electrode] += 1
                elif _is_due(frame, current_ua, fired[seq][electrode]) and following["seq"] == seq:
                    times = remark["t_ns"], following["t_ns"]
                    if not self._requested_nothing(electrode, *times):
                        yield electrode, *times

    def _requested_nothing(self, electrode: int, from_ns: int, to_ns: int) -> bool:
        """A stabilizer that asks for less than one code is not clamped: it has its wish."""
        return any(
            other == electrode and from_ns <= t_ns <= to_ns and current_ua < self.code_ua
            for t_ns, other, current_ua, _ in self.story.requests
        )


def _is_due(frame: SentFrame, current_ua: int, fired: int) -> bool:
    return current_ua > 0 and (frame.pulses is None or fired < frame.pulses)


def _scan_remarks(trace: Sequence[Record]) -> list[Record]:
    return [entry for entry in trace[1:] if entry["bus"] == "engine" and entry["event"] == "frame"]


def _sums(
    window: Sequence[Visit], electrodes: int
) -> tuple[dict[int, float], Counter[int], dict[int, float]]:
    """Charge carried (as stimulated one and as return), pulses, and time with current."""
    charge_pc = dict.fromkeys(range(electrodes), 0.0)
    on_us = dict.fromkeys(range(electrodes), 0.0)
    pulses = Counter(visit.electrode for visit in window)
    for visit in window:
        charge_pc[visit.electrode] += visit.charge_pc
        on_us[visit.electrode] += visit.on_us
        for electrode, share in visit.shares.items():
            charge_pc[electrode] += visit.charge_pc * share
    return charge_pc, pulses, on_us
