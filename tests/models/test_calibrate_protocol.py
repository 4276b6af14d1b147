"""Calibrations over the protocol: real sockets, real engine, a body that feels, stepped time."""

from __future__ import annotations

import datetime
from collections.abc import Iterator, Sequence
from typing import Unpack

import msgspec
import pytest

from calibrated_body import CAP_UA, WIDTH_US, calibrate_body, conditions_of
from etd.calibrate.stimulator import NotDelivered, Stimulator
from etd.calibrate.trial import Stopped
from etd.client.options import FrameOptions
from etd.protocol.calibration import Calibration, ElectrodeLimits, Method
from etd.protocol.errors import Refused
from etd.protocol.messages import FrameReply
from etd.stabilize.bursts import Bursts
from etd.stabilize.law_settings import ContactSettings, EnergySettings
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.settings import Settings
from etd.stabilize.strength_duration import StrengthDuration
from etd_body.electrode import OPEN_CONTACT, skin
from stepped_daemon import SteppedDaemon, SteppedDisplay


@pytest.mark.parametrize(
    ("method", "electrodes"), [("limits", 4), ("staircase", 4), ("quest-plus", 2)]
)
def test_a_bodys_thresholds_are_found_over_the_protocol(method: Method, electrodes: int) -> None:
    found = calibrate_body("pad-8", (method,), range(electrodes), person_seed=7, body_seed=31)[
        method
    ]
    print(f"{method}: {found.presentations} presentations, worst {found.worst:.1%}")
    assert len(found.errors) == electrodes
    assert found.worst <= 0.10
    assert found.most_pain < 1.0
    assert found.left == {}


def test_an_electrode_is_made_as_strong_as_the_reference_over_the_protocol() -> None:
    methods: tuple[Method, ...] = ("staircase", "equalize")
    found = calibrate_body("pad-8", methods, range(5), person_seed=7, body_seed=32)["equalize"]
    print(f"equalize: {found.presentations} presentations, worst {found.worst:.1%}")
    assert len(found.errors) + len(found.weaker) == 4, "all but the reference"
    assert found.worst <= 0.10
    assert all(part > 0.9 for part in found.weaker.values()), "no cap of the baseline is passed"
    assert found.most_pain < 1.0


@pytest.fixture
def daemon() -> Iterator[SteppedDaemon]:
    with SteppedDaemon("pad-8") as made:
        yield made


def armed(daemon: SteppedDaemon) -> SteppedDisplay:
    display = SteppedDisplay(daemon, CAP_UA, WIDTH_US)
    display.arm()
    return display


def stimulator(daemon: SteppedDaemon, display: SteppedDisplay, stop_ns: int = 0) -> Stimulator:
    """Somebody wants to stop from `stop_ns` on; 0: never."""
    return Stimulator(
        display,
        display,
        daemon,
        conditions_of(daemon, "limits"),
        lambda: 0 < stop_ns <= daemon.now_ns(),
    )


def test_what_is_said_by_the_end_of_a_pause_is_heard_before_anything_is_presented(
    daemon: SteppedDaemon,
) -> None:
    display = armed(daemon)
    stimulating = stimulator(daemon, display, stop_ns=daemon.now_ns() + 400_000_000)
    with pytest.raises(Stopped):
        stimulating.pause(0.4)


def test_a_presentation_is_so_many_pulses_of_the_current_asked_for(daemon: SteppedDaemon) -> None:
    display = armed(daemon)
    stimulating = stimulator(daemon, display)
    stimulating.open()
    stimulating.present(3, 500)
    before = daemon.engine.components.reporter.counters["pulses"]
    clamped = daemon.engine.components.reporter.counters["clamped"]

    delivered = stimulating.present(3, 800)

    assert 790 <= delivered.current_ua <= 800
    assert delivered.resistance_ohm is not None
    assert daemon.engine.components.reporter.counters["pulses"] - before == 10
    assert daemon.engine.components.reporter.counters["clamped"] == clamped
    display.close()


def test_a_presentation_waits_until_the_net_charge_of_those_before_has_leaked(
    daemon: SteppedDaemon,
) -> None:
    display = SteppedDisplay(daemon, 2_500, 200)
    display.arm()
    conditions = msgspec.structs.replace(
        conditions_of(daemon, "limits"), width_us=200, cap_ua=2_500, pulses=10
    )
    stimulating = Stimulator(display, display, daemon, conditions, lambda: False)
    stimulating.open()
    for current_ua in (800, 1_200, 1_600, 2_000):
        stimulating.present(3, current_ua)
    # 5 uC each, of 10 that may be there.
    for _ in range(4):
        assert stimulating.present(3, 2_500).current_ua >= 2_490
    assert daemon.engine.components.reporter.counters["net_charge"] == 0
    display.close()


