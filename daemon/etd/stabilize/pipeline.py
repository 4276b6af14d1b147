"""The place between what a frame wants and what the limits let through.

Owns: what a stabilizer gets and returns, and the order of the stabilizers. Must not know: limits,
hardware, clocks. What comes out of here is a request: the frame's bounds (`PulseBounds`) and
`safety/limits.py` clamp it.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Final, Protocol

from etd.pulse.measured import ContactState
from etd.pulse.request import MaxGain, PulseRequest

#: A law calls it with the reason in a word, once when it begins to reject a measurement.
OnRejected = Callable[[str], object]


def ignore_rejection(_: str) -> None:
    """Where rejections are not counted."""


class ElectrodeEstimate:
    """What pulses, a calibration and sensors show of an electrode; None where unknown.

    `skin_ohm` is the skin's resistance to a long pulse, from stimulus pulses alone, filtered, and
    None while it is rejected (see `sensing/impedance.py`). `latest_ohm` is that of the last pulse
    alone, unfiltered: a law that gives less by it gives less. `skin_at_ua` is the current of the
    pulse it was last measured with.
    """

    __slots__ = (
        "early_ohm",
        "electrode",
        "exponent",
        "firmness",
        "is_estimated",
        "is_reference_early",
        "latest_early_ohm",
        "latest_ohm",
        "now_ns",
        "pressure_kpa",
        "reference_at_ua",
        "reference_ohm",
        "skin_at_ua",
        "skin_ohm",
        "state",
        "threshold_ua",
        "undelivered_ua",
    )

    def __init__(
        self,
        electrode: int,
        now_ns: int = 0,
        state: ContactState = "unknown",
        firmness: float = 1.0,
        undelivered_ua: int | None = None,
        skin_ohm: float | None = None,
        latest_ohm: float | None = None,
        skin_at_ua: int = 0,
        early_ohm: float | None = None,
        latest_early_ohm: float | None = None,
        is_estimated: bool = False,
        reference_ohm: int | None = None,
        reference_at_ua: int | None = None,
        is_reference_early: bool = False,
        threshold_ua: int | None = None,
        pressure_kpa: float | None = None,
        exponent: float | None = None,
    ) -> None:
        self.electrode: Final = electrode
        self.now_ns: Final = now_ns
        self.state: Final = state
        #: How far a contact that was made anew has come: 0 just now, 1 for long.
        self.firmness: Final = firmness
        #: The current of the last pulse that the source could not deliver, until one is delivered.
        self.undelivered_ua: Final = undelivered_ua
        self.skin_ohm: Final = skin_ohm
        self.latest_ohm: Final = latest_ohm
        self.skin_at_ua: Final = skin_at_ua
        #: The same as estimated from the beginning of pulses alone, filtered and of the last one;
        #: and whether `skin_ohm` is no more.
        self.early_ohm: Final = early_ohm
        self.latest_early_ohm: Final = latest_early_ohm
        self.is_estimated: Final = is_estimated
        #: From the calibration: resistance then, at which current, and where feeling begins.
        self.reference_ohm: Final = reference_ohm
        self.reference_at_ua: Final = reference_at_ua
        #: Whether it was made with pulses of which only the beginning is known.
        self.is_reference_early: Final = is_reference_early
        self.threshold_ua: Final = threshold_ua
        #: Of the sensor under this electrode.
        self.pressure_kpa: Final = pressure_kpa
        #: From the calibration: how far the person's thresholds follow the resistance.
        self.exponent: Final = exponent

    def higher_ohm(self) -> float | None:
        """Of `skin_ohm` and `latest_ohm`."""
        return higher(self.skin_ohm, self.latest_ohm)

    def higher_early_ohm(self) -> float | None:
        """Of `early_ohm` and `latest_early_ohm`."""
        return higher(self.early_ohm, self.latest_early_ohm)


def higher(mean_ohm: float | None, latest_ohm: float | None) -> float | None:
    """Of a mean and the last value, if there is one; None where there is no mean."""
    return mean_ohm if mean_ohm is None or latest_ohm is None else max(mean_ohm, latest_ohm)


class Stabilizer(Protocol):
    """A stabilizer. It keeps its own state between pulses, electrode by electrode."""

    @property
    def max_gain(self) -> MaxGain:
        """The most it can ever request: the plan keeps room for it, and no request goes beyond."""
        ...

    def adapt(self, request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        """The pulse that this stabilizer requests, given the request of the one before.

        When what it needs is not known, that is `request` itself; a rise to it may take time.
        """
        ...

    def reset(self) -> None:
        """The supply was off: any contact may have changed."""
        ...


def max_gain_of(stabilizers: Sequence[Stabilizer]) -> MaxGain:
    """The factors of all stabilizers together."""
    found = MaxGain()
    for stabilizer in stabilizers:
        found = found.then(stabilizer.max_gain)
    return found
