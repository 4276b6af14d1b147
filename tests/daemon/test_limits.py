"""A person's caps, and the last word on one pulse."""

from __future__ import annotations

from typing import Any

import msgspec
import pytest

from engine_parts import (
    array,
    board_file,
    body_site,
    calibration,
    maxima_with,
)
from etd.protocol.calibration import ElectrodeLimits
from etd.protocol.errors import Refused
from etd.protocol.messages import Limits
from etd.pulse.request import PulseBounds, PulseRequest
from etd.safety.limits import (
    Path,
    clamp_to_limits,
    limits_of_calibration,
    limits_of_numbers,
    path_of,
)
from etd.safety.maxima import maxima_of
from etd.stabilize.shape import Shape
from etd.stabilize.strength_duration import StrengthDuration
from plain_records import told

HIGH = 10_000


# --- a person's caps ------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "code", "said"),
    [
        ({"array": "grid-8x8"}, "bad_calibration", "array grid-8x8"),
        ({"body_site": "forearm"}, "bad_calibration", "body site forearm"),
        ({"width_us": 200, "rate_hz": 130.0}, "over_maximum", "130.0 Hz"),
    ],
)
def test_a_calibration_for_something_else_is_refused(
    changes: dict[str, Any], code: str, said: str
) -> None:
    maxima = maxima_of(board_file(), body_site())
    with pytest.raises(Refused, match=said) as refusal:
        limits_of_calibration(calibration(**changes), maxima, "grid-4x4", 16, "fingertip")
    assert refusal.value.code == code


def test_a_calibration_with_fewer_electrodes_is_refused() -> None:
    maxima = maxima_of(board_file(), body_site())
    with pytest.raises(Refused, match="number of electrodes 15") as refusal:
        limits_of_calibration(calibration(15), maxima, "grid-4x4", 16, "fingertip")
    assert refusal.value.code == "bad_calibration"


def test_a_calibration_wider_than_the_site_allows_is_refused() -> None:
    maxima = maxima_with(width_us=99)
    with pytest.raises(Refused, match="100 us"):
        limits_of_calibration(calibration(), maxima, "grid-4x4", 16, "fingertip")


def test_a_calibration_at_the_maxima_themselves_is_taken() -> None:
    maxima = maxima_with(current_ua=3_000, width_us=100, rate_hz=60, min_width_us=100)
    person = limits_of_calibration(calibration(), maxima, "grid-4x4", 16, "fingertip")
    assert (person.caps_ua, person.width_us) == ((3_000,) * 16, 100)


def test_an_electrode_may_be_comfortable_at_its_threshold_and_at_its_cap() -> None:
    """As one that stings before it is felt well."""
    alike = ElectrodeLimits(threshold_ua=700, comfortable_ua=700, cap_ua=700)
    person = limits_of_calibration(
        calibration(electrode=(alike,) * 16), maxima_with(), "grid-4x4", 16, "fingertip"
    )
    assert person.caps_ua == (700,) * 16


@pytest.mark.parametrize(
    ("changes", "min_width_us", "said"),
    [
        ({}, 101, "the calibration's 100 us is less than 101 us"),
        # Its pulses are fired narrower than they are asked for.
        (
            {"shape": Shape(strength_duration=StrengthDuration(width_us=60, tau_us=300.0))},
            61,
            "the calibration's 60 us is less than 61 us",
        ),
    ],
)
def test_a_calibration_with_pulses_that_this_machine_cannot_time_is_refused(
    changes: dict[str, Any], min_width_us: int, said: str
) -> None:
    maxima = maxima_with(min_width_us=min_width_us)
    with pytest.raises(Refused, match=said) as refusal:
        limits_of_calibration(calibration(**changes), maxima, "grid-4x4", 16, "fingertip")
    assert refusal.value.code == "board_cannot"


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"returns": ((1,),) * 15}, "P01.*returns"),
        (
            {
                "electrode": (
                    ElectrodeLimits(
                        threshold_ua=1_000, comfortable_ua=2_000, cap_ua=3_000, resistance_ohm=1
                    ),
                )
                * 16
            },
            r"P01.*electrode\[0\].resistance_ohm",
        ),
    ],
)
def test_a_calibration_that_no_file_could_have_held_is_refused(
    changes: dict[str, Any], said: str
) -> None:
    """It may come from a program, past the loader of files."""
    with pytest.raises(Refused, match=said) as refusal:
        limits_of_calibration(calibration(**changes), maxima_with(), "grid-4x4", 16, "fingertip")
    assert refusal.value.code == "bad_calibration"