def test_all_electrodes_are_presented_at_once_each_at_its_own_current(
    daemon: SteppedDaemon,
) -> None:
    display = armed(daemon)
    stimulating = stimulator(daemon, display)
    stimulating.open()
    currents_ua = {electrode: 900 + 50 * electrode for electrode in range(8) if electrode != 5}
    for electrode in currents_ua:
        stimulating.present(electrode, currents_ua[electrode])
    before = daemon.engine.components.reporter.counters["pulses"]

    delivered = stimulating.present_whole(currents_ua)

    assert delivered.electrode == 7
    assert 1_240 <= delivered.current_ua <= 1_250
    assert daemon.engine.components.reporter.counters["pulses"] - before == 70
    display.close()


def test_all_electrodes_at_once_may_be_slower_and_it_is_told_how_much() -> None:
    with SteppedDaemon("grid-8x8") as daemon:
        display = armed(daemon)
        stimulating = stimulator(daemon, display)
        stimulating.open()
        delivered = stimulating.present_whole(dict.fromkeys(range(64), 700))
        assert delivered.rate_hz is not None
        assert 20.0 < delivered.rate_hz < 60.0
        display.close()


def test_a_silent_trial_fires_nothing_and_lasts_as_long_as_others(daemon: SteppedDaemon) -> None:
    display = armed(daemon)
    stimulating = stimulator(daemon, display)
    stimulating.open()
    begun_ns = daemon.now_ns()
    stimulating.present(3, 500)
    lasted_s = (daemon.now_ns() - begun_ns) / 1e9
    before = daemon.engine.components.reporter.counters["pulses"]

    silent = stimulating.silence(3)

    assert (silent.electrode, silent.current_ua) == (3, 0)
    assert (daemon.now_ns() - silent.begun_ns) / 1e9 == pytest.approx(lasted_s, abs=0.03)
    assert daemon.engine.components.reporter.counters["pulses"] == before
    display.close()


@pytest.mark.parametrize("current_ua", [1_500, CAP_UA])
def test_before_the_opening_nothing_is_taken_for_a_presentation(
    daemon: SteppedDaemon, current_ua: int
) -> None:
    counters = daemon.engine.components.reporter.counters
    before: list[int] = []

    class Counting(SteppedDisplay):
        def show_current(
            self, current_ua: Sequence[int], **options: Unpack[FrameOptions]
        ) -> FrameReply:
            before.append(counters["clamped"])
            return super().show_current(current_ua, **options)

    display = Counting(daemon, CAP_UA, WIDTH_US)
    display.arm()
    delivered = stimulator(daemon, display).present(3, current_ua)
    assert len(before) > 1
    assert counters["clamped"] == before[-1] > 0, "not one pulse of the last was less"
    assert current_ua - 10 <= delivered.current_ua <= current_ua
    display.close()


def test_a_current_far_above_all_before_takes_as_many_presentations_as_the_opening_has_steps(
    daemon: SteppedDaemon,
) -> None:
    """Of one pulse each: more of them than are tried where nothing changes."""
    array = daemon.loaded.array
    limits = ElectrodeLimits(threshold_ua=500, comfortable_ua=1_000, cap_ua=6_000)
    made = Calibration(
        participant="P01",
        body_site="fingertip",
        array=array.name,
        polarity="anodic",
        width_us=50,
        rate_hz=60.0,
        returns="all",
        date=datetime.date(2025, 3, 4),
        program="test",
        electrode=(limits,) * array.count,
    )
    display = armed(daemon)
    display.disarm()
    display.set_calibration("P01", made)
    display.close()
    display = SteppedDisplay(daemon, calibration="P01")
    display.arm()
    conditions = msgspec.structs.replace(
        conditions_of(daemon, "limits", pulses=1), width_us=50, cap_ua=6_000
    )
    stimulating = Stimulator(display, display, daemon, conditions, lambda: False)
    before = daemon.engine.components.reporter.counters["frames_shown"]
    assert 5_988 <= stimulating.present(3, 6_000).current_ua <= 6_000
    assert daemon.engine.components.reporter.counters["frames_shown"] - before > 8
    display.close()


NARROW = StrengthDuration(width_us=50, tau_us=151.0)
PREPULSE = Prepulse(below_db=6.0, width_us=40)
BURSTS = Bursts(pulses=2, rate_hz=300.0)


