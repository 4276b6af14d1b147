"""A probe first, in the same visit: on the wires, in the plan, in the ledger, in what is told."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from engine_parts import array, body_site, currents, frame, planner
from engine_rig import EngineRig
from engine_scenes import begun, config, only, opened_to, phases, scans
from etd.files.body_site import BodySite
from etd.files.configuration import LoadedConfig
from etd.protocol.errors import BoardFault, Refused
from etd.pulse.request import NO_GAIN, MaxGain, PulseRequest
from etd.stabilize.bursts import Bursts
from etd.stabilize.law_settings import (
    ContactSettings,
    EnergySettings,
    LinearLawSettings,
    PowerLawSettings,
)
from etd.stabilize.pipeline import ElectrodeEstimate
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.settings import Settings
from etd_body.electrode import skin
from etd_hal.fake.faults import AdcBitStuck, AdcScale
from trace_decoder import Phase, is_led, visits
from trace_rules import violations

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
CURRENT_UA, WIDTH_US = 1_500, 80
PROBE_UA, PROBE_US = 300, 50
STEP_UA = 10_000 / 4_095
REST_US = 200
#: The same contact, and what is left when it has lost half of its area.
WHOLE, HALF = skin(1_000.0, 39_000.0, 0.3), skin(2_000.0, 78_000.0, 0.15)


def probing(site: BodySite, is_probe_first: bool = True, **laws: Any) -> BodySite:
    bursts = laws.pop("bursts", None)
    settings = Settings(
        order=tuple(laws),  # type: ignore[arg-type]
        probe_first=is_probe_first,
        bursts=bursts,
        **laws,
    )
    # Firm again within the half second that `standing` takes.
    contact = msgspec.structs.replace(site.contact, soften_ms=300)
    return msgspec.structs.replace(site, stabilize=settings, contact=contact)


def with_probes(board: str = "kajimoto-hv507", **changes: Any) -> LoadedConfig:
    maxima = changes.pop("maxima", None)
    loaded = config(board, N, maxima=maxima)
    return dataclasses.replace(loaded, body_site=probing(loaded.body_site, **changes))


def opened(rig: EngineRig, current_ua: int = CURRENT_UA) -> EngineRig:
    """Armed, with weak frames held, and the opening as high as `current_ua`."""
    begun(rig, 190)
    opened_to(rig, current_ua)
    rig.hold(current_ua // 5 + 30, current_ua=only(N, e0=20), rate_hz=20.0)
    return rig


def standing(rig: EngineRig, **fields: Any) -> EngineRig:
    """Electrode 4 whole, its frame up for half a second."""
    rig.fake.world.touch(4, WHOLE)
    opened(rig, CURRENT_UA)
    hold(rig, 500, **fields)
    return rig


def hold(rig: EngineRig, duration_ms: float, **fields: Any) -> Sequence[tuple[Phase, ...]]:
    """The visits meanwhile."""
    since_ns = rig.clock.now_ns()
    whole = {"current_ua": only(N, e4=CURRENT_UA), "width_us": WIDTH_US, "rate_hz": 50.0}
    rig.hold(duration_ms, **{**whole, **fields})
    return list(visits(phases(rig, since_ns)))


def charge_pc(visit: Sequence[Phase]) -> float:
    """Of its pulse, prepulse and phases included: all but the probe."""
    is_probe_first = len(visit) > 1 and is_led(*visit[:2])
    return sum(phase.charge_pc for phase in visit[is_probe_first:])


# --- on the wires ---------------------------------------------------------------------------------


@pytest.mark.parametrize("board", ["kajimoto-hv507", "feetthrough-relay"])
@pytest.mark.parametrize("polarity", ["anodic", "cathodic", "biphasic"])
def test_a_probe_goes_before_every_pulse_the_way_that_its_first_phase_will_go(
    make_rig: MakeRig, board: str, polarity: str
) -> None:
    rig = standing(make_rig(loaded=with_probes(board)), polarity=polarity, rate_hz=20.0)
    found = hold(rig, 200, polarity=polarity, rate_hz=20.0)
    assert len(found) >= 3
    for probe, *pulse in found:
        assert len(pulse) == (2 if polarity == "biphasic" else 1)
        assert is_led(probe, pulse[0])
        assert PROBE_UA - STEP_UA < probe.current_ua <= PROBE_UA
        assert PROBE_US - 1 < probe.width_us <= PROBE_US
        assert probe.is_anodic == pulse[0].is_anodic == (polarity != "cathodic")
        assert all(phase.current_ua > CURRENT_UA - STEP_UA for phase in pulse)
    assert rig.close() == ()
    assert violations(rig.trace(), REST_US) == []


def test_a_prepulse_may_lead_into_the_pulse_behind_a_probe(make_rig: MakeRig) -> None:
    prepulse = Prepulse(below_db=6.0, width_us=60)
    rig = standing(make_rig(loaded=with_probes(prepulse=prepulse)))
    ((probe, before, pulse), *_) = hold(rig, 100)
    assert is_led(probe, before)
    assert before.to_ns == pulse.from_ns
    assert before.current_ua == pytest.approx(CURRENT_UA / 2, abs=5)


def test_each_pulse_of_a_burst_has_its_probe(make_rig: MakeRig) -> None:
    bursts = Bursts(pulses=3, rate_hz=350.0)
    loaded = with_probes(bursts=bursts)
    rig = standing(make_rig(loaded=loaded), rate_hz=10.0)
    found = hold(rig, 200, rate_hz=10.0)
    assert len(found) >= 6
    assert all(is_led(*visit[:2]) for visit in found)
    assert rig.engine.components.reporter.counters["not_fired_ledger"] == 0


def test_a_pulse_as_weak_as_a_probe_has_none(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_probes()))
    found = hold(rig, 100, current_ua=only(N, e4=PROBE_UA))
    assert all(len(visit) == 1 for visit in found)
    found = hold(rig, 100, current_ua=only(N, e4=PROBE_UA + 10))
    assert all(len(visit) == 2 for visit in found)


def test_a_probe_is_never_longer_than_the_frames_own_pulse(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_probes()))
    found = hold(rig, 100, width_us=30)
    assert all(len(visit) == 2 for visit in found)
    assert all(29 < phase.width_us <= 30 for visit in found for phase in visit)


# --- what it finds --------------------------------------------------------------------------------


def test_an_electrode_found_open_gets_nothing_of_this_pulse_and_that_is_told(
    make_rig: MakeRig,
) -> None:
    rig = standing(make_rig(loaded=with_probes()))
    rig.fake.world.lift(4)
    since_ns = rig.clock.now_ns()
    first, *others = hold(rig, 100)
    assert len(first) == 1
    assert first[0].current_ua <= PROBE_UA
    assert all(len(visit) == 1 and visit[0].current_ua <= PROBE_UA for visit in others)
    told = [scan for scan in scans(rig) if scan.now_ns > since_ns and scan.clamped]
    clamp = told[0].clamped[0]
    assert (clamp.electrode, clamp.reason, clamp.wanted_ua) == (4, "contact_open", CURRENT_UA)
    assert clamp.allowed_ua == 0


@pytest.mark.parametrize(
    "laws",
    [
        {"contact": ContactSettings()},
        {"power_law": PowerLawSettings()},
        {"linear_law": LinearLawSettings(charge_slope=-0.5)},
    ],
    ids=["contact", "power_law", "linear_law"],
)
def test_a_contact_that_has_lost_half_of_itself_gets_less_with_this_very_pulse(
    make_rig: MakeRig, laws: dict[str, Any]
) -> None:
    found = []
    for is_probe_first in (True, False):
        rig = standing(make_rig(loaded=with_probes(is_probe_first=is_probe_first, **laws)))
        steady_pc = charge_pc(hold(rig, 100)[-1])
        rig.fake.world.touch(4, HALF)
        found.append(charge_pc(hold(rig, 100)[0]) / steady_pc)
    with_probe, without = found
    assert with_probe < 0.8
    assert without > 0.95


def test_no_probe_is_taken_for_what_the_skin_resists(make_rig: MakeRig) -> None:
    found = []
    for is_probe_first in (True, False):
        loaded = with_probes(is_probe_first=is_probe_first, energy=EnergySettings())
        rig = standing(make_rig(loaded=loaded))
        found.append(rig.engine.components.adapter.estimate(4, rig.clock.now_ns()).skin_ohm)
    with_probe, without = found
    assert without is not None
    assert with_probe == pytest.approx(without, rel=0.01)


def test_a_resistance_that_a_probe_says_has_fallen_waits_for_the_pulse(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_probes(energy=EnergySettings(rise_per_s=20.0))))
    steady_pc = charge_pc(hold(rig, 100)[-1])
    rig.fake.world.touch(4, skin(500.0, 19_500.0, 0.6))
    assert charge_pc(hold(rig, 15)[0]) <= steady_pc * 1.001


def test_what_a_probe_leaves_in_dry_skin_makes_nobody_doubt_a_pulse_hardly_stronger(
    make_rig: MakeRig,
) -> None:
    rig = standing(make_rig(loaded=with_probes(energy=EnergySettings())))
    rig.fake.world.touch(4, skin(3_000.0, 120_000.0, 0.3))
    for current_ua in (PROBE_UA + 30, 400, 600):
        found = hold(rig, 100, current_ua=only(N, e4=current_ua))
        assert all(len(visit) == 2 for visit in found)
    counters = rig.engine.components.reporter.counters
    assert [name for name in counters if name.startswith("rejected")] == []


def test_a_probe_of_a_node_that_is_not_at_rest_is_not_believed_and_counted_once(
    make_rig: MakeRig,
) -> None:
    """By less than what halts: 2.9 V, where the probe itself comes to less than that."""
    rig = standing(make_rig(loaded=with_probes(contact=ContactSettings())))
    rig.fake.world.touch(4, skin(500.0, 9_000.0, 1.0))
    hold(rig, 300)
    fault = AdcBitStuck(bit=5, level=1)
    rig.fake.world.put_in(fault)
    # Before the next look at the source, which it would halt.
    assert all(len(visit) == 2 for visit in hold(rig, 50))
    rig.fake.world.take_out(fault)
    hold(rig, 50)
    assert rig.engine.components.reporter.counters["rejected_probe"] == 1


def test_a_probe_whose_pulse_is_withheld_is_counted(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_probes(contact=ContactSettings())))
    counters = rig.engine.components.reporter.counters
    before = counters["probes_alone"]
    hold(rig, 50)
    assert counters["probes_alone"] == before, "each was followed by its pulse"
    rig.fake.world.lift(4)
    first = hold(rig, 15)[0]
    assert len(first) == 1
    assert counters["probes_alone"] == before + 1


@pytest.mark.parametrize("factor", [0.0, 0.3, 3.0])
def test_a_probe_that_is_read_wrong_never_gives_more(make_rig: MakeRig, factor: float) -> None:
    rig = standing(
        make_rig(loaded=with_probes(power_law=PowerLawSettings(), contact=ContactSettings()))
    )
    steady_pc = charge_pc(hold(rig, 100)[-1])
    rig.fake.world.put_in(AdcScale(factor))
    first = hold(rig, 15)[0]
    assert sum(phase.charge_pc for phase in first) <= steady_pc * 1.001 + PROBE_UA * PROBE_US


# --- limits, plan and ledger ----------------------------------------------------------------------


@dataclasses.dataclass(frozen=True)
class Follows:
    """A stabilizer with a slope of its own, either way, and no slew."""

    most: PulseRequest
    slope: float
    max_gain: MaxGain = NO_GAIN

    def adapt(self, pulse_request: PulseRequest, estimate: ElectrodeEstimate) -> PulseRequest:
        part = 1.0 if estimate.skin_ohm is None else (estimate.skin_ohm / 40_000.0) ** self.slope
        return PulseRequest(
            int(self.most.current_ua * part), max(20, int(self.most.width_us / part))
        )

    def reset(self) -> None:
        """It remembers nothing."""


@pytest.mark.parametrize("slope", [-1.0, 1.0])
def test_nothing_is_asked_for_behind_a_probe_that_was_not_asked_for_before_it(
    make_rig: MakeRig, slope: float
) -> None:
    asks = Follows(PulseRequest(900, WIDTH_US), slope)
    rig = standing(make_rig(loaded=with_probes(), stabilizers=[asks]))
    steady = hold(rig, 100)[-1][-1]
    rig.fake.world.touch(4, HALF)
    first = hold(rig, 15)[0][-1]
    assert first.current_ua <= steady.current_ua + STEP_UA
    assert first.width_us <= steady.width_us + 1


requests = st.builds(
    PulseRequest,
    st.integers(0, 9_000),
    st.integers(20, 200),
    st.integers(0, 900),
    st.integers(0, 99),
)


@given(before=requests, after=requests)
def test_not_above_is_no_part_more_than_either(before: PulseRequest, after: PulseRequest) -> None:
    both = before.not_above(after)
    assert both == after.not_above(before)
    for request in (before, after):
        assert both.current_ua <= request.current_ua
        assert both.width_us <= request.width_us
        assert both.prepulse_ua <= request.prepulse_ua
        assert both.prepulse_us <= request.prepulse_us


def test_a_probe_counts_to_the_charge_of_its_pulse_and_not_to_its_width() -> None:
    """400 uA for 100 us and the probe's 15 nC are 55 nC."""
    site = probing(body_site())
    tight = msgspec.structs.replace(site, maxima=msgspec.structs.replace(site.maxima, charge_nc=55))
    made = planner(site=tight)
    assert made.plan(frame(current_ua=currents(e3=400), width_us=100)).schedule
    with pytest.raises(Refused, match="charge of a pulse"):
        made.plan(frame(current_ua=currents(e3=401), width_us=100))
    assert planner(site=site).plan(frame(current_ua=currents(e3=400), width_us=200)).schedule


