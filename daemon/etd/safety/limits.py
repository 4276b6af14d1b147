"""What this person may get, and this pulse: pure rules, read in one sitting.

Owns: the caps of a person, and the clamp of each pulse. Must not know: time, hardware, sockets, how
a request came about, what the maxima are made of (`maxima.py`).

Two tiers. A frame that asks for more than a *maximum* is refused as a whole. A *limit* belongs to
an electrode of a person: a request for more is clamped, and the clamp is reported. Nothing after
this module may increase anything.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from etd.protocol.calibration import Calibration, check_order
from etd.protocol.calibration_set import check_together
from etd.protocol.errors import FileError, Refused
from etd.protocol.frame import Polarity
from etd.protocol.messages import Limits
from etd.protocol.outcome import Clamp, ClampReason
from etd.pulse.request import PulseBounds, PulseRequest
from etd.safety.maxima import Maxima


@dataclass(frozen=True, slots=True)
class PersonLimits:
    """One person's caps, by electrode, and the conditions they were found under.

    No pulse is wider than `width_us`. The caps were accepted at the width `accepted_us`: a wider
    pulse is allowed no more charge.

    `others` are the person's calibrations for other polarities, with the same conditions. Then
    `caps_ua` has the smallest of each electrode's caps, for returns and probes, whose polarity is
    not that of a calibrated pulse.
    """

    caps_ua: tuple[int, ...]
    width_us: int
    accepted_us: int
    calibration: Calibration | None
    others: tuple[Calibration, ...] = ()

    @property
    def calibrations(self) -> tuple[Calibration, ...]:
        """All; the first one's polarity is that of frames that name none."""
        return () if self.calibration is None else (self.calibration, *self.others)

    @property
    def own_caps_ua(self) -> dict[Polarity, tuple[int, ...]]:
        """The caps of stimulated electrodes by polarity. Empty where `caps_ua` hold for all."""
        if not self.others:
            return {}
        return {it.polarity: _caps_ua(it) for it in self.calibrations}


def limits_of_calibrations(
    calibrations: Sequence[Calibration], maxima: Maxima, array: str, electrodes: int, site: str
) -> PersonLimits:
    """A person's caps from one calibration, or from several that differ in polarity.

    Raises: Refused (`bad_calibration`, `over_maximum`, `board_cannot`).
    """
    check_together(calibrations)
    each = [
        limits_of_calibration(calibration, maxima, array, electrodes, site)
        for calibration in calibrations
    ]
    smallest_ua = tuple(map(min, zip(*(one.caps_ua for one in each), strict=True)))
    first, others = each[0], tuple(calibrations[1:])
    return PersonLimits(smallest_ua, first.width_us, first.accepted_us, calibrations[0], others)


def limits_of_calibration(
    calibration: Calibration, maxima: Maxima, array: str, electrodes: int, site: str
) -> PersonLimits:
    """A person's caps from a calibration, checked against array, site and maxima.

    Raises: Refused (`bad_calibration`, `over_maximum`, `board_cannot`).
    """
    for what, is_made_for, here in (
        ("array", calibration.array, array),
        ("body site", calibration.body_site, site),
        ("number of electrodes", str(len(calibration.electrode)), str(electrodes)),
    ):
        if is_made_for != here:
            raise Refused(
                "bad_calibration",
                f"the calibration of {calibration.participant} was made for {what} {is_made_for},"
                f" here it is {here}: calibrate anew",
            )
    if calibration.width_us > maxima.width_us or calibration.rate_hz > maxima.rate_hz:
        raise Refused(
            "over_maximum",
            f"the calibration's {calibration.width_us} us at {calibration.rate_hz} Hz is more than"
            f" {maxima.width_us} us at {maxima.rate_hz} Hz allowed here",
        )
    fired = calibration.shape.of(PulseRequest(maxima.probe_current_ua, calibration.width_us))
    _check_narrowest("the calibration's", fired.width_us, maxima)
    for electrode, limits in enumerate(calibration.electrode):
        if not limits.threshold_ua <= limits.comfortable_ua <= limits.cap_ua:
            raise Refused(
                "bad_calibration",
                f"electrode {electrode}: threshold, comfortable and cap do not rise",
                electrode,
            )
        if limits.cap_ua > maxima.current_ua:
            raise Refused(
                "over_maximum",
                f"electrode {electrode} has a cap of {limits.cap_ua} uA, more than the maximum"
                f" here, {maxima.current_ua} uA",
                electrode,
            )
    try:
        check_order(calibration, f"the calibration of {calibration.participant}")
    except FileError as error:
        raise Refused("bad_calibration", str(error)) from error
    caps_ua = _caps_ua(calibration)
    return PersonLimits(caps_ua, maxima.width_us, calibration.width_us, calibration)


def _caps_ua(calibration: Calibration) -> tuple[int, ...]:
    return tuple(limits.cap_ua for limits in calibration.electrode)


