"""The living body: what is felt, what hurts, and that it conducts as the minimal body does."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

from etd_body.course import STILL, Script
from etd_body.electrode import OPEN_CONTACT, skin
from etd_body.interface import Body, Side, Sides
from etd_body.living import LivingBody
from etd_body.mesh import Gel
from etd_body.minimal import MinimalBody
from etd_body.skin import SkinFigures, ease

pytestmark = pytest.mark.slow

US, MS = 1_000, 1_000_000
LEAK_OHM = 66_000
PITCH_MM = 2.5
SIDE = 4
COUNT = SIDE * SIDE
PLACES = [(PITCH_MM * (i % SIDE), PITCH_MM * (i // SIDE)) for i in range(COUNT)]
MIDDLE = 5
DRY = SkinFigures()


def living(
    script: Script = STILL,
    figures: SkinFigures = DRY,
    *,
    seed: int = 7,
) -> LivingBody:
    return LivingBody(
        PLACES,
        leak_ohm=LEAK_OHM,
        compliance_v=300.0,
        seed=seed,
        script=script,
        figures=figures,
    )


def alone(electrode: int, direction: Side = Side.SOURCE) -> Sides:
    other = Side.GROUND if direction is Side.SOURCE else Side.SOURCE
    return tuple(direction if index == electrode else other for index in range(COUNT))


GROUNDED: Sides = (Side.GROUND,) * COUNT


def pulse(
    body: LivingBody,
    t_ns: int,
    current_ua: float,
    width_us: int,
    electrode: int = MIDDLE,
    direction: Side = Side.SOURCE,
) -> None:
    body.drive(t_ns, current_ua, alone(electrode, direction))
    body.drive(t_ns + width_us * US, 0, alone(electrode, direction))
    body.drive(t_ns + (width_us + 2) * US, 0, GROUNDED)


def test_the_living_body_is_a_body() -> None:
    body: Body = living()
    assert body.electrode_count == COUNT


@pytest.mark.parametrize("direction", [Side.SOURCE, Side.GROUND])
@pytest.mark.parametrize("width_us", [20, 50, 100, 200])
def test_the_told_threshold_is_where_feeling_begins(direction: Side, width_us: int) -> None:
    body = living()
    polarity = "anodic" if direction is Side.SOURCE else "cathodic"
    commanded_ua = body.commanded_threshold_ua(MIDDLE, width_us, polarity)  # type: ignore[arg-type]
    pulse(body, 1 * MS, commanded_ua * 0.99, width_us, direction=direction)
    assert body.take_felt().felt[MIDDLE] == 0.0
    pulse(body, 50 * MS, commanded_ua * 1.01, width_us, direction=direction)
    assert body.take_felt().felt[MIDDLE] == pytest.approx(1.0, abs=0.03)


def test_the_told_pain_threshold_is_where_it_begins_to_hurt() -> None:
    body = living()
    commanded_ua = body.commanded_pain_threshold_ua(MIDDLE, 100)
    pulse(body, 1 * MS, commanded_ua * 0.99, 100)
    assert body.take_felt().pain[MIDDLE] < 1.0
    pulse(body, 50 * MS, commanded_ua * 1.01, 100)
    assert body.take_felt().pain[MIDDLE] >= 1.0


@pytest.mark.parametrize("electrode", [0, MIDDLE])
@pytest.mark.parametrize("times", [1.2, 2.0])
def test_so_many_times_the_threshold_is_felt_alike_everywhere(electrode: int, times: float) -> None:
    body = living()
    commanded_ua = body.commanded_threshold_ua(electrode, 100, times=times)
    assert body.times_threshold(electrode, commanded_ua, 100) == pytest.approx(times, rel=0.001)

    pulse(body, 1 * MS, commanded_ua, 100, electrode)
    assert body.take_felt().felt[electrode] == pytest.approx(times**1.2, rel=0.01)


def test_without_contact_nothing_is_any_times_its_threshold() -> None:
    body = living()
    body.touch(1 * MS, MIDDLE, OPEN_CONTACT)
    assert body.times_threshold(MIDDLE, 3_000, 100) == 0.0


def test_taking_starts_anew() -> None:
    body = living()
    pulse(body, 1 * MS, 4_000, 100)
    assert max(body.take_felt().felt) > 1.0
    assert max(body.take_felt().felt) == 0.0


def test_cathodic_pulses_need_about_a_third_more_current() -> None:
    """Kaczmarek et al. 2000: 1.3 to 1.5 times."""
    body = living()
    ratios = [
        body.commanded_threshold_ua(electrode, 100, "cathodic")
        / body.commanded_threshold_ua(electrode, 100)
        for electrode in range(COUNT)
    ]
    assert 1.15 < np.median(ratios) < 1.6


def test_threshold_and_pain_move_apart_as_pulses_grow_narrower() -> None:
    """Kajimoto, Electro-tactile Display, section 2.2.1 and 4.2; without heat, for the nerves."""
    nerves = living().sensation

    def gap(width_us: int) -> float:
        touch_ua = [nerves.true_threshold_ua(electrode, width_us) for electrode in range(COUNT)]
        pain_ua = [nerves.pain_threshold_ua(electrode, width_us) for electrode in range(COUNT)]
        return float(np.median(np.array(pain_ua) / touch_ua))

    gaps = [gap(width_us) for width_us in (200, 100, 50, 20)]
    assert all(later > earlier * 1.03 for earlier, later in pairwise(gaps))


def test_thresholds_lie_where_the_paper_has_them() -> None:
    """1 to 10 mA at 50 to 200 us under electrodes of 1 mm (section 2.2.2)."""
    body = living()
    for width_us in (50, 100):
        middling_ua = np.median(
            [body.commanded_threshold_ua(electrode, width_us) for electrode in range(COUNT)]
        )
        assert 1_000 < middling_ua < 3_000


def test_electrodes_differ_and_seeds_do_too() -> None:
    bodies = (living(seed=1), living(seed=2))
    thresholds = [
        body.commanded_threshold_ua(electrode, 100) for body in bodies for electrode in (0, 9)
    ]
    assert len(set(thresholds)) == 4
    assert living(seed=1).commanded_threshold_ua(0, 100) == thresholds[0]


def test_a_burst_of_six_is_felt_about_twice_as_strong_as_one_pulse() -> None:
    """Kaczmarek, Webster, Radwin 1992: at 350 Hz."""
    body = living()
    commanded_ua = 2.0 * body.commanded_threshold_ua(MIDDLE, 100)
    pulse(body, 1_000 * MS, commanded_ua, 100)
    single = body.take_felt().felt[MIDDLE]
    for number in range(6):
        pulse(body, 3_000 * MS + number * 2_857 * US, commanded_ua, 100)
    burst = body.take_felt().felt[MIDDLE]
    assert (burst - 1.0) / (single - 1.0) == pytest.approx(2.0, rel=0.1)


def test_a_lower_rate_is_never_felt_or_hurts_more() -> None:
    """What a level frame at a lower rate than calibrated rests on (decision 0060)."""
    found = []
    for rate_hz in (200, 100, 60, 30, 10, 3):
        body = living()
        current_ua = 1.8 * body.commanded_threshold_ua(MIDDLE, 100)
        for number in range(rate_hz // 2):
            pulse(body, number * 1_000 * MS // rate_hz, current_ua, 100)
        felt = body.take_felt()
        found.append((felt.felt[MIDDLE], felt.pain[MIDDLE]))
    for (faster_felt, faster_pain), (felt_of_it, pain_of_it) in pairwise(found):
        assert 1.0 < felt_of_it <= faster_felt
        assert pain_of_it <= faster_pain * 1.001
    assert found[-1][0] < 0.8 * found[0][0]


def test_no_rate_makes_a_pulse_below_threshold_felt() -> None:
    body = living()
    commanded_ua = 0.97 * body.commanded_threshold_ua(MIDDLE, 100)
    for number in range(100):
        pulse(body, (10 + 5 * number) * MS, commanded_ua, 100)
    assert body.take_felt().felt[MIDDLE] == 0.0


def test_sensation_stays_under_the_electrode() -> None:
    body = living()
    pulse(body, 1 * MS, 1.5 * body.commanded_threshold_ua(MIDDLE, 100), 100)
    felt = body.take_felt().felt
    assert [electrode for electrode in range(COUNT) if felt[electrode] > 0.0] == [MIDDLE]


def test_a_still_skin_conducts_as_the_minimal_body_with_its_resistances_does() -> None:
    """At a current where its resistances are known: then nothing but the nerves is different."""
    body = living()
    current_ua, width_us = 2_000.0, 100
    body.drive(0, 0, alone(MIDDLE))
    body.drive(1 * MS, current_ua, alone(MIDDLE))
    voltage_v = body.node_voltage_v(1 * MS + width_us * US)
    body.drive(1 * MS + width_us * US, 0, alone(MIDDLE))
    passing_ua = body.charge_pc(MIDDLE) / width_us

    def contact_at(electrode: int, ua: float) -> tuple[float, float, float]:
        found = body.contact(electrode)
        return found.series_ohm, found.parallel_ohm * ease(ua), found.capacitance_nf

    contacts = [
        skin(*contact_at(electrode, passing_ua if electrode == MIDDLE else 1_000.0 / (COUNT - 1)))
        for electrode in range(COUNT)
    ]
    plain = MinimalBody(contacts, leak_ohm=LEAK_OHM, compliance_v=300.0)
    plain.drive(0, current_ua, alone(MIDDLE))
    assert plain.node_voltage_v(width_us * US) == pytest.approx(voltage_v, rel=0.01)
    assert plain.charge_pc(MIDDLE) == pytest.approx(body.charge_pc(MIDDLE), rel=0.01)


def test_charge_into_the_skin_comes_out_of_it() -> None:
    body = living(Script(sweat=0.3, pressing=0.4, peels_per_min=20))
    for number in range(200):
        pulse(body, (1 + 17 * number) * MS, 2_000, 100, electrode=number % COUNT)
    charges = [body.charge_pc(electrode) for electrode in range(COUNT)]
    assert sum(charges) == pytest.approx(0.0, abs=1e-6 * sum(map(abs, charges)))
    assert body.absolute_charge_pc(3) > abs(body.charge_pc(3))


def test_a_higher_current_meets_less_resistance() -> None:
    body = living()
    assert body.resistance_ohm(MIDDLE, 500) > 1.2 * body.resistance_ohm(MIDDLE, 8_000)


def test_sweat_lowers_resistance_within_minutes_and_feeling_with_it() -> None:
    body = living(Script(sweat=0.35))
    body.look_at(1)
    dry_ohm, dry_ua = body.contact(MIDDLE).resistance_ohm, body.commanded_threshold_ua(MIDDLE, 100)
    body.look_at(180_000 * MS)
    assert 0.5 < body.contact(MIDDLE).resistance_ohm / dry_ohm < 0.85
    assert body.commanded_threshold_ua(MIDDLE, 100) > 1.1 * dry_ua


def test_what_is_lifted_gets_nothing_and_feels_nothing() -> None:
    body = living()
    body.touch(1 * MS, MIDDLE, OPEN_CONTACT)
    body.drive(2 * MS, 2_000, alone(MIDDLE))
    assert body.node_voltage_v(2 * MS + 50 * US) == pytest.approx(132.0)
    body.drive(2 * MS + 50 * US, 0, GROUNDED)
    assert body.charge_pc(MIDDLE) == 0.0
    assert max(body.take_felt().felt) == 0.0
    assert body.commanded_threshold_ua(MIDDLE, 100) == float("inf")


def test_a_shrinking_contact_hurts_before_it_is_felt_less() -> None:
    body = living()
    ratio = body.commanded_pain_threshold_ua(MIDDLE, 100) / body.commanded_threshold_ua(MIDDLE, 100)
    small = skin(2_000 / 0.12, 48_000 / 0.12, 0.3 * 0.12)
    body.touch(1 * MS, MIDDLE, small)
    shrunk = body.commanded_pain_threshold_ua(MIDDLE, 100) / body.commanded_threshold_ua(
        MIDDLE, 100
    )
    assert shrunk < 0.85 * ratio


def test_paste_between_neighbors_takes_the_current_past_the_skin() -> None:
    """Kajimoto, Electro-tactile Display, section 3.3."""
    dry = living().commanded_threshold_ua(MIDDLE, 100)
    pasted = living(figures=SkinFigures(paste_bridge_ohm=5_000)).commanded_threshold_ua(MIDDLE, 100)
    assert pasted > 5 * dry


def test_paste_reaches_ground_through_an_electrode_that_floats() -> None:
    """The neighbors float: the way past the skin leads through two films."""
    body = living(figures=SkinFigures(paste_bridge_ohm=5_000))
    around = {MIDDLE - 1, MIDDLE + 1, MIDDLE - SIDE, MIDDLE + SIDE}

    def volts(floating: set[int]) -> float:
        sides = tuple(
            Side.OPEN if electrode in floating else side
            for electrode, side in enumerate(alone(MIDDLE))
        )
        body.drive(volts.at_ns, 1_000, sides)  # type: ignore[attr-defined]
        found = body.node_voltage_v(volts.at_ns + 50 * US)  # type: ignore[attr-defined]
        body.drive(volts.at_ns + 60 * US, 0, GROUNDED)  # type: ignore[attr-defined]
        volts.at_ns += 10 * MS  # type: ignore[attr-defined]
        return found

    volts.at_ns = 1 * MS  # type: ignore[attr-defined]
    through_one, through_two = volts(set()), volts(around)
    assert through_one == pytest.approx(1.19, abs=0.1)
    # Two films in series, the second of which is three beside one another, and skin beside it.
    assert 1.2 * through_one < through_two < 2.5 * through_one


def test_a_gel_as_conductive_as_skin_costs_current_and_still_lets_feel() -> None:
    bare = living().commanded_threshold_ua(MIDDLE, 100)
    gel = SkinFigures(gel=Gel(thickness_mm=0.5, resistivity_ohm_m=50.0))
    through_gel = living(figures=gel).commanded_threshold_ua(MIDDLE, 100)
    assert 1.05 * bare < through_gel < 5 * bare


def test_time_that_goes_back_is_refused() -> None:
    body = living()
    body.drive(5 * MS, 0, GROUNDED)
    with pytest.raises(ValueError, match="time went back"):
        body.drive(4 * MS, 0, GROUNDED)


def test_importing_what_a_real_board_needs_leaves_numpy_out() -> None:
    code = (
        "import sys, etd_hal.compose, etd_hal.fake.fingertip, etd.engine.process, etd.cli.run;"
        "print('numpy' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
