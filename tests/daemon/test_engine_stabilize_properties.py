"""Whatever the samples and sensors say, whatever the skin does and whichever laws there are, in any
order: nobody gets more than limits, opening and the frame's own most, and no fall is delayed.

The oracle is its own: it reads the wires, and reckons what a frame allows from the settings.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import msgspec
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import engine_rig
from engine_rig import EngineRig
from engine_scenes import MS, only, phases
from etd.config import LoadedConfig, fake_config
from etd.stabilize.bursts import Bursts
from etd.stabilize.contact import ContactLaw
from etd.stabilize.energy import EnergyLaw
from etd.stabilize.fitted import FittedLaw
from etd.stabilize.lines import LinesLaw
from etd.stabilize.narrow import Narrow
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.pressure import PressureLaw
from etd.stabilize.settings import Settings
from etd_body.electrode import OPEN_CONTACT, skin
from etd_hal.fake.faults import AdcScale, AdcStuck, Fault
from trace_decoder import Phase, is_led, visits

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
    st.builds(EnergyLaw, most_wider=wider, rise_per_s=fast).map(lambda law: {"energy": law}),
    st.builds(
        FittedLaw, k=st.sampled_from([-2.0, 1.0, 2.0]), most_wider=wider, rise_per_s=fast
    ).map(lambda law: {"fitted": law}),
    st.builds(
        LinesLaw,
        charge_slope=st.sampled_from([-0.5, 0.0, 1.0]),
        energy_slope=st.sampled_from([0.2, 2.0]),
        most_wider=wider,
        rise_per_s=fast,
    ).map(lambda law: {"lines": law}),
)
others: dict[str, st.SearchStrategy[Any]] = {
    "contact": st.builds(ContactLaw, rise_per_s=st.sampled_from([0.2, 10.0])),
    "pressure": st.builds(PressureLaw, rise_per_s=fast),
    "narrow": st.builds(
        Narrow, width_us=st.sampled_from([25, 50, 80]), tau_us=st.sampled_from([60.0, 151.0])
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
    laws = {name: draw(one) for name, one in others.items() if draw(st.booleans())}
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
    st.integers(0, 1_000).map(AdcStuck),
    st.sampled_from([None, 0.0, 30.0, 200.0]).map(lambda kpa: ("pressed", kpa)),
    st.none(),
)
frames = st.tuples(
    st.tuples(*[st.sampled_from([0, 50, 900, 2_000, 3_000])] * N),
    st.sampled_from([20, 40, 100, 150]),
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


@dataclass
class Player:
    """Sends the frames of a story at their time, which may be within a scan."""

    rig: EngineRig
    polarity: str
    pressed: Pressed
    sent: dict[int, Sent] = field(default_factory=dict)
    faults: list[Fault] = field(default_factory=list)

    def show(self, current_ua: tuple[int, ...], width_us: int) -> None:
        ref = self.rig.send(
            current_ua=current_ua,
            width_us=width_us,
            rate_hz=15.0,
            ttl_ms=1_000,
            polarity=self.polarity,
        )
        self.sent[ref] = Sent(self.rig.last_seq, current_ua, width_us, self.rig.clock.now_ns())

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
        return [one for ref, one in self.sent.items() if self.rig.answers[ref].error is None]


# --- the oracle ----------------------------------------------------------------------------------


def loaded_with(table: Settings) -> LoadedConfig:
    loaded = fake_config(electrodes=N)
    return replace(loaded, body_site=msgspec.structs.replace(loaded.body_site, stabilize=table))


def most_wider(table: Settings) -> float:
    laws = (table.energy, table.fitted, table.lines)
    return max((law.most_wider for law in laws if law is not None), default=1.0)


def rise_of(table: Settings, width_us: float) -> float:
    """How much stronger a pulse of the same height above its strength-duration curve is, if it is
    narrowed; where a law may have widened it before, from what that makes of it.
    """
    narrow, order = table.narrow, table.order
    if narrow is None:
        return 1.0
    if any(one in order[: order.index("narrow")] for one in ("energy", "fitted", "lines")):
        width_us *= most_wider(table)
    if width_us <= narrow.width_us:
        return 1.0
    return math.expm1(-width_us / narrow.tau_us) / math.expm1(-narrow.width_us / narrow.tau_us)


def check(frame: Sent, visit: tuple[Phase, ...], table: Settings, opened_ua: int) -> None:
    """One visit against one frame that stood when it began."""
    electrode = visit[0].electrode
    assert electrode is not None
    wanted_ua, width_us = frame.current_ua[electrode], frame.width_us
    strongest_ua = max(one.current_ua for one in visit)
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
    rise, pre, times = rise_of(table, width_us), table.prepulse, most_wider(table)
    led_ua, led_us = (wanted_ua * rise * pre.part, pre.width_us) if pre else (0.0, 0)
    assert strongest_ua <= min(CAP_UA, rise * wanted_ua)
    for is_anodic in (True, False):
        way = [one for one in body if one.is_anodic is is_anodic]
        charge_pc = sum(one.charge_pc for one in way)
        assert charge_pc <= times * wanted_ua * width_us + led_ua * led_us + 2.0
        assert charge_pc <= min(CAP_UA * width_us, MAX_PC) + 2.0
        assert sum(one.width_us for one in way) <= times * width_us + led_us + 0.1


def check_story(player: Player, table: Settings, armed_ns: int) -> None:
    accepted = player.accepted
    by_seq = {one.seq: one for one in accepted}
    grace_ns = GRACE_NS[table.bursts is not None]
    for visit in visits(phases(player.rig, armed_ns)):
        begun_ns, seq, electrode = visit[0].from_ns, visit[0].seq, visit[0].electrode
        assert seq is not None
        assert electrode is not None
        opened_ua = RISE_UA * ((begun_ns - armed_ns) // RISE_NS + 1)
        standing = by_seq[seq]
        check(standing, visit, table, opened_ua)
        come = [one for one in accepted if standing.sent_ns < one.sent_ns <= begun_ns - grace_ns]
        if come and standing.current_ua[electrode]:
            check(come[-1], visit, table, opened_ua)


@settings(
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(
    table=tables(),
    polarity=st.sampled_from(["anodic", "cathodic", "biphasic"]),
    story=stories,
)
def test_no_law_gets_more_and_no_fall_is_delayed_whatever_it_is_told(
    table: Settings, polarity: str, story: list[tuple[Any, Any, int]]
) -> None:
    rig = engine_rig.make(loaded=loaded_with(table))
    rig.open(CAP_UA, 190)
    rig.arm()
    armed_ns = rig.clock.now_ns()
    player = Player(rig, polarity, Pressed())
    rig.engine.asker._pressed = player.pressed
    player.show(only(N, e0=20), 100)
    rig.run_ms(200)
    at_ns = rig.clock.now_ns()
    for (current_ua, width_us), happening, lasts_ms in story:
        rig.clock.at(at_ns, partial(player.happen, happening))
        rig.clock.at(at_ns, partial(player.show, current_ua, width_us))
        at_ns += int((lasts_ms + 0.3) * MS)
    rig.run_ms((at_ns - rig.clock.now_ns()) / MS + 20)
    assert set(player.sent) <= set(rig.answers), "each was answered"
    check_story(player, table, armed_ns)
    for fault in player.faults:
        rig.fake.world.take_out(fault)
    assert rig.close() == ()
