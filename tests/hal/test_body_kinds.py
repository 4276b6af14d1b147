"""The kinds of body: each does what it is named for, and no more than it; today's is untouched."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from itertools import pairwise
from math import inf
from pathlib import Path

import numpy as np
import pytest

from etd.pulse.measured import BEND_UA
from etd_body.course import BUSY, LYING, STILL, Script
from etd_body.electrode import DRY_CAPACITANCE_NF, DRY_PARALLEL_OHM, DRY_SERIES_OHM
from etd_body.interface import Side
from etd_body.kinds import BodyFigures, BodyKind, BodyRanges, Span, drawn, living
from etd_body.living import LivingBody
from etd_body.nerve import TOUCH_ROWS, Nerves, NerveSpread
from etd_body.shifts import UNSHIFTED, FeelingFigures, Shifts
from etd_body.skin import SkinFigures

pytestmark = pytest.mark.slow

SEEDS = range(40, 46)
COUNT = 8
PLACES = [(2.5 * (electrode % 4), 2.5 * (electrode // 4)) for electrode in range(COUNT)]
MINUTE_NS, MS, US = 60_000_000_000, 1_000_000, 1_000
GROUNDED = (Side.GROUND,) * COUNT
ALONE = [
    tuple(Side.SOURCE if other == electrode else Side.GROUND for other in range(COUNT))
    for electrode in range(COUNT)
]
#: Sweat alone.
WET = Script(sweat=0.35, sweat_tau_s=60.0)
WIDTH_US = 100
#: Thresholds in uA, felt, pain, of three electrodes.
RECORDED = (
    1080.7228088378906,
    981.1592102050781,
    860.4240417480469,
    2.8108504584601355,
    3.1851430425881486,
    3.7529229871553618,
    0.5502885580062866,
    0.7085331678390503,
    0.6899971262370023,
)


def body_of(kind: BodyKind, seed: int = 40, doing: Script = STILL) -> LivingBody:
    body = living(kind, PLACES, leak_ohm=1e9, compliance_v=1e4, seed=seed, doing=doing)
    body.look_at(0)
    return body


def default() -> LivingBody:
    return LivingBody(PLACES, leak_ohm=66_000, compliance_v=300.0, seed=7, script=BUSY)


def thresholds_ua(body: LivingBody) -> np.ndarray:
    return np.array([body.commanded_threshold_ua(each, WIDTH_US) for each in range(COUNT)])


def resistances_ohm(body: LivingBody) -> np.ndarray:
    return np.array([body.resistance_ohm(each, 2_000) for each in range(COUNT)])


def pulse(body: LivingBody, t_ns: int, electrode: int, current_ua: float) -> None:
    body.drive(t_ns, current_ua, ALONE[electrode])
    body.drive(t_ns + WIDTH_US * US, 0.0, ALONE[electrode])


def test_the_body_without_a_kind_is_what_it_was() -> None:
    """Values of before there were kinds."""
    body = default()
    body.look_at(0)
    dry_ua = thresholds_ua(body)
    for visit in range(400):
        pulse(body, (visit + 1) * 30 * MS, visit % COUNT, 2_500.0)
    felt, pain = body.take_felt()
    assert [*dry_ua[:3], *felt[:3], *pain[:3]] == pytest.approx(RECORDED, rel=1e-9)


def test_what_has_no_figures_of_feeling_shifts_nothing() -> None:
    plain = default()
    other = LivingBody(
        PLACES, leak_ohm=66_000, compliance_v=300.0, seed=7, script=BUSY,
        figures=SkinFigures(), spread=NerveSpread(), feeling=UNSHIFTED,
    )  # fmt: skip
    for body in (plain, other):
        for visit in range(40):
            pulse(body, (visit + 1) * 30 * MS, visit % COUNT, 2_500.0)
    assert plain.take_felt() == other.take_felt()


@pytest.mark.parametrize("kind", BodyKind)
def test_a_finger_is_a_pure_function_of_kind_and_seed(kind: BodyKind) -> None:
    assert drawn(kind, 40, doing=BUSY) == drawn(kind, 40, doing=BUSY)
    assert drawn(kind, 40, doing=BUSY) != drawn(kind, 41, doing=BUSY)


@pytest.mark.parametrize("kind", BodyKind)
@pytest.mark.parametrize("seed", SEEDS)
def test_no_finger_has_the_constants_of_the_laws(kind: BodyKind, seed: int) -> None:
    found = drawn(kind, seed, doing=LYING).skin
    of_laws = (DRY_SERIES_OHM, DRY_PARALLEL_OHM, DRY_CAPACITANCE_NF, BEND_UA)
    drawn_figures = (found.series_ohm, found.parallel_ohm, found.capacitance_nf, found.bend_ua)
    for figure, constant in zip(drawn_figures, of_laws, strict=True):
        assert figure != pytest.approx(constant, rel=1e-3)


def test_ranges_reach_to_either_side_of_the_laws_constants() -> None:
    skins = [drawn(BodyKind.AREA, seed).skin for seed in range(40)]
    for figures, constant in (
        ([skin.series_ohm for skin in skins], DRY_SERIES_OHM),
        ([skin.parallel_ohm for skin in skins], DRY_PARALLEL_OHM),
        ([skin.bend_ua for skin in skins], BEND_UA),
    ):
        assert min(figures) < 0.8 * constant
        assert max(figures) > 1.2 * constant


@pytest.mark.parametrize(
    ("kind", "least", "most"),
    [
        (BodyKind.AREA, 1.05, 2.0),
        (BodyKind.INDIFFERENT, 0.98, 1.02),
        (BodyKind.SWEAT, 0.98, 1.02),
        (BodyKind.DUCTS, 0.4, 0.95),
    ],
)
def test_what_sweat_makes_of_thresholds(kind: BodyKind, least: float, most: float) -> None:
    """Of currents through the skin: films take their share. Resistance falls in all of them."""

    def through_skin_ua(body: LivingBody) -> np.ndarray:
        return np.array([body.sensation.true_threshold_ua(each, WIDTH_US) for each in range(COUNT)])

    body = body_of(kind, doing=WET)
    dry_ua, dry_ohm = through_skin_ua(body), resistances_ohm(body)
    body.look_at(10 * MINUTE_NS)
    assert least <= np.median(through_skin_ua(body) / dry_ua) <= most
    assert np.median(resistances_ohm(body) / dry_ohm) < 0.85


def test_pressing_moves_the_threshold_where_sweat_does_not_and_not_of_the_indifferent() -> None:
    moved = {}
    for kind in (BodyKind.SWEAT, BodyKind.INDIFFERENT):
        body = body_of(kind, doing=Script(pressing=0.5))
        asked = []
        for second in range(0, 60, 3):
            body.look_at(second * 1_000 * MS)
            asked.append(thresholds_ua(body))
        moved[kind] = float(np.mean(np.std(asked, axis=0) / np.mean(asked, axis=0)))
    assert moved[BodyKind.SWEAT] > 0.05
    assert moved[BodyKind.INDIFFERENT] < 0.01


@pytest.mark.parametrize("seed", SEEDS)
def test_of_a_capacitive_skin_most_of_a_pulse_does_not_pass_the_resistance(seed: int) -> None:
    body = body_of(BodyKind.CAPACITIVE, seed)
    skin = body.skin
    for electrode in range(COUNT):
        ohm = skin.parallel_at(electrode, 2_000.0)
        tau_us = ohm * skin.capacitance_nf[electrode] * 1e-3
        through_ohm = 1.0 - tau_us / WIDTH_US * -np.expm1(-WIDTH_US / tau_us)
        assert through_ohm < 0.5


@pytest.mark.parametrize("seed", SEEDS)
def test_a_bent_skin_resists_a_weak_current_several_times_as_much(seed: int) -> None:
    def rise(kind: BodyKind) -> float:
        skin = body_of(kind, seed).skin
        return skin.parallel_at(0, 500.0) / skin.parallel_at(0, 4_000.0)

    assert rise(BodyKind.BENT) > 2.2
    assert rise(BodyKind.BENT) > rise(BodyKind.AREA)


def test_a_soaking_skin_loses_three_quarters_in_twenty_minutes() -> None:
    body = body_of(BodyKind.SOAKING)
    dry = np.array([body.contact(each).resistance_ohm for each in range(COUNT)])
    body.look_at(20 * MINUTE_NS)
    wet = np.array([body.contact(each).resistance_ohm for each in range(COUNT)])
    assert np.median(wet / dry) == pytest.approx(0.25, abs=0.05)


@pytest.mark.parametrize("seed", SEEDS)
def test_a_tender_finger_hurts_from_little_above_the_threshold_on(seed: int) -> None:
    body = body_of(BodyKind.TENDER, seed)
    pain_ua = [body.commanded_pain_threshold_ua(each, WIDTH_US) for each in range(COUNT)]
    times = np.array(pain_ua) / thresholds_ua(body)
    # Small contacts hurt sooner than the nominal one, which the figure is of.
    assert 0.9 < times.min() < 1.35
    assert 1.1 < np.median(times) < 1.6


def test_what_makes_a_finger_tender_moves_pain_alone_whoever_the_current_comes_from() -> None:
    plain, tender = (
        Nerves(PLACES, seed=40, spread=NerveSpread(pain_times=times)) for times in (None, 1.2)
    )
    own = np.median(np.abs(tender.own / plain.own), axis=(1, 2))
    everywhere = np.median(np.abs(tender.everywhere / plain.everywhere), axis=(0, 1)).T
    assert own[:, TOUCH_ROWS:] == pytest.approx(everywhere[:, TOUCH_ROWS:])
    assert own[:, TOUCH_ROWS:].min() > 1.2
    assert np.array_equal(tender.own[..., :TOUCH_ROWS], plain.own[..., :TOUCH_ROWS])
    assert np.array_equal(tender.everywhere[:, :, :TOUCH_ROWS], plain.everywhere[:, :, :TOUCH_ROWS])


def test_use_raises_the_threshold_within_a_quarter_of_an_hour_and_rest_brings_it_back() -> None:
    body = body_of(BodyKind.ADAPTING)
    adapted = drawn(BodyKind.ADAPTING, 40).feeling.adapted
    assert 0.6 <= adapted <= 2.7
    before_ua = thresholds_ua(body)
    used, idle, t_ns = 0, 7, 0
    for _ in range(15 * 60 * 2):
        t_ns += 500 * MS
        pulse(body, t_ns, used, 1.5 * before_ua[used])
    risen = thresholds_ua(body) / before_ua
    assert risen[used] == pytest.approx(1.0 + adapted, rel=0.06)
    assert risen[idle] == pytest.approx(1.0, abs=0.01)
    for minute in range(15):
        body.look_at(t_ns + (minute + 1) * MINUTE_NS)
    assert thresholds_ua(body)[used] / before_ua[used] < 1.0 + 0.1 * adapted


def test_adaptation_is_the_same_however_often_one_looks() -> None:
    asked = []
    for looks in (1, 10):
        body = body_of(BodyKind.ADAPTING)
        pulse(body, 500 * MS, 0, 4_000.0)
        for look in range(looks):
            body.look_at(500 * MS + (look + 1) * MINUTE_NS // looks)
        asked.append(body.commanded_threshold_ua(0, WIDTH_US))
    assert asked[0] == pytest.approx(asked[1], rel=1e-3)


def test_a_weak_pulse_beside_it_makes_one_felt_that_was_not() -> None:
    summed = drawn(BodyKind.SUMMING, 40).feeling.summed
    assert 0.18 <= summed <= 0.36
    ask_ua = thresholds_ua(body_of(BodyKind.SUMMING))
    below_ua = ask_ua * (1.0 - 0.8 * summed)

    def felt(beside: int, later_ns: int) -> float:
        body = body_of(BodyKind.SUMMING)
        pulse(body, 100 * MS, beside, 0.3 * ask_ua[beside])
        pulse(body, 100 * MS + later_ns, 0, below_ua[0])
        return body.take_felt().felt[0]

    assert felt(1, 2 * MS) > 1.0
    assert felt(3, 2 * MS) == 0.0, "it is no neighbor"
    assert felt(1, 60 * MS) == 0.0, "it was long ago"
    assert felt(0, 2 * MS) == 0.0, "it is the same electrode"


def test_a_strong_pulse_beside_it_adds_as_one_that_is_not_felt_and_all_pages_say_so() -> None:
    """By design: the source is of pulses below threshold, and the benches' are above."""
    felt = []
    for driven in (0.1, 0.5, 1.0, 3.0, 10.0):
        shifts = Shifts(FeelingFigures(summed=0.3), PLACES)
        shifts.let_pass(0.0)
        peaks = np.zeros(len(PLACES))
        peaks[1] = driven
        shifts.shifted(peaks, 1, 0.0)
        felt.append(shifts.shifted(np.ones(len(PLACES)), 0, 2.0 * MS)[0])
    assert felt == [pytest.approx(1.0 / 0.7)] * 5
    root = Path(__file__).parents[2]
    for page, told in (
        (
            "docs/body.md",
            "that one above threshold does the same, 20 ms, and that pain stays [design]",
        ),
        ("docs/stabilization.md", "add as those below do by design: its source is of pulses below"),
        ("hal/etd_body/kinds.py", "one above does the same [design]"),
        ("hal/etd_body/shifts.py", "above its own threshold too, of which the source says nothing"),
    ):
        assert told in " ".join((root / page).read_text("utf-8").split())


