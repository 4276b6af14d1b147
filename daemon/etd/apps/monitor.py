"""Collects the daemon's telemetry for display.

Owns: the latest of each report, for how long its measurements are shown, the panels of the picture,
and the line of state. Must not know: the terminal, where the reports come from.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

from etd.apps.panel import Panel, contact_panel, gain_panel, resistance_panel
from etd.protocol.felt import HARDLY_ANYTHING, FeltFacts
from etd.protocol.messages import (
    Contact,
    ContactState,
    Fired,
    Halt,
    HelloReply,
    Modelled,
    Scan,
    StateReport,
)
from etd.protocol.outcome import Clamp
from etd.pulse.measured import is_stale

_CONTACT: dict[bool | None, ContactState] = {True: "closed", False: "open", None: "unknown"}
#: The pressure of full brightness.
_FIRM_KPA = 100.0
#: The felt strength of full brightness, in thresholds.
_BRIGHT_FELT = 2.5


@dataclass(slots=True)
class Monitor:
    """Fed with reports by `hear`; `facts` are those of the daemon they come from."""

    facts: HelloReply
    state: str = "?"
    ceiling_ua: int = 0
    fired: Fired | None = None
    is_silent: bool = True
    modelled: Modelled | None = None
    pulses: int = 0
    clamped: tuple[Clamp, ...] = ()
    halt: Halt | None = None
    #: What the person said of the strength.
    said: FeltFacts | None = None
    #: The key that says too strong, where there is one to press.
    key: str = ""
    #: Why a key did nothing; until the next one does something.
    refused: str = ""
    pressure_kpa: tuple[float | None, ...] = ()
    silent_sensors: tuple[str, ...] = ()
    #: How many were heard.
    reports: int = 0
    _pressed_ns: int = 0
    _contact: dict[int, ContactState] = field(default_factory=dict)
    _known_ohm: dict[int, int] = field(default_factory=dict)
    #: When contact and resistance of an electrode were last reported.
    _reported_ns: dict[int, int] = field(default_factory=dict)

    def hear(self, report: object) -> None:
        """Any telemetry report."""
        self.reports += 1
        match report:
            case StateReport():
                self.state = report.state if report.engine == "there" else f"engine {report.engine}"
                self.halt = report.halt
                self.ceiling_ua = report.ceiling_ua
                self.said = report.felt
                self.pulses = report.counters.get("pulses", self.pulses)
                self.silent_sensors = tuple(report.sensor_problems)
                self._drop_stale(report.now_ns)
            case Scan():
                self._hear_scan(report)
            case Contact():
                self._hear_contact(report)
            case Modelled():
                self.modelled = report
            case Halt():
                self.halt = report

    def _hear_scan(self, scan: Scan) -> None:
        self.is_silent = bool(scan.shown) and scan.shown[-1].ended
        self.fired = scan.fired
        self.ceiling_ua = scan.ceiling_ua
        self.clamped = scan.clamped
        self._pressed(scan.pressure_kpa, scan.now_ns)
        for electrode, state in enumerate(scan.fired.contact):
            if state is not None:
                self._contact[electrode] = state
                self._reported_ns[electrode] = scan.now_ns
                self._set_ohm(electrode, scan.fired.resistance_ohm[electrode])
        self._drop_stale(scan.now_ns)

    def _hear_contact(self, report: Contact) -> None:
        self._pressed(report.pressure_kpa, report.t_ns)
        for electrode, touches in enumerate(report.contact):
            self._contact[electrode] = _CONTACT[touches]
            self._reported_ns[electrode] = report.t_ns
            self._set_ohm(electrode, report.resistance_ohm[electrode])

    def _pressed(self, pressure_kpa: tuple[float | None, ...], now_ns: int) -> None:
        self.pressure_kpa, self._pressed_ns = pressure_kpa, now_ns

    def _drop_stale(self, now_ns: int) -> None:
        """Draw measurements as unknown that are too old for the engine as well."""
        if is_stale(self._pressed_ns, now_ns):
            self.pressure_kpa = (None,) * len(self.pressure_kpa)
        stale = [
            electrode
            for electrode, reported_ns in self._reported_ns.items()
            if is_stale(reported_ns, now_ns)
        ]
        for electrode in stale:
            del self._reported_ns[electrode]
            self._contact[electrode] = "unknown"
            self._known_ohm.pop(electrode, None)

    def _set_ohm(self, electrode: int, resistance_ohm: int | None) -> None:
        if resistance_ohm is None:
            self._known_ohm.pop(electrode, None)
        else:
            self._known_ohm[electrode] = resistance_ohm

    # --- panels ------------------------------------------------------------------------------

    def panels(self) -> list[Panel]:
        """Wanted and delivered current, resistance, contact; on a fake board what is felt."""
        electrodes = range(self.facts.array.electrodes)
        found = [
            Panel("wanted", self._of_full("wanted_ua")),
            Panel("delivered", self._of_full("delivered_ua")),
            resistance_panel([self._known_ohm.get(electrode) for electrode in electrodes]),
            contact_panel([self._contact.get(electrode, "unknown") for electrode in electrodes]),
        ]
        if any(gain is not None for gain in self._gains()):
            found.append(gain_panel(self._gains()))
        if self.pressure_kpa:
            pressed = [
                None if kpa is None else min(1.0, kpa / _FIRM_KPA) for kpa in self.pressure_kpa
            ]
            found.append(Panel("pressure", pressed))
        if self.modelled is not None:
            hurt = {electrode for electrode, pain in enumerate(self.modelled.pain) if pain >= 1.0}
            felt = [min(1.0, value / _BRIGHT_FELT) for value in self.modelled.felt]
            found.append(Panel("felt (modelled)", felt, alarming=frozenset(hurt)))
        return found

    def _gains(self) -> Sequence[float | None]:
        """What stabilizers made of each electrode's charge, by its last pulse."""
        return () if self.fired is None or self.is_silent else self.fired.gain

    def _of_full(self, key: str) -> list[float | None]:
        """0..1 for each electrode: 1 is the highest wanted or allowed uncalibrated current."""
        electrodes = self.facts.array.electrodes
        if self.fired is None or self.is_silent:
            return [0.0] * electrodes
        full_ua = max(*self.fired.wanted_ua, self.facts.maxima.uncalibrated_current_ua)
        return [current / full_ua for current in getattr(self.fired, key)]

    def line(self, rate_hz: float | None = None) -> str:
        """State, ceiling, what fires, contact."""
        parts = [self.state, f"ceiling {self.ceiling_ua} uA", self._firing()]
        if rate_hz is not None:
            parts.append(f"{rate_hz:.0f} Hz")
        parts.append(f"{self.pulses} pulses")
        if self._contact:
            parts.append(self._contacts())
        if self.silent_sensors:
            parts.append(f"no readings from {' and '.join(self.silent_sensors)}")
        if self.modelled is not None:
            parts.append(_felt(self.modelled))
        if self.clamped:
            reasons = sorted({clamp.reason for clamp in self.clamped})
            parts.append(f"clamped by {' and '.join(reasons)}")
        if gains := [gain for gain in self._gains() if gain is not None]:
            parts.append(f"laws {_times(gains)}")
        if self.said is not None:
            parts.append(_said(self.said, self.key))
        if self.refused:
            parts.append(self.refused)
        if self.halt is not None:
            parts.append(f"halted by {self.halt.cause}")
        return ", ".join(parts)

    def _contacts(self) -> str:
        """What is not known counts neither as touched nor as open."""
        states = [
            self._contact.get(electrode, "unknown")
            for electrode in range(self.facts.array.electrodes)
        ]
        touched = sum(state in ("closed", "soft") for state in states)
        unknown = states.count("unknown")
        is_open = len(states) - touched - unknown
        return f"{touched} touched, {is_open} open, {unknown} unknown"

    def _firing(self) -> str:
        active = [] if self.fired is None or self.is_silent else self.fired.delivered_ua
        active = [current for current in active if current]
        return f"{len(active)} electrodes, up to {max(active)} uA" if active else "silent"


def _times(factors: Sequence[float]) -> str:
    least, most = (f"{factor:.2f}" for factor in (min(factors), max(factors)))
    return f"x{least}" if least == most else f"x{least}-{most}"


def _said(said: FeltFacts, key: str) -> str:
    """What the person's words took and gave, as factors on the current. A first word takes little:
    who looks whether it was enough sees that it can be said again.
    """
    parts = [f"said {_times(said.factors)}"]
    if min(said.factors) < HARDLY_ANYTHING:
        parts.append("hardly anything is left, until disarmed")
    if key and said.answer == "too_strong":
        parts.append(f"press {key} again for more")
    if said.laws_off:
        parts.append("LAWS OFF")
    return ", ".join(parts)


def _felt(modelled: Modelled) -> str:
    felt = sum(value >= 1.0 for value in modelled.felt)
    hurt = sum(value >= 1.0 for value in modelled.pain)
    text = f"modelled: felt at {felt}, strength up to {max(modelled.felt):.1f}"
    return f"{text}, PAIN at {hurt}" if hurt else text
