"""Whatever the samples and sensors say, whatever the skin does and whichever laws there are, in any
order: nobody gets more than limits, opening and the frame's own most, a current that is named is
never passed, and no fall is delayed.

The oracle is its own: it reads the wires, and reckons what a frame allows from the settings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import engine_rig
from engine_rig import EngineRig
from engine_scenes import MS, calibration, exponent, only, open_calibrated, phases
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.stabilize.bursts import Bursts
from etd.stabilize.law_settings import (
    ContactSettings,
    EnergySettings,
    LinearLawSettings,
    PowerLawSettings,
    PressureSettings,
)
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.settings import Settings
from etd.stabilize.strength_duration import StrengthDuration
from etd_body.electrode import OPEN_CONTACT, skin
from etd_hal.fake.faults import AdcScale, AdcStuck, Fault
from trace_decoder import Phase, is_led, visits

pytestmark = pytest.mark.slow

N = 8
CAP_UA, MAX_PC = 2_000, 500_000
PROBE_UA, PROBE_US = 300, 50
RISE_UA, RISE_NS = 50, 10_000_000
#: From a frame's coming to the beginning of the pulse that is under way already: in bursts every
#: pulse is looked ahead of; otherwise a scan of 8 electrodes is gone through first.
GRACE_NS = {True: 1 * MS, False: 8 * MS}

# --- which laws, and in what order ---------------------------------------------------------------

wider = st.sampled_from([1.0, 1.5, 4.0])
fast = st.sampled_from([1.0, 20.0])
by_resistance: st.SearchStrategy[dict[str, Any]] = st.one_of(
    st.just({}),
    st.builds(EnergySettings, max_widening=wider, rise_per_s=fast).map(lambda law: {"energy": law}),
    st.builds(PowerLawSettings, max_widening=wider, rise_per_s=fast).map(
        lambda law: {"power_law": law}
    ),
    st.builds(
        LinearLawSettings,
        charge_slope=st.sampled_from([-0.5, 0.0, 1.0]),
        energy_slope=st.sampled_from([0.2, 2.0]),
        max_widening=wider,
        rise_per_s=fast,
    ).map(lambda law: {"linear_law": law}),
)
others: dict[str, st.SearchStrategy[Any]] = {
    "contact": st.builds(ContactSettings, rise_per_s=st.sampled_from([0.2, 10.0])),
    "pressure": st.builds(PressureSettings, rise_per_s=fast),
    "strength_duration": st.builds(
        StrengthDuration,
        width_us=st.sampled_from([25, 50, 80]),
        tau_us=st.sampled_from([60.0, 151.0]),
    ),
}
prepulses = st.builds(
    Prepulse, below_db=st.sampled_from([2.0, 10.0]), width_us=st.sampled_from([20, 40])
)
bursts = st.builds(
    Bursts, pulses=st.sampled_from([2, 3, 6]), rate_hz=st.sampled_from([200.0, 350.0])
)


@st.composite
def tables(draw: st.DrawFn) -> Settings:
    laws = {
        name: draw(search_strategy)
        for name, search_strategy in others.items()
        if draw(st.booleans())
    }
    laws |= draw(by_resistance)
    order = draw(st.permutations(sorted(laws)))
    if draw(st.booleans()):
        laws["prepulse"] = draw(prepulses)
        order = [*order, "prepulse"]
    return Settings(
        order=tuple(order),  # type: ignore[arg-type]
        bursts=draw(st.none() | bursts),
        probe_first=draw(st.booleans()),
        **laws,
    )


# --- what happens --------------------------------------------------------------------------------

contacts = st.one_of(
    st.just(OPEN_CONTACT),
    st.builds(skin, st.floats(100, 5_000), st.floats(500, 400_000), st.floats(0.05, 3.0)),
)
happenings = st.one_of(
    st.tuples(st.integers(0, N - 1), contacts),
    st.sampled_from([0.0, 0.02, 0.5, 2.0, 30.0]).map(AdcScale),
    # Up to what skin may leave on the node before a pulse; and one that halts.
    st.one_of(st.integers(0, 56), st.just(900)).map(AdcStuck),
    st.sampled_from([None, 0.0, 30.0, 200.0]).map(lambda kpa: ("pressed", kpa)),
    st.none(),
)
#: Of each electrode how strong, as an index into `CURRENTS_UA` or `LEVELS`; how wide; and whether
#: it asks for levels, where there is a calibration, whose width they have.
frames = st.tuples(
    st.tuples(*[st.integers(0, 4)] * N), st.sampled_from([20, 40, 100, 150]), st.booleans()
)
CURRENTS_UA = (0, 50, 900, 2_000, 3_000)
#: Levels, and what they stand for.
THRESHOLD_UA, COMFORTABLE_UA = 50, 1_750
LEVELS = ((0.0, 0), (1e-9, 50), (0.5, 900), (0.8, 1_410), (1.0, 1_750))
#: None: under a client's limits. Otherwise by a calibration of the site's own shape, made with
#: pulses so wide, of skin that resisted so much; the person's k.
calibrations = st.none() | st.tuples(
    st.sampled_from([20, 40, 100, 150]),
    st.sampled_from([None, 1_000, 20_000, 300_000]),
    st.sampled_from([0.4, 1.0, 2.0]),
)
stories = st.lists(st.tuples(frames, happenings, st.integers(2, 150)), min_size=2, max_size=6)


@dataclass
class Pressed:
    """What a sensor under the array says."""

    now_kpa: float | None = 200.0

    def kpa(self, electrode: int, now_ns: int) -> float | None:
        return self.now_kpa

    def is_dead(self, electrode: int, now_ns: int) -> bool:
        return self.now_kpa is None


@dataclass(frozen=True)
class Sent:
    seq: int
    current_ua: tuple[int, ...]
    width_us: int
    sent_ns: int
    is_level: bool


@dataclass
class Player:
    """Sends the frames of a story at their time, which may be within a scan."""

    rig: EngineRig
    polarity: str
    pressed: Pressed
    calibration: Calibration | None
    sent: dict[int, Sent] = field(default_factory=dict)
    faults: list[Fault] = field(default_factory=list)

    def show(self, strengths: tuple[int, ...], width_us: int, is_level: bool) -> None:
        made = self.calibration if is_level else None
        if made is None:
            current_ua = tuple(CURRENTS_UA[strength] for strength in strengths)
            asked: dict[str, Any] = {"current_ua": current_ua, "width_us": width_us}
        else:
            current_ua, width_us = (
                tuple(LEVELS[strength][1] for strength in strengths),
                made.width_us,
            )
            asked = {"level": tuple(LEVELS[strength][0] for strength in strengths)}
        now_ns = self.rig.clock.now_ns()
        ref = self.rig.send(**asked, rate_hz=15.0, ttl_ms=1_000, polarity=self.polarity)
        self.sent[ref] = Sent(self.rig.last_seq, current_ua, width_us, now_ns, made is not None)

    def happen(self, happening: Any) -> None:
        world = self.rig.fake.world
        if isinstance(happening, tuple) and happening[0] == "pressed":
            self.pressed.now_kpa = happening[1]
        elif isinstance(happening, tuple):
            world.touch(*happening)
        elif happening is not None and happening not in self.faults:
            world.put_in(happening)
            self.faults.append(happening)
        elif self.faults:
            world.take_out(self.faults.pop())

    @property
    def accepted(self) -> list[Sent]:
        return [sent for ref, sent in self.sent.items() if self.rig.answers[ref].error is None]


# --- the oracle ----------------------------------------------------------------------------------


def loaded_with(table: Settings) -> LoadedConfig:
    loaded = fake_config(electrodes=N)
    return replace(loaded, body_site=msgspec.structs.replace(loaded.body_site, stabilize=table))


def open_lease(rig: EngineRig, table: Settings, polarity: str, by: Any) -> Calibration | None:
    """For a client's numbers, or a person's calibration."""
    if by is None and table.power_law is None:
        rig.open(CAP_UA, 190)
        return None
    # `power_law` needs a person.
    width_us, resistance_ohm, k = by or (150, None, 1.0)
    limits = ElectrodeLimits(
        threshold_ua=THRESHOLD_UA,
        comfortable_ua=COMFORTABLE_UA,
        cap_ua=CAP_UA,
        resistance_ohm=resistance_ohm,
    )
    made = calibration(
        rig,
        (CAP_UA,) * N,
        electrode=(limits,) * N,
        polarity=polarity,
        width_us=width_us,
        rate_hz=15.0,
        shape=table.shape,
        exponent=exponent(k),
    )
    assert open_calibrated(rig, made).error is None
    return made


def max_widening(table: Settings) -> float:
    laws = (table.energy, table.power_law, table.linear_law)
    return max((law.max_widening for law in laws if law is not None), default=1.0)


def rise_of(table: Settings, frame: Sent) -> float:
    """How much stronger a pulse of the same height above its strength-duration curve is, if it is
    narrowed; where a law may have widened it before, from what that makes of it. Only levels are.
    """
    narrow, order = table.strength_duration, table.order
    if narrow is None or not frame.is_level:
        return 1.0
    width_us: float = frame.width_us
    if any(
        one in order[: order.index("strength_duration")]
        for one in ("energy", "power_law", "linear_law")
    ):
        width_us *= max_widening(table)
    if width_us <= narrow.width_us:
        return 1.0
    return math.expm1(-width_us / narrow.tau_us) / math.expm1(-narrow.width_us / narrow.tau_us)


def cap_pc(table: Settings, width_us: int, made: Calibration | None) -> float:
    """A calibration's was accepted with the prepulse that there is, in pulses of its width."""
    if made is None:
        return CAP_UA * width_us
    led = table.prepulse
    led_pc = CAP_UA * led.part * led.width_us if led else 0.0
    return CAP_UA * min(width_us, made.width_us) + led_pc


