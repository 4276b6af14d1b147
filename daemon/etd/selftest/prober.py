"""One pulse at one electrode, within maxima, ledger and guard, and the node's voltage in it.

Owns: every pulse of a self-test; the strength of a probe; the ramp up to it.
Must not know: what is concluded from a pulse.

A person may be on the board, so a probe commands a third of the board file's probe bound: a source
three times too strong stays within it. The ramp up to it starts at an eighth of that, where a
source 24 times too strong is still within the bound, and continues only while the node reads as
with nothing connected. Skin of 50 k takes so much of the current that only a source two to three
times too strong could be taken for an open electrode.

So the bound holds for a source that is constantly too strong, by at most 24 times. A stronger one,
or one that becomes much too strong between two pulses, fires one pulse above the bound before it is
detected. That pulse is the last.

The node is sampled twice in a pulse, 10 us after its start and near its end. With a passive load
the first sample is never higher, so a source that starts too strong is detected in the first such
pulse. What it does before, between and after the samples is not (`UNPROVED`).
"""

from __future__ import annotations

from dataclasses import dataclass

from etd.firing import Firing, ReadyPulse
from etd.pulse.request import PulseRequest
from etd.safety.bookings import Entry
from etd.safety.ledger import Bounds, Ledger
from etd.safety.maxima import PC_PER_NC, maxima_of
from etd.selftest.fixture import Fixture
from etd.selftest.report import ProbeBound
from etd_hal.chips.hv507 import HalfBridgeSwitch
from etd_hal.errors import BoardFault, CannotSelect, GuardRefusal
from etd_hal.phase import PulseResult

#: A probe is the bound divided by this.
_PART = 3
#: The ramp's steps, as divisors of the probe.
_RAMP = (8, 4, 2, 1)
#: The range of the node, relative to its open voltage, in which the ramp continues; the ADC's steps
#: are added. A finger reads below it at the first step, of some nine codes.
_LEAST, _MOST = 0.6, 1.2
_LEAST_CODES, _MOST_CODES = 2, 3
#: The most of the early sample relative to the last; the noise of two readings is added.
_MOST_EARLY, _EARLY_CODES = 1.2, 8
#: Between two looks whether net charge has leaked enough for the next pulse.
_LEAKED_MS = 20.0


@dataclass(frozen=True, slots=True)
class Ramp:
    """The reading at the last step."""

    is_good: bool
    measured: str
    expected: str