def test_a_neighbor_moves_no_pain() -> None:
    pains = []
    for figures in (UNSHIFTED, FeelingFigures(summed=0.36)):
        body = LivingBody(PLACES, leak_ohm=1e9, compliance_v=1e4, seed=3, feeling=figures)
        pulse(body, 100 * MS, 1, 1_000.0)
        body.take_felt()
        pulse(body, 102 * MS, 0, 3_000.0)
        pains.append(body.take_felt().pain[0])
    assert pains[0] == pains[1]


def test_the_finger_of_a_seed_is_the_same_but_for_what_the_kind_changes() -> None:
    fingers = [drawn(kind, 40, doing=BUSY) for kind in BodyKind]
    for one, other in pairwise(fingers):
        assert one.skin.area_sigma == other.skin.area_sigma
        assert one.spread.depth_sigma == other.spread.depth_sigma
        assert one.script.peels_per_min == other.script.peels_per_min


# --- ranges that somebody knows better -----------------------------------------------------------


@pytest.mark.parametrize("kind", BodyKind)
def test_a_range_that_is_given_is_drawn_from_and_nothing_else_changes(kind: BodyKind) -> None:
    """Spreads are of every kind, and no kind says otherwise."""
    given = BodyRanges(area_sigma=Span(0.5, 0.6), depth_sigma=Span(0.07, 0.07))
    for seed in SEEDS:
        plain, other = drawn(kind, seed), drawn(kind, seed, ranges=given)
        assert 0.5 <= other.skin.area_sigma <= 0.6
        assert other.spread.depth_sigma == 0.07
        assert replace(
            other,
            skin=replace(other.skin, area_sigma=plain.skin.area_sigma),
            spread=replace(other.spread, depth_sigma=plain.spread.depth_sigma),
        ) == plain  # fmt: skip
    body = living(kind, PLACES, leak_ohm=1e9, compliance_v=1e4, seed=40, ranges=given)
    body.look_at(0)
    assert not np.allclose(thresholds_ua(body), thresholds_ua(body_of(kind, doing=LYING)))