def limits_of_numbers(limits: Limits, maxima: Maxima, electrodes: int) -> PersonLimits:
    """The same cap for all, from a client that has no calibration.

    Raises: Refused (`over_maximum`, `board_cannot`).
    """
    if limits.max_current_ua > maxima.uncalibrated_current_ua:
        raise Refused(
            "over_maximum",
            f"max_current_ua {limits.max_current_ua} is more than the"
            f" {maxima.uncalibrated_current_ua} uA allowed without a calibration: calibrate, or"
            " ask for less",
        )
    if limits.width_us > maxima.width_us:
        raise Refused(
            "over_maximum", f"width_us {limits.width_us} is more than {maxima.width_us} here"
        )
    _check_narrowest("width_us", limits.width_us, maxima)
    caps_ua = (limits.max_current_ua,) * electrodes
    return PersonLimits(caps_ua, limits.width_us, limits.width_us, None)


def _check_narrowest(what: str, width_us: int, maxima: Maxima) -> None:
    if width_us < maxima.min_width_us:
        raise Refused(
            "board_cannot",
            f"{what} {width_us} us is less than {maxima.min_width_us} us, which one word takes on"
            " this machine",
        )


class Path:
    """The caps in the way of one electrode's current, those of its returns included.

    `return_ua` is the current at which the first return may reach its cap, and `return_electrode`
    that return.
    """

    __slots__ = ("cap_ua", "electrode", "return_electrode", "return_ua")

    def __init__(
        self, electrode: int, cap_ua: int, return_ua: float, return_electrode: int
    ) -> None:
        self.electrode: Final = electrode
        self.cap_ua: Final = cap_ua
        self.return_ua: Final = return_ua
        self.return_electrode: Final = return_electrode

    def with_returns(self, return_ua: float, return_electrode: int) -> Path:
        """The same path, with the returns as they are known now."""
        return Path(self.electrode, self.cap_ua, return_ua, return_electrode)

    def with_cap(self, cap_ua: int) -> Path:
        """The same path, with the electrode's own cap for another polarity."""
        if cap_ua == self.cap_ua:
            return self
        return Path(self.electrode, cap_ua, self.return_ua, self.return_electrode)


def path_of(electrode: int, caps_ua: Sequence[int], returns: Sequence[int]) -> Path:
    """The electrode's own cap, and the smallest of its returns: each may carry all of it."""
    smallest = min(returns, key=lambda electrode: caps_ua[electrode])
    return Path(electrode, caps_ua[electrode], caps_ua[smallest], smallest)


def clamp_to_limits(
    path: Path,
    request: PulseRequest,
    maxima: Maxima,
    soft_start_ua: int,
    recontact_ua: int | None,
    is_open: bool,
    bounds: PulseBounds | None = None,
    before_pc: int = 0,
    felt_ua: int | None = None,
) -> tuple[int, Clamp | None]:
    """The allowed current of a request, in uA, and the clamp to report, if any.

    The smallest bound wins and is named. `soft_start_ua` is the array's ceiling now, `recontact_ua`
    the electrode's own after a re-contact (None: none), `is_open` that nothing touches it. `bounds`
    are the frame's own, for requests of stabilizers. `before_pc` is the charge of the probe that
    goes before. `felt_ua`: what is left of it since the person said that it is too strong (None:
    nobody said so). A prepulse falls with its pulse, and its charge counts.
    """
    reason: ClampReason = "cap"
    cap_ua = float(path.cap_ua)
    if path.return_ua < cap_ua:
        cap_ua, reason = path.return_ua, "return_cap"
    bound_ua = _within_cap(cap_ua, request, bounds)
    charge_ua = request.current_of(maxima.charge_pc - before_pc)
    if charge_ua < bound_ua:
        bound_ua, reason = charge_ua, "charge"
    if soft_start_ua < bound_ua:
        bound_ua, reason = soft_start_ua, "soft_start"
    if bounds is not None:
        frame_ua = min(bounds.current_ua, bounds.charge_pc // request.width_us)
        if frame_ua < bound_ua:
            bound_ua, reason = frame_ua, "frame"
    if recontact_ua is not None and recontact_ua < bound_ua:
        bound_ua, reason = recontact_ua, "recontact"
    if is_open and maxima.probe_current_ua < bound_ua:
        bound_ua, reason = maxima.probe_current_ua, "contact_open"
    if felt_ua is not None and felt_ua < bound_ua:
        bound_ua, reason = felt_ua, "felt"
    if request.current_ua <= bound_ua:
        return request.current_ua, None
    clamp = Clamp(
        electrode=path.electrode,
        wanted_ua=request.current_ua,
        allowed_ua=bound_ua,
        reason=reason,
        limited_by=path.return_electrode if reason == "return_cap" else path.electrode,
    )
    return bound_ua, clamp


def _within_cap(cap_ua: float, request: PulseRequest, bounds: PulseBounds | None) -> int:
    """A cap bounds the current, and the charge that this current has in the frame's own pulses, or
    in those that the cap was accepted with. A wider pulse, or one with a prepulse that was not
    there then, gets no more charge.
    """
    if bounds is None:
        return int(cap_ua)
    return min(int(cap_ua), request.current_of(bounds.capped_pc(cap_ua)))