def test_the_mean_current_is_that_of_probes_and_pulses() -> None:
    """2 350 uA for 100 us and 15 nC, 120 times a second: 30 uA."""
    made = planner(site=probing(body_site()))
    whole = {"width_us": 100, "rate_hz": 120.0}
    assert made.plan(frame(current_ua=currents(e3=2_350), **whole)).schedule
    with pytest.raises(Refused, match=r"mean current 30\.0"):
        made.plan(frame(current_ua=currents(e3=2_351), **whole))


@pytest.mark.parametrize("polarity", ["anodic", "biphasic"])
def test_stabilizers_find_no_room_where_the_probe_needs_it(polarity: str) -> None:
    """Mean current and time with current, of all phases and the probe."""
    whole = {"width_us": 60, "rate_hz": 120.0, "polarity": polarity, "allow_slower": True}
    phases_of = 2 if polarity == "biphasic" else 1
    site = probing(body_site(), energy=EnergySettings(max_widening=4.0))
    made = planner(site=site, max_gain=MaxGain(width=4.0, charge=4.0))
    bounds = made.plan(frame(current_ua=currents(e3=1_000), **whole)).schedule[0].bounds
    probe_pc = PROBE_UA * PROBE_US
    assert (phases_of * bounds.charge_pc + probe_pc) * 120 <= 30_000_000
    assert (phases_of * bounds.width_us + PROBE_US) * 120 <= 24_000