@pytest.mark.parametrize(
    ("kind", "given", "figure"),
    [
        (BodyKind.AREA, {"series_ohm": Span(9e3, 9e3)}, lambda it: it.skin.series_ohm),
        (BodyKind.AREA, {"parallel_ohm": Span(9e3, 9e3)}, lambda it: it.skin.parallel_ohm),
        (BodyKind.AREA, {"capacitance_nf": Span(9e3, 9e3)}, lambda it: it.skin.capacitance_nf),
        (BodyKind.AREA, {"bend_ua": Span(9e3, 9e3)}, lambda it: it.skin.bend_ua),
        (BodyKind.AREA, {"threshold_sigma": Span(9e3, 9e3)}, lambda it: it.spread.threshold_sigma),
        (BodyKind.AREA, {"sweat_times": Span(9e3, 9e3)}, lambda it: it.script.sweat / LYING.sweat),
        (
            BodyKind.AREA,
            {"sweat_tau_times": Span(9e3, 9e3)},
            lambda it: it.script.sweat_tau_s / LYING.sweat_tau_s,
        ),
        (
            BodyKind.CAPACITIVE,
            {"capacitive_parallel_ohm": Span(9e3, 9e3)},
            lambda it: it.skin.parallel_ohm,
        ),
        (
            BodyKind.CAPACITIVE,
            {"capacitive_nf": Span(9e3, 9e3)},
            lambda it: it.skin.capacitance_nf,
        ),
        (BodyKind.BENT, {"bent_ua": Span(9e3, 9e3)}, lambda it: it.skin.bend_ua),
        (BodyKind.BENT, {"bent_series_ohm": Span(9e3, 9e3)}, lambda it: it.skin.series_ohm),
        (BodyKind.BENT, {"bent_parallel_ohm": Span(9e3, 9e3)}, lambda it: it.skin.parallel_ohm),
        (BodyKind.DUCTS, {"ducts_by_sweat": Span(9e3, 9e3)}, lambda it: it.skin.way_by_sweat),
        (BodyKind.ADAPTING, {"adapted": Span(9e3, 9e3)}, lambda it: it.feeling.adapted),
        (BodyKind.SOAKING, {"soaked": Span(9e3, 9e3)}, lambda it: it.script.sweat),
        (BodyKind.SOAKING, {"soaking_tau_s": Span(9e3, 9e3)}, lambda it: it.script.sweat_tau_s),
        (BodyKind.TENDER, {"pain_times": Span(9e3, 9e3)}, lambda it: it.spread.pain_times),
        (BodyKind.SUMMING, {"summed": Span(9e3, 9e3)}, lambda it: it.feeling.summed),
    ],
)
def test_each_range_is_that_of_its_figure(
    kind: BodyKind, given: dict[str, Span], figure: Callable[[BodyFigures], float]
) -> None:
    assert figure(drawn(kind, 40, ranges=BodyRanges(**given))) == pytest.approx(9e3)