class Prober:
    """One for a whole self-test, since it has the ledger."""

    def __init__(self, fixture: Fixture) -> None:
        self._fixture = fixture
        self._maxima = maxima_of(fixture.file, fixture.loaded.body_site)
        #: Each return is charged as if it alone carried the current.
        self.ledger = Ledger(fixture.loaded.array.count, Bounds.of(self._maxima))
        self._firing = Firing(fixture.board, self.ledger, fixture.clock)
        self._outputs = fixture.loaded.array.outputs()
        self._step_v = fixture.file.source.node_uv_per_code / 1e6
        self._is_chain_known = False
        #: The longest excess over the plan in us: of probes, of pulses into a load.
        self.over_us = {"probes": 0.0, "into the load": 0.0}

    @property
    def bound(self) -> ProbeBound:
        maxima = self._maxima
        return ProbeBound(
            current_ua=maxima.probe_current_ua,
            width_us=maxima.probe_width_us,
            charge_nc=maxima.probe_current_ua * maxima.probe_width_us / PC_PER_NC,
        )

    @property
    def probe_ua(self) -> int:
        return self._maxima.probe_current_ua // _PART

    @property
    def width_us(self) -> int:
        return self._maxima.probe_width_us

    @property
    def strongest_ua(self) -> int:
        """Into a confirmed load, at `width_us`: the highest current allowed for a person."""
        return self._fixture.subject.strongest_ua

    def open_v(self, commanded_ua: float) -> float:
        """The node's voltage with nothing connected."""
        source = self._fixture.file.source
        return min(commanded_ua * source.leak_ohm / 1e6, float(source.compliance_v))

    def ramp(self, electrode: int, is_supplied: bool = True) -> Ramp:
        """Up to the probe at an open electrode, while the node is in range; without a supply only
        the upper bound counts. Raises: BusError, BoardFault, GuardRefusal.
        """
        for divisor in _RAMP:
            commanded_ua, result = self._fire(electrode, self.probe_ua // divisor, True)
            open_v = self.open_v(commanded_ua)
            least_v = open_v * _LEAST - _LEAST_CODES * self._step_v if is_supplied else 0.0
            most_v = self._most_open_v(commanded_ua)
            is_good = least_v <= result.voltage_v <= most_v
            measured = f"{result.voltage_v:.2f} V at {commanded_ua} uA"
            if not is_good:
                break
        return Ramp(is_good, measured, f"{max(0.0, least_v):.2f} to {most_v:.2f} V")

    def probe(
        self, electrode: int, is_anodic: bool = True, current_ua: int | None = None
    ) -> tuple[int, PulseResult]:
        """(commanded_ua, result) of the weak probe, or of a weaker one.

        Raises: BusError, GuardRefusal, BoardFault (also for a node above its open voltage: the
        source has become too strong since the ramp).
        """
        weaker_ua = self.probe_ua if current_ua is None else min(current_ua, self.probe_ua)
        return self._checked(*self._fire(electrode, weaker_ua, is_anodic))

    def blanked(self, electrode: int) -> tuple[int, PulseResult]:
        """A probe with this electrode selected and the outputs blanked. Raises: as `probe`."""
        return self._checked(*self._fire(electrode, self.probe_ua, True, is_blanked=True))

    def latched(self, electrode: int, behind: int) -> tuple[int, PulseResult]:
        """With it latched, another shifted in behind; half-bridges only. Raises: as `probe`."""
        self.reset_chain()
        return self._checked(*self._fire(electrode, self.probe_ua, True, behind=behind))

    def _checked(self, commanded_ua: int, result: PulseResult) -> tuple[int, PulseResult]:
        most_v = self._most_open_v(commanded_ua)
        if result.voltage_v > most_v:
            raise BoardFault(
                "strength of a probe",
                f"{result.voltage_v:.2f} V at {commanded_ua} uA",
                f"at most {most_v:.2f} V",
            )
        return commanded_ua, result

    def into_load(self, electrode: int, current_ua: int) -> tuple[int, PulseResult]:
        """(commanded_ua, result), into a confirmed load only. Raises: as `probe`."""
        if not self._fixture.is_load_confirmed:
            raise GuardRefusal(
                "self-test", f"{current_ua} uA", f"{self.probe_ua} uA: the load is not confirmed"
            )
        return self._fire(electrode, min(current_ua, self.strongest_ua), True)

    def _most_open_v(self, commanded_ua: int) -> float:
        return self.open_v(commanded_ua) * _MOST + _MOST_CODES * self._step_v

    def reset_chain(self) -> None:
        """After other use of the chain: the next pulse writes it completely."""
        self._is_chain_known = False

    def _fire(
        self,
        electrode: int,
        current_ua: int,
        is_anodic: bool,
        *,
        is_blanked: bool = False,
        behind: int | None = None,
    ) -> tuple[int, PulseResult]:
        fixture = self._fixture
        fixture.watch_stops()
        entry = self._entry_that_fits(electrode, current_ua, is_anodic)
        selection = fixture.board.selection(self._outputs[electrode], None)
        pulse = fixture.board.pulse(current_ua, self.width_us)
        fixture.board.guard.permit(current_ua)
        fixture.board.prepare(selection, whole=not self._is_chain_known)
        self._is_chain_known = True
        if behind is not None:
            self._shift_behind(behind)
        if is_blanked:
            fixture.board.release()
        else:
            fixture.board.connect(selection, is_anodic)
        # Relays have moved by now: a supply that returns with a beat has not risen yet.
        fixture.beats.beat_if_due()
        given = PulseRequest(current_ua, self.width_us)
        ready = ReadyPulse(entry, selection, (is_anodic,), pulse, given, is_blanked)
        result, _ = self._firing.fire(self._firing.book(ready), ready)
        fixture.board.guard.permit(0)
        what = "probes" if current_ua <= self.probe_ua else "into the load"
        self.over_us[what] = max(self.over_us[what], result.excess_ns / 1_000)
        self._check_course(result, pulse.commanded_ua)
        return pulse.commanded_ua, result

    def _shift_behind(self, electrode: int) -> None:
        switch = self._fixture.board.switch
        if not isinstance(switch, HalfBridgeSwitch):
            raise CannotSelect(electrode, "shifted in behind the latch", "half-bridges only")
        switch.shift_behind(self._fixture.board.selection(self._outputs[electrode], None))

    def _entry_that_fits(self, electrode: int, current_ua: int, is_anodic: bool) -> Entry:
        """Each return as if it alone carried the current. Raises: GuardRefusal."""
        self._fixture.clock.sleep_until_ns(self.ledger.rested_ns(electrode))
        charge_pc = current_ua * self.width_us
        net_pc = charge_pc if is_anodic else -charge_pc
        entry = Entry(electrode, charge_pc, self.width_us, None, 1.0, net_pc=net_pc)
        reason = self.ledger.first_violation(entry, self._fixture.clock.now_ns())
        while reason == "net charge":
            # It leaks by itself; a load has none, and a person who touches it must not get more.
            self._fixture.wait_ms(_LEAKED_MS)
            reason = self.ledger.first_violation(entry, self._fixture.clock.now_ns())
        if reason is not None:
            raise GuardRefusal("ledger", f"a pulse above the second's {reason}", "a slower test")
        return entry

    def _check_course(self, result: PulseResult, commanded_ua: int) -> None:
        if result.excess_ns > self._fixture.loaded.machine.spread_us * 1_000:
            return  # A stall between the samples: a one-shot may have ended the pulse.
        slack_v = _EARLY_CODES * self._fixture.file.source.node_uv_per_code / 1e6
        most_v = result.voltage_v * _MOST_EARLY + slack_v
        if result.early_v > most_v:
            raise BoardFault(
                "course of a pulse",
                f"{result.early_v:.2f} V after 10 us and {result.voltage_v:.2f} V at the end, at"
                f" {commanded_ua} uA",
                f"at most {most_v:.2f} V after 10 us: the source starts too strong",
            )