def test_pulses_that_would_be_made_narrower_and_stronger_are_not_presented() -> None:
    with SteppedDaemon(
        "pad-8", stabilize=Settings(order=("strength_duration",), strength_duration=NARROW)
    ) as daemon:
        display = armed(daemon)
        with pytest.raises(Refused, match="send width_us of at most 50") as refusal:
            stimulator(daemon, display).open()
        assert refusal.value.code == "bad_frame"
        display.close()


def test_pulses_that_a_stabilizer_has_made_others_are_no_presentation() -> None:
    law = Settings(order=("energy",), energy=EnergySettings())
    with SteppedDaemon("pad-8", stabilize=law) as daemon:
        daemon.fake.ask_body(lambda: daemon.body.touch(daemon.now_ns(), 3, skin(2e3, 2e4, 0.3)))
        display = armed(daemon)
        stimulating = stimulator(daemon, display)
        stimulating.open()
        # A contact is soft for its first second: nobody takes it for a reference before.
        for _ in range(8):
            stimulating.present(3, 800)
        daemon.fake.ask_body(lambda: daemon.body.touch(daemon.now_ns(), 3, skin(2e3, 4e4, 0.3)))
        with pytest.raises(NotDelivered, match=r"fired instead of (800 uA|100 us)"):
            stimulating.present(3, 800)
        display.close()


def test_the_shape_of_pulses_is_told_and_they_are_presented_in_it() -> None:
    settings = Settings(order=("prepulse",), prepulse=PREPULSE, bursts=BURSTS)
    with SteppedDaemon("pad-8", stabilize=settings) as daemon:
        display = SteppedDisplay(daemon, CAP_UA, WIDTH_US + PREPULSE.width_us)
        display.arm()
        told = display.greet()
        assert (told.shape, told.stabilizers) == (settings.shape, ("prepulse",))
        stimulating = stimulator(daemon, display)
        stimulating.open()
        assert 790 <= stimulating.present(3, 800).current_ua <= 800
        display.close()


def test_a_stop_during_a_presentation_halts_the_daemon_at_once(daemon: SteppedDaemon) -> None:
    display = armed(daemon)
    stimulator(daemon, display).open()
    stop_ns = daemon.now_ns() + 60_000_000
    before = daemon.engine.components.reporter.counters["pulses"]

    with pytest.raises(Stopped):
        stimulator(daemon, display, stop_ns).present(3, 800)

    assert daemon.engine.supervisor.states.state == "HALTED"
    assert daemon.engine.components.reporter.counters["pulses"] - before < 8
    assert daemon.now_ns() - stop_ns < 60_000_000


def test_a_halt_by_somebody_else_is_told(daemon: SteppedDaemon) -> None:
    display = armed(daemon)
    stimulating = stimulator(daemon, display)
    stimulating.open()
    SteppedDisplay(daemon, CAP_UA, WIDTH_US).stop()
    with pytest.raises(Refused, match="halted by stop"):
        stimulating.present(3, 800)


def test_an_electrode_without_contact_is_not_presented(daemon: SteppedDaemon) -> None:
    daemon.fake.ask_body(lambda: daemon.body.touch(daemon.now_ns(), 3, OPEN_CONTACT))
    display = armed(daemon)
    stimulating = stimulator(daemon, display)
    stimulating.open()
    with pytest.raises(NotDelivered, match="electrode 3"):
        stimulating.present(3, 800)
    assert stimulating.present(4, 800).electrode == 4
    display.close()


def test_nobody_answers_for_minutes_and_the_lease_stands(daemon: SteppedDaemon) -> None:
    display = armed(daemon)
    stimulating = stimulator(daemon, display)
    stimulating.open()
    for _ in range(400):
        stimulating.pause(0.3)
    assert stimulating.present(3, 800).electrode == 3
    display.close()


@pytest.mark.parametrize(
    ("is_probe_first", "shown"),
    [pytest.param(False, range(2, 7), id="soft"), pytest.param(True, range(1, 2), id="probed")],
)
def test_after_a_silence_a_law_of_contact_has_a_presentation_shown_again_and_a_probe_does_not(
    is_probe_first: bool, shown: range
) -> None:
    """As often as it takes until the contact counts as firm (`soften_ms`)."""
    law = Settings(order=("contact",), contact=ContactSettings(), probe_first=is_probe_first)
    with SteppedDaemon("pad-8", stabilize=law) as daemon:
        display = armed(daemon)
        stimulating = stimulator(daemon, display)
        stimulating.open()
        stimulating.present(3, 800)
        for _ in range(6):
            stimulating.pause(0.3)
        before = daemon.engine.components.reporter.counters["frames_shown"]

        delivered = stimulating.present(3, 800)

        assert 788 <= delivered.current_ua <= 800
        assert daemon.engine.components.reporter.counters["frames_shown"] - before in shown
        display.close()