def test_stabilizers_get_no_charge_that_the_probe_needs() -> None:
    made = planner(site=probing(body_site()), max_gain=MaxGain(width=1.3, charge=4.0))
    (scheduled,) = made.plan(
        frame(current_ua=currents(e3=3_000), width_us=150, rate_hz=10.0)
    ).schedule
    assert scheduled.bounds.charge_pc + PROBE_UA * PROBE_US == 500_000


def test_a_slot_has_room_for_the_probe_and_for_what_is_decided_behind_it() -> None:
    asked = frame(current_ua=(500,) * 64, width_us=100, rate_hz=120.0, allow_slower=True)
    alone, led = (
        planner(site=site, layout=array("grid-8x8")).plan(asked)
        for site in (body_site(), probing(body_site()))
    )
    longer_us = (led.period_ns - alone.period_ns) / 1_000
    # The message, and what a visit takes the processor, which is busy all that time.
    assert longer_us >= 64 * (50 + 9.1 + 60) - 0.01


def test_a_frame_of_pulses_as_weak_as_probes_needs_no_room_for_any() -> None:
    asked = frame(current_ua=(300,) * 64, width_us=100, rate_hz=120.0, allow_slower=True)
    alone, led = (
        planner(site=site, layout=array("grid-8x8")).plan(asked)
        for site in (body_site(), probing(body_site()))
    )
    assert led.period_ns == alone.period_ns