def is_named_and_narrowed(frame: Sent, table: Settings) -> bool:
    """A current that would become a stronger one."""
    narrow = table.strength_duration
    if narrow is None or frame.is_level:
        return False
    return any(frame.current_ua) and frame.width_us > narrow.width_us


def check(
    frame: Sent,
    visit: tuple[Phase, ...],
    table: Settings,
    opened_ua: int,
    made: Calibration | None,
) -> None:
    """One visit against one frame that stood when it began."""
    electrode = visit[0].electrode
    assert electrode is not None
    wanted_ua, width_us = frame.current_ua[electrode], frame.width_us
    strongest_ua = max(phase.current_ua for phase in visit)
    assert strongest_ua <= opened_ua
    probe, body = visit[:1], visit
    if len(visit) > 1 and is_led(*visit[:2]):
        body = visit[1:]
    if body is not visit or not wanted_ua:
        assert probe[0].current_ua <= PROBE_UA
        assert probe[0].width_us <= PROBE_US
    if not wanted_ua:
        assert body is visit, "no more than a look where a frame asks for nothing"
        assert strongest_ua <= PROBE_UA
        return
    rise, pre, times = rise_of(table, frame), table.prepulse, max_widening(table)
    led_ua, led_us = (wanted_ua * rise * pre.part, pre.width_us) if pre else (0.0, 0)
    assert strongest_ua <= min(CAP_UA, rise * wanted_ua)
    whole_pc = cap_pc(table, width_us, made)
    for is_anodic in (True, False):
        way = [phase for phase in body if phase.is_anodic is is_anodic]
        charge_pc = sum(phase.charge_pc for phase in way)
        assert charge_pc <= times * wanted_ua * width_us + led_ua * led_us + 2.0
        assert charge_pc <= min(whole_pc, MAX_PC) + 2.0
        assert sum(phase.width_us for phase in way) <= times * width_us + led_us + 0.1


