"""What the daemon reports, gathered into what a person wants to see at a glance.

Owns: the latest of each report, brightness per electrode, and the line of state. Must not know:
the terminal, where the reports come from.
"""

from __future__ import annotations

from dataclasses import dataclass, field

from etd.protocol import Clamp, Contact, Halt, HelloReply, RefusedReport, Scan, StateReport

#: From silent to strong.
SIGNS = "·░▒▓█"


@dataclass(slots=True)
class Monitor:
    """Fed with reports by `hear`; `facts` are those of the daemon they come from."""

    facts: HelloReply
    state: str = "?"
    ceiling_ua: int = 0
    current_ua: tuple[int, ...] = ()
    touching: int | None = None
    pulses: int = 0
    frames: int = 0
    clamped: tuple[Clamp, ...] = ()
    halt: Halt | None = None
    refused: RefusedReport | None = None
    _ended: set[int] = field(default_factory=set)

    def hear(self, report: object) -> None:
        """Any telemetry report."""
        match report:
            case StateReport():
                self.state = report.state if report.engine == "there" else "engine gone"
                self.halt = report.halt
                self.ceiling_ua = report.ceiling_ua
                self.pulses = report.counters.get("pulses", self.pulses)
                self.frames = report.counters.get("frames_shown", self.frames)
            case Scan():
                is_silent = bool(report.shown) and report.shown[-1].ended
                self.current_ua = () if is_silent else report.fired.current_ua
                self.ceiling_ua = report.ceiling_ua
                self.clamped = report.clamped
            case Contact():
                self.touching = sum(one is True for one in report.contact)
            case RefusedReport():
                self.refused = report
            case Halt():
                self.halt = report

    def brightness(self) -> list[float]:
        """0..1 for each electrode: what was fired last, of the most that is fired or may be."""
        electrodes = self.facts.array.electrodes
        currents = self.current_ua or (0,) * electrodes
        full_ua = max(*currents, self.facts.maxima.uncalibrated_current_ua)
        return [current / full_ua for current in currents]

    def signs(self) -> list[str]:
        """One character for each electrode."""
        top = len(SIGNS) - 1
        return [SIGNS[min(top, round(bright * top + 0.3))] for bright in self.brightness()]

    def line(self, rate_hz: float | None = None) -> str:
        """State, ceiling, what fires, contact."""
        active = [current for current in self.current_ua if current]
        parts = [self.state, f"ceiling {self.ceiling_ua} uA"]
        parts.append(f"{len(active)} electrodes, up to {max(active)} uA" if active else "silent")
        if rate_hz is not None:
            parts.append(f"{rate_hz:.0f} Hz")
        parts.append(f"{self.pulses} pulses")
        if self.touching is not None:
            parts.append(f"{self.touching} of {self.facts.array.electrodes} touch the skin")
        if self.clamped:
            reasons = sorted({clamp.reason for clamp in self.clamped})
            parts.append(f"clamped by {' and '.join(reasons)}")
        if self.halt is not None:
            parts.append(f"halted by {self.halt.cause}")
        return ", ".join(parts)
