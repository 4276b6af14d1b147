"""What each return of a pulse carries where skin differs, on the wires and by the skin itself."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Iterator, Sequence
from contextlib import closing

import msgspec
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st

import engine_rig
from charge_witness import Witness
from engine_rig import EngineRig
from engine_scenes import (
    MS,
    calibration,
    clamps,
    config,
    felt_ua,
    only,
    open_calibrated,
    opened_to,
    phases,
    shortfalls,
)
from etd.protocol.frame import Polarity
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.settings import Settings
from etd_body.electrode import OPEN_CONTACT, Contact, load, skin
from etd_body.minimal import MinimalBody
from trace_decoder import Phase

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 16
DRY, WET = load(152_000), load(2_000)
EVEN = skin()
#: Of a current that a return carries, by what floating point leaves out.
ROUNDING = 1e-6


def calibrated(rig: EngineRig, contacts: Sequence[Contact], caps_ua: Sequence[int]) -> EngineRig:
    """Armed on this skin with these caps, the opening wide."""
    for electrode, contact in enumerate(contacts):
        rig.fake.world.touch(electrode, contact)
    answer = open_calibrated(rig, calibration(rig, caps_ua))
    assert answer.error is None, answer.reason
    rig.arm()
    opened_to(rig, max(caps_ua))
    return rig


def carried_ua(rig: EngineRig, since_ns: int = 0) -> list[float]:
    """The most that each electrode carried as a return; nothing of it is taken for the leak."""
    count = len(rig.engine.components.loaded.array.outputs())
    found = [0.0] * count
    conductance_s = [
        rig.fake.world.body.contact(electrode).conductance_s for electrode in range(count)
    ]
    for phase, beside_s in returning(rig, conductance_s, since_ns):
        for other in range(count):
            if other != phase.electrode:
                part = conductance_s[other] / beside_s
                found[other] = max(found[other], phase.current_ua * part)
    return found


def returning(
    rig: EngineRig, conductance_s: Sequence[float], since_ns: int
) -> Iterator[tuple[Phase, float]]:
    """Pulses through all others, and what these conduct together; where that is something."""
    for phase in phases(rig, since_ns):
        assert phase.electrode is not None
        beside_s = sum(conductance_s) - conductance_s[phase.electrode]
        if conductance_s[phase.electrode] > 0.0 and beside_s > 0.0:
            yield phase, beside_s


def test_a_return_that_conducts_better_than_the_others_is_held_to_its_cap(
    make_rig: MakeRig,
) -> None:
    contacts = [WET if electrode == 3 else DRY for electrode in range(N)]
    caps_ua = [100 if electrode == 3 else 4_000 for electrode in range(N)]
    rig = calibrated(make_rig(electrodes=N), contacts, caps_ua)
    rig.hold(1_500, current_ua=only(N, e5=3_000), rate_hz=50.0)
    assert carried_ua(rig)[3] <= 100
    told = [clamp for clamp in clamps(rig) if clamp.reason == "return_cap" and clamp.electrode == 5]
    assert {clamp.limited_by for clamp in told} == {3}
    assert max(phase.current_ua for phase in phases(rig) if phase.electrode == 5) > 90


def test_an_open_one_that_is_touched_is_held_to_its_cap_before_a_poll_tells_the_touch(
    make_rig: MakeRig,
) -> None:
    contacts = [OPEN_CONTACT if electrode > 4 else EVEN for electrode in range(N)]
    caps_ua = [50 if electrode == 7 else 4_000 for electrode in range(N)]
    rig = calibrated(make_rig(electrodes=N), contacts, caps_ua)
    rig.hold(1_500, current_ua=only(N, e2=3_000), rate_hz=50.0)
    since_ns = rig.clock.now_ns()
    rig.fake.world.touch(7, EVEN)
    rig.hold(1_500, current_ua=only(N, e2=3_000), rate_hz=50.0)
    assert 25 < carried_ua(rig, since_ns)[7] <= 50


def test_the_return_that_comes_to_its_cap_first_is_named_and_not_the_one_with_the_smallest(
    make_rig: MakeRig,
) -> None:
    contacts = [WET if electrode == 3 else DRY for electrode in range(N)]
    caps_ua = [
        1_000 if electrode == 3 else 400 if electrode == 9 else 4_000 for electrode in range(N)
    ]
    rig = calibrated(make_rig(electrodes=N), contacts, caps_ua)
    since_ns = rig.clock.now_ns()
    rig.hold(300, current_ua=only(N, e5=3_000), width_us=100, rate_hz=50.0)
    told = [clamp for clamp in clamps(rig) if clamp.reason == "return_cap" and clamp.electrode == 5]
    assert {clamp.limited_by for clamp in told} == {3}
    assert carried_ua(rig)[3] <= 1_000
    # 3 carries 84 parts in a hundred.
    assert max(phase.current_ua for phase in phases(rig, since_ns)) == pytest.approx(1_150, abs=60)


series = st.floats(1e3, 3e3)
ohms = st.floats(math.log(2e3), math.log(5e5)).map(math.exp)
contacts = st.one_of(
    ohms.map(load),
    st.builds(skin, series, ohms, st.floats(0.05, 0.5)),
    st.just(EVEN),
    st.just(OPEN_CONTACT),
)
frames = st.fixed_dictionaries(
    {
        "wanted": st.sets(st.integers(0, 7), min_size=1),
        "strength_ua": st.sampled_from([200, 800, 2_500, 4_000]),
        "width_us": st.sampled_from([20, 30, 50, 100]),
        "rate_hz": st.sampled_from([10.0, 30.0]),
        "polarity": st.sampled_from(["anodic", "cathodic", "biphasic"]),
        "pause_ms": st.sampled_from([0, 0, 300, 1_200]),
    }
)


@settings(
    deadline=None,
    max_examples=25,
    suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large],
)
@given(
    skins=st.lists(contacts, min_size=8, max_size=8),
    caps_ua=st.lists(st.sampled_from([50, 100, 300, 1_000, 4_000]), min_size=8, max_size=8),
    shown=st.lists(frames, min_size=1, max_size=4),
    is_led=st.booleans(),
    is_probe_first=st.booleans(),
)
def test_on_whatever_skin_no_return_ever_gets_more_than_its_cap(
    skins: list[Contact],
    caps_ua: list[int],
    shown: list[dict[str, object]],
    is_led: bool,
    is_probe_first: bool,
) -> None:
    loaded = config(electrodes=8)
    table = Settings(
        order=("prepulse",) if is_led else (),
        prepulse=Prepulse(below_db=6.0, width_us=40) if is_led else None,
        probe_first=is_probe_first,
    )
    site = msgspec.structs.replace(loaded.body_site, stabilize=table)
    with closing(engine_rig.make(loaded=dataclasses.replace(loaded, body_site=site))) as rig:
        for electrode, contact in enumerate(skins):
            rig.fake.world.touch(electrode, contact)
        made = calibration(rig, caps_ua, shape=table.shape)
        assert open_calibrated(rig, made).error is None
        rig.arm()
        opened_to(rig, max(caps_ua))
        for one in shown:
            hold(rig, one)
        assert rig.state == "ARMED"
        for electrode, most_ua in enumerate(carried_ua(rig)):
            assert most_ua <= caps_ua[electrode] + ROUNDING, f"electrode {electrode}"


def hold(rig: EngineRig, shown: dict[str, object]) -> None:
    wanted, strength_ua = shown["wanted"], shown["strength_ua"]
    assert isinstance(wanted, set)
    fields = {key: shown[key] for key in ("width_us", "rate_hz", "polarity")}
    current_ua = tuple(strength_ua if electrode in wanted else 0 for electrode in range(8))
    try:
        rig.hold(150, current_ua=current_ua, allow_slower=True, **fields)
    except AssertionError as refusal:
        # On skin this uneven a frame of one polarity may be more direct current than is allowed.
        assume("net charge" not in str(refusal))
        raise
    pause_ms = shown["pause_ms"]
    assert isinstance(pause_ms, int)
    if pause_ms:
        silent = {"current_ua": (0,) * 8, "ttl_ms": 20}
        rig.hold(pause_ms, **silent)


@pytest.mark.parametrize("width_us", [20, 100])
@pytest.mark.parametrize("polarity", ["anodic", "cathodic", "biphasic"])
def test_a_sweep_over_all_electrodes_breaks_no_cap(
    make_rig: MakeRig, width_us: int, polarity: Polarity
) -> None:
    """Each is stimulated strongly in its turn, while the others go unread for longer and longer."""
    contacts = [
        WET if electrode == 3 else skin(2e3, 20e3 + 9e3 * electrode, 0.3) for electrode in range(N)
    ]
    caps_ua = [200 if electrode in (3, 7) else 4_000 for electrode in range(N)]
    rig = calibrated(make_rig(electrodes=N), contacts, caps_ua)
    for electrode in [*range(N), *range(N)]:
        wanted = tuple(4_000 if other == electrode else 0 for other in range(N))
        rig.hold(
            180,
            current_ua=wanted,
            width_us=width_us,
            rate_hz=30.0,
            polarity=polarity,
            allow_slower=True,
        )
    for electrode, most_ua in enumerate(carried_ua(rig)):
        assert most_ua <= caps_ua[electrode] + ROUNDING


def test_a_return_that_comes_to_conduct_better_is_found_within_a_second(make_rig: MakeRig) -> None:
    caps_ua = [100 if electrode == 3 else 4_000 for electrode in range(N)]
    rig = calibrated(make_rig(electrodes=N), [EVEN] * N, caps_ua)
    frame = {"current_ua": only(N, e5=3_000), "rate_hz": 30.0}
    rig.hold(1_000, **frame)
    rig.fake.world.touch(3, WET)
    rig.hold(1_000, **frame)
    since_ns = rig.clock.now_ns()
    rig.hold(300, **frame)
    assert carried_ua(rig, since_ns)[3] <= 100


def test_an_electrode_that_a_frame_stimulates_gets_no_poll_even_if_its_pulses_cannot_be_read() -> (
    None
):
    """Behind a prepulse, with no sample near their end: a probe would be felt beside them."""
    loaded = config(electrodes=N)
    table = Settings(order=("prepulse",), prepulse=Prepulse(below_db=6.0, width_us=40))
    site = msgspec.structs.replace(loaded.body_site, stabilize=table)
    caps_ua = [2_000 if electrode == 6 else 4_000 for electrode in range(N)]
    with closing(engine_rig.make(loaded=dataclasses.replace(loaded, body_site=site))) as rig:
        made = calibration(rig, caps_ua, shape=table.shape)
        assert open_calibrated(rig, made).error is None
        rig.arm()
        opened_to(rig, 4_000)
        frame = {"current_ua": only(N, e5=3_000, e6=40), "width_us": 20, "rate_hz": 20.0}
        rig.hold(1_200, **frame)
        since_ns = rig.clock.now_ns()
        rig.hold(1_000, **frame)
        found_ua = felt_ua(rig, since_ns)
        assert set(found_ua) == set(range(N))
        assert found_ua[6] <= 40
        # For more than a second nothing is known of 6: its cap bounds the pulses of 5.
        assert found_ua[5] <= 2_000
        assert {clamp.limited_by for clamp in clamps(rig) if clamp.electrode == 5} == {6}


def test_after_a_lift_nothing_that_was_known_of_the_others_counts(make_rig: MakeRig) -> None:
    caps_ua = [300 if electrode == 3 else 4_000 for electrode in range(N)]
    rig = calibrated(make_rig(electrodes=N), [EVEN] * N, caps_ua)
    frame = {"current_ua": only(N, e5=3_000, e6=3_000), "width_us": 50, "rate_hz": 50.0}
    rig.hold(600, **frame)
    assert max(phase.current_ua for phase in phases(rig) if phase.electrode == 5) > 2_500
    for electrode in set(range(N)) - {3, 5}:
        rig.fake.world.lift(electrode)
    lifted_ns = rig.clock.now_ns()
    rig.hold(600, **frame)
    found = [phase for phase in phases(rig, lifted_ns) if phase.electrode == 5]
    # 6 tells in its next pulse that it was lifted.
    after = [phase.current_ua for phase in found if phase.from_ns > lifted_ns + 45 * MS]
    assert max(after) <= 300


def test_behind_probes_paths_are_read_from_the_pulses() -> None:
    """A probe is weak, and has no sample near its end: it bounds contacts within ten times, and a
    frame for all of them was refused by what the best of them might carry back.
    """
    loaded = config(electrodes=8)
    site = msgspec.structs.replace(loaded.body_site, stabilize=Settings(probe_first=True))
    contacts = [skin(2e3, 60e3 + 9e3 * electrode, 0.3) for electrode in range(8)]
    with closing(engine_rig.make(loaded=dataclasses.replace(loaded, body_site=site))) as rig:
        for electrode, contact in enumerate(contacts):
            rig.fake.world.touch(electrode, contact)
        made = calibration(rig, [4_000] * 8, shape=site.stabilize.shape)
        assert open_calibrated(rig, made).error is None
        rig.arm()
        opened_to(rig, 4_000)
        rig.hold(1_500, current_ua=(3_000,) * 8, width_us=100, rate_hz=10.0)
        share = rig.engine.components.returns.share
        for contact, least_s, most_s in zip(contacts, share.least_s, share.most_s, strict=True):
            assert least_s <= contact.conductance_s <= most_s <= 1.5 * least_s
        since_ns = rig.clock.now_ns()
        rig.hold(500, current_ua=(3_000,) * 8, width_us=100, rate_hz=10.0)
        assert {phase.current_ua < 1_000 for phase in phases(rig, since_ns)} == {True, False}


# --- the ledger -----------------------------------------------------------------------------------


@settings(deadline=None, max_examples=15, suppress_health_check=[HealthCheck.too_slow])
@given(
    resistances=st.lists(ohms, min_size=8, max_size=8),
    shown=st.lists(frames, min_size=1, max_size=4),
)
def test_on_whatever_skin_nobody_gets_a_charge_that_is_not_in_the_ledger(
    resistances: list[float], shown: list[dict[str, object]]
) -> None:
    loaded = config(electrodes=8)
    body = MinimalBody(
        [load(ohm) for ohm in resistances],
        leak_ohm=loaded.board.source.leak_ohm,
        compliance_v=loaded.board.source.compliance_v,
    )
    witness = Witness(body)
    made = engine_rig.make(loaded=loaded, body=body, wrap=witness.wrap, is_traced=False)
    with closing(made) as rig:
        witness.begin(rig.engine.components.ledger, 100_000)
        assert open_calibrated(rig, calibration(rig, [4_000] * 8)).error is None
        rig.arm()
        opened_to(rig, 4_000)
        most_pc = rig.engine.components.maxima.now.mean_current_ua * 1_000_000
        for one in shown:
            hold(rig, one)
            witness.look("after a frame")
            assert max(witness.got_pc()) <= most_pc
        assert witness.shortfalls == []


def test_one_that_conducts_better_does_not_take_the_room_of_all(make_rig: MakeRig) -> None:
    """It carries most of what the others get, until its own second is full: no more is lost. Of
    direct current it would have too much: these pulses leave none.
    """
    contacts = [WET if electrode == 3 else DRY for electrode in range(N)]
    rig = calibrated(make_rig(electrodes=N), contacts, [4_000] * N)
    wanted = only(N, e5=2_000, e6=2_000)
    rig.hold(2_500, current_ua=wanted, width_us=100, rate_hz=25.0, polarity="biphasic")
    # 20 uA in all, of which 3 has 17: of 30.
    assert shortfalls(rig) == []


def test_on_even_skin_a_full_array_loses_nothing_to_the_ledger(make_rig: MakeRig) -> None:
    """64 electrodes, 2 mA for 100 us at 45 Hz: 9 uA each as stimulated ones, 9 more as returns."""
    rig = calibrated(make_rig(electrodes=64), [EVEN] * 64, [4_000] * 64)
    rig.hold(2_500, current_ua=(2_000,) * 64, width_us=100, rate_hz=45.0)
    assert [shortfall for shortfall in shortfalls(rig) if shortfall.reason == "ledger"] == []
    ledger = rig.engine.components.ledger
    now_ns = rig.clock.now_ns()
    carried_pc = [ledger.charge_pc(electrode, now_ns) for electrode in range(64)]
    assert max(carried_pc) <= 18_000_000 * 1.06