def test_a_scan_with_probes_ends_in_time(make_rig: MakeRig) -> None:
    rig = opened(make_rig(loaded=with_probes(contact=ContactSettings())), 1_000)
    rig.hold(150, current_ua=(800,) * N, width_us=80, rate_hz=100.0)
    assert rig.engine.components.reporter.counters["not_fired_overrun"] == 0
    assert rig.engine.components.reporter.counters["not_fired_ledger"] == 0


def test_the_ledger_counts_the_time_of_probe_and_pulse(make_rig: MakeRig) -> None:
    """130 us each: ten in a second; no probe where its pulse would not fit; and none is a visit of
    its own.
    """
    rig = make_rig(loaded=with_probes(maxima={"on_us_per_s": 1_390}))
    rig = opened(rig, CURRENT_UA)
    rig.run_ms(870)
    found = [visit for visit in hold(rig, 950) if visit[0].electrode == 4]
    assert len(found) == 10
    assert all(len(visit) == 2 for visit in found)


def test_the_ledger_counts_the_charge_of_probe_and_pulse(make_rig: MakeRig) -> None:
    rig = standing(make_rig(loaded=with_probes()))
    found = hold(rig, 1_000)
    now_ns = rig.clock.now_ns()
    within = [visit for visit in found if visit[0].from_ns > now_ns - 1_000_000_000]
    one_pc = CURRENT_UA * WIDTH_US + PROBE_UA * PROBE_US
    assert rig.engine.components.ledger.charge_pc(4, now_ns) == len(within) * one_pc