@pytest.mark.parametrize(
    ("entry", "code"),
    [
        ((2_000, 1_000, 3_000), "bad_calibration"),
        ((1_000, 3_001, 3_000), "bad_calibration"),
        ((1_000, 2_000, 8_001), "over_maximum"),
    ],
)
def test_an_electrode_out_of_order_or_above_the_maximum_is_refused_by_number(
    entry: tuple[int, int, int], code: str
) -> None:
    threshold_ua, comfortable_ua, cap_ua = entry
    electrodes = list(calibration().electrode)
    electrodes[5] = ElectrodeLimits(
        threshold_ua=threshold_ua, comfortable_ua=comfortable_ua, cap_ua=cap_ua
    )
    maxima = maxima_of(board_file(), body_site())
    with pytest.raises(Refused) as refusal:
        limits_of_calibration(
            calibration(electrode=tuple(electrodes)), maxima, "grid-4x4", 16, "fingertip"
        )
    assert refusal.value.code == code
    assert refusal.value.electrode == 5


def test_a_calibration_gives_each_electrode_its_own_cap() -> None:
    electrodes = [
        ElectrodeLimits(threshold_ua=1, comfortable_ua=2, cap_ua=100 + electrode)
        for electrode in range(16)
    ]
    person = limits_of_calibration(
        calibration(electrode=tuple(electrodes)),
        maxima_of(board_file(), body_site()),
        array().name,
        16,
        "fingertip",
    )
    assert person.caps_ua == tuple(range(100, 116))
    assert (person.width_us, person.accepted_us) == (200, 100)
    assert person.calibration is not None


def test_numbers_cap_all_electrodes_alike() -> None:
    person = limits_of_numbers(Limits(max_current_ua=3_000, width_us=150), maxima_with(), 4)
    assert person.caps_ua == (3_000,) * 4
    assert person.width_us == 150
    assert person.accepted_us == 150
    assert person.calibration is None


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        (Limits(max_current_ua=3_001, width_us=100), "3001.*3000"),
        (Limits(max_current_ua=1_000, width_us=200), "200.*150"),
    ],
)
def test_numbers_above_what_the_uncalibrated_get_are_refused(limits: Limits, said: str) -> None:
    with pytest.raises(Refused, match=said) as refusal:
        limits_of_numbers(limits, maxima_with(width_us=150), 4)
    assert refusal.value.code == "over_maximum"


def test_numbers_at_the_maxima_themselves_are_taken_and_narrower_ones_refused() -> None:
    maxima = maxima_with(width_us=60, min_width_us=60)
    assert limits_of_numbers(Limits(max_current_ua=3_000, width_us=60), maxima, 4).width_us == 60
    with pytest.raises(Refused, match=r"^width_us 59 us is less than 60") as refusal:
        limits_of_numbers(Limits(max_current_ua=3_000, width_us=59), maxima, 4)
    assert refusal.value.code == "board_cannot"


# --- the last word --------------------------------------------------------------------------------


def path(cap_ua: int = HIGH, return_ua: float = HIGH) -> Path:
    return Path(3, cap_ua, return_ua, 9)


def test_a_path_is_as_weak_as_its_weakest_return() -> None:
    found = path_of(0, (5_000, 4_000, 900, 1_000), (1, 2, 3))
    assert told(found) == told(Path(0, 5_000, 900, 2))
    assert told(found.with_returns(1_200.5, 3)) == told(Path(0, 5_000, 1_200.5, 3))


def test_a_path_for_another_polarity_has_that_polaritys_cap_and_the_same_returns() -> None:
    found = path(1_000, 800.5)
    assert told(found.with_cap(600)) == told(Path(3, 600, 800.5, 9))
    assert found.with_cap(1_000) is found


def test_what_is_within_all_bounds_passes_as_it_is() -> None:
    assert clamp_to_limits(path(), PulseRequest(2_000, 100), maxima_with(), 8_000, None, False) == (
        2_000,
        None,
    )


def test_exactly_the_bound_is_no_clamp() -> None:
    assert clamp_to_limits(
        path(cap_ua=900), PulseRequest(900, 100), maxima_with(), HIGH, None, False
    ) == (
        900,
        None,
    )


@pytest.mark.parametrize(
    ("changes", "allowed_ua", "reason", "limited_by"),
    [
        ({"path": path(cap_ua=900)}, 900, "cap", 3),
        ({"path": path(return_ua=800.0)}, 800, "return_cap", 9),
        ({"request": PulseRequest(4_000, 200)}, 2_500, "charge", 3),
        ({"soft_start_ua": 700}, 700, "soft_start", 3),
        ({"recontact_ua": 600}, 600, "recontact", 3),
        ({"is_open": True}, 300, "contact_open", 3),
        ({"felt_ua": 500}, 500, "felt", 3),
    ],
)
def test_the_smallest_bound_wins_and_says_whose_it_is(
    changes: dict[str, object], allowed_ua: int, reason: str, limited_by: int
) -> None:
    asked: dict[str, object] = {
        "path": path(),
        "request": PulseRequest(4_000, 100),
        "maxima": maxima_with(),
        "soft_start_ua": HIGH,
        "recontact_ua": None,
        "is_open": False,
        **changes,
    }
    got, clamp = clamp_to_limits(**asked)  # type: ignore[arg-type]
    assert got == allowed_ua
    assert clamp is not None
    assert msgspec.structs.astuple(clamp) == (3, 4_000, allowed_ua, reason, limited_by, None)