def check_story(player: Player, table: Settings, armed_ns: int) -> None:
    for ref, sent in player.sent.items():
        error = player.rig.answers[ref].error
        if error != "halted":
            assert (error == "bad_frame") == is_named_and_narrowed(sent, table)
        else:
            assert player.rig.state == "HALTED", "samples that no skin makes"
    accepted = player.accepted
    by_seq = {sent.seq: sent for sent in accepted}
    grace_ns = GRACE_NS[table.bursts is not None]
    checked = partial(check, table=table, made=player.calibration)
    for visit in visits(phases(player.rig, armed_ns)):
        begun_ns, seq, electrode = visit[0].from_ns, visit[0].seq, visit[0].electrode
        assert seq is not None
        assert electrode is not None
        opened_ua = RISE_UA * ((begun_ns - armed_ns) // RISE_NS + 1)
        standing = by_seq[seq]
        checked(standing, visit, opened_ua=opened_ua)
        come = [sent for sent in accepted if standing.sent_ns < sent.sent_ns <= begun_ns - grace_ns]
        if come and standing.current_ua[electrode]:
            checked(come[-1], visit, opened_ua=opened_ua)


@settings(
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(
    table=tables(),
    polarity=st.sampled_from(["anodic", "cathodic", "biphasic"]),
    by=calibrations,
    story=stories,
)
def test_no_law_gets_more_and_no_fall_is_delayed_whatever_it_is_told(
    table: Settings, polarity: str, by: Any, story: list[tuple[Any, Any, int]]
) -> None:
    rig = engine_rig.make(loaded=loaded_with(table))
    made = open_lease(rig, table, polarity, by)
    rig.arm()
    armed_ns = rig.clock.now_ns()
    player = Player(rig, polarity, Pressed(), made)
    rig.engine.components.adapter._pressure_source = player.pressed
    player.show(only(N, e0=1), 20, is_level=False)
    rig.run_ms(200)
    at_ns = rig.clock.now_ns()
    for frame, happening, lasts_ms in story:
        rig.clock.at(at_ns, partial(player.happen, happening))
        rig.clock.at(at_ns, partial(player.show, *frame))
        at_ns += int((lasts_ms + 0.3) * MS)
    rig.run_ms((at_ns - rig.clock.now_ns()) / MS + 20)
    assert set(player.sent) <= set(rig.answers), "each was answered"
    check_story(player, table, armed_ns)
    for fault in player.faults:
        rig.fake.world.take_out(fault)
    assert rig.close() == ()