@pytest.mark.parametrize(("least", "most"), [(2.0, 1.0), (0.0, inf), (float("nan"), 1.0)])
def test_a_range_that_is_none_is_refused(least: float, most: float) -> None:
    with pytest.raises(ValueError, match="a range goes up"):
        Span(least, most)


def test_the_page_has_the_ranges() -> None:
    page = " ".join((Path(__file__).parents[2] / "docs" / "body.md").read_text("utf-8").split())
    ranges = BodyRanges()
    for told in (
        f"Rp {_kilo(ranges.capacitive_parallel_ohm)} kOhm, Cp {_told(ranges.capacitive_nf)} nF",
        f"bend {_kilo(ranges.bent_ua)} mA, Rs {_kilo(ranges.bent_series_ohm)} kOhm,"
        f" Rp {_kilo(ranges.bent_parallel_ohm)} kOhm",
        f"+{100 * ranges.adapted.least:.0f} to {100 * ranges.adapted.most:.0f} %",
        f"sweat {ranges.soaked.least:g}, tau {_told(ranges.soaking_tau_s)} s",
        f"pain from about {ranges.pain_times.least:g} times the threshold on",
        f"{100 * ranges.summed.least:.0f} to {100 * ranges.summed.most:.0f} %, from 10 %",
        f"its Rs ({_kilo(ranges.series_ohm)} kOhm), Rp ({_kilo(ranges.parallel_ohm)} kOhm at 5 mA),"
        f" Cp ({_told(ranges.capacitance_nf)} nF), bend ({_kilo(ranges.bend_ua)} mA), spreads"
        f" (area {_told(ranges.area_sigma)}, depth {_told(ranges.depth_sigma)}, threshold"
        f" {_told(ranges.threshold_sigma)}) and sweat ({_told(ranges.sweat_times)} times",
    ):
        assert told in page


def _told(span: Span) -> str:
    return f"{span.least:g} to {span.most:g}"


def _kilo(span: Span) -> str:
    return f"{span.least / 1e3:g} to {span.most / 1e3:g}"