def test_of_several_bounds_the_smallest_is_named() -> None:
    got, clamp = clamp_to_limits(
        path(cap_ua=900, return_ua=500.0), PulseRequest(4_000, 200), maxima_with(), 450, 440, True
    )
    assert got == 300
    assert clamp is not None
    assert clamp.reason == "contact_open"


def test_no_bound_that_is_higher_raises_one_that_is_lower() -> None:
    """Nothing after the cap makes more of a pulse."""
    found = clamp_to_limits(
        path(cap_ua=200, return_ua=210.0),
        PulseRequest(4_000, 100),
        maxima_with(probe_current_ua=300),
        soft_start_ua=HIGH,
        recontact_ua=HIGH,
        is_open=True,
        bounds=PulseBounds(current_ua=HIGH, cap_us=100, width_us=100, charge_pc=HIGH * 100),
        felt_ua=HIGH,
    )
    assert found[0] == 200
    assert found[1] is not None
    assert found[1].reason == "cap"


ORDER = ["cap", "return_cap", "charge", "soft_start", "frame", "recontact", "contact_open", "felt"]


@pytest.mark.parametrize("first", ORDER)
def test_of_equal_bounds_the_first_in_the_order_of_a_persons_own_is_named(first: str) -> None:
    """So the same pulse is always reported the same way."""
    at_ua = {reason: 300 if ORDER.index(reason) >= ORDER.index(first) else HIGH for reason in ORDER}
    _, clamp = clamp_to_limits(
        path(at_ua["cap"], float(at_ua["return_cap"])),
        PulseRequest(4_000, 100),
        maxima_with(charge_pc=at_ua["charge"] * 100, probe_current_ua=at_ua["contact_open"]),
        at_ua["soft_start"],
        at_ua["recontact"],
        True,
        PulseBounds(at_ua["frame"], cap_us=100, width_us=100, charge_pc=HIGH * 100),
        felt_ua=at_ua["felt"],
    )
    assert clamp is not None
    assert (clamp.allowed_ua, clamp.reason) == (300, first)


def test_the_charge_of_the_probe_before_counts_to_that_of_the_pulse() -> None:
    """500 nC at the most, 15 of which the probe has."""
    found = clamp_to_limits(
        path(), PulseRequest(4_000, 200), maxima_with(), HIGH, None, False, before_pc=15_000
    )
    assert found[0] == 2_425


#: A frame of 2 mA for 100 us, and caps that were accepted at that width.
FRAME = PulseBounds(current_ua=2_000, cap_us=100, width_us=200, charge_pc=200_000)


@pytest.mark.parametrize(
    ("cap_ua", "request_", "allowed_ua", "reason"),
    [
        (HIGH, PulseRequest(3_000, 50), 2_000, "frame"),
        (HIGH, PulseRequest(2_000, 160), 1_250, "frame"),
        # Of the 1,333.3 uA that have its charge no part of one more.
        (HIGH, PulseRequest(2_000, 150), 1_333, "frame"),
        (1_000, PulseRequest(2_000, 100), 1_000, "cap"),
        (1_000, PulseRequest(2_000, 160), 625, "cap"),
        # No wider, but with a prepulse that was not there when the cap was accepted.
        (1_000, PulseRequest(2_000, 100, 1_000, 50), 800, "cap"),
    ],
)
def test_a_stabilizers_pulse_has_no_more_current_and_no_more_charge_than_its_frame_and_its_cap(
    cap_ua: int, request_: PulseRequest, allowed_ua: int, reason: str
) -> None:
    got, clamp = clamp_to_limits(path(cap_ua), request_, maxima_with(), HIGH, None, False, FRAME)
    assert got == allowed_ua
    assert clamp is not None
    assert clamp.reason == reason


def test_a_wider_pulse_of_a_stabilizer_gets_no_more_charge_through_a_return_either() -> None:
    found = clamp_to_limits(
        path(return_ua=1_000.0), PulseRequest(2_000, 160), maxima_with(), HIGH, None, False, FRAME
    )
    assert found[0] == 625


def test_what_its_returns_allow_is_rounded_down() -> None:
    for return_ua, allowed_ua in ((97.9, 97), (97.0, 97), (1e6, HIGH)):
        found = clamp_to_limits(
            path(return_ua=return_ua), PulseRequest(HIGH, 20), maxima_with(), HIGH, None, False
        )
        assert found[0] == allowed_ua