def test_a_probe_before_a_pulse_that_never_comes_is_booked(make_rig: MakeRig) -> None:
    """Whatever happens between the two, what was fired counts."""
    rig = standing(make_rig(loaded=with_probes()))
    ledger, since_ns = rig.engine.components.ledger, rig.clock.now_ns()
    before = ledger.pulses(9, since_ns)

    def break_down(*_: object) -> PulseRequest:
        raise BoardFault("in between", "nothing", "a wish")

    rig.engine.components.adapter.readapt = break_down  # type: ignore[assignment, method-assign]
    rig.show(current_ua=only(N, e9=CURRENT_UA), width_us=WIDTH_US)
    rig.run_ms(40)
    assert rig.state == "HALTED"
    (fired,) = visits([phase for phase in phases(rig, since_ns) if phase.electrode == 9])
    assert len(fired) == 1
    assert ledger.pulses(9, rig.clock.now_ns()) == before + 1


# --- what is told ---------------------------------------------------------------------------------


def test_the_report_of_a_pulse_names_its_probe_and_its_prepulse(make_rig: MakeRig) -> None:
    prepulse = Prepulse(below_db=6.0, width_us=60)
    for laws, probe_ua, prepulse_ua in (
        ({}, 297, 0),
        ({"prepulse": prepulse}, 297, 749),
        ({"prepulse": prepulse, "is_probe_first": False}, 0, 749),
    ):
        rig = standing(make_rig(loaded=with_probes(**laws)))
        fired = scans(rig)[-1].fired
        assert fired.probe_ua[4] == pytest.approx(probe_ua, abs=STEP_UA)
        assert fired.prepulse_ua[4] == pytest.approx(prepulse_ua, abs=STEP_UA)
        assert fired.current_ua[4] > CURRENT_UA - STEP_UA
        assert not any(fired.probe_ua[:4])
