"""A board in order passes: whatever its constants are within what the board file allows for."""

from __future__ import annotations

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from etd.files.configuration import fake_config
from etd.selftest import adcbits
from etd.selftest.fixture import Fixture
from etd.selftest.ladder import climb, largest_here_ohm, largest_ohm
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd.selftest.report import Check
from etd.selftest.subject import strongest_ua
from etd_hal.fake.faults import AdcBitStuck, DacGain, Fault
from selftest_rig import ARRAY, LOAD_OHM, bad, selftest_rig

BOARDS = ("kajimoto-hv507", "etactilekit-hv513")
#: They have their current paths from these, and take longer: one corner each.
OTHERS = ("reference-hv507", "feetthrough-relay", "etactilekit-hv513-x2", "etactilekit-hv513-x8")
#: Leak, uA a code, and what the switches add to the load; the product of the first two is what an
#: open node shows, and is within the tolerance as well. What the
#: switches add looks like more current.
CORNERS = (
    (0.92, 1.0, 0),
    (1.08, 1.0, 1_000),
    (1.0, 0.92, 0),
    (1.0, 1.07, 500),
    (0.93, 1.07, 300),
    (1.08, 0.92, 500),
)


def largest(board: str) -> int:
    loaded = fake_config(board, ARRAY)
    most_ohm = largest_ohm(loaded.board.source, strongest_ua(loaded))
    assert most_ohm is not None
    return most_ohm


@pytest.mark.parametrize(("leak", "gain", "series_ohm"), CORNERS)
@pytest.mark.parametrize("board", BOARDS)
def test_a_board_at_a_corner_of_its_tolerances_passes(
    board: str, leak: float, gain: float, series_ohm: int
) -> None:
    rig = selftest_rig(
        board,
        load_ohm=33_000,
        leak_factor=leak,
        faults=[DacGain(gain)],
        really_ohm={33_000: 33_000 + series_ohm},
    )
    report = rig.run()
    assert (bad(report), report.passed) == ([], True)


@pytest.mark.parametrize("board", OTHERS)
def test_every_other_shipped_board_passes_at_a_corner(board: str) -> None:
    assert selftest_rig(board, load_ohm=33_000, leak_factor=1.08).run().passed


@pytest.mark.parametrize(
    ("leak", "gain"), [(1.0, 1.0), (1.02, 1.0), (0.98, 1.02), (1.08, 0.93), (0.92, 1.0)]
)
@pytest.mark.parametrize("board", ["kajimoto-hv507", "etactilekit-hv513"])
def test_with_the_largest_load_a_board_that_is_a_little_off_passes(
    board: str, leak: float, gain: float
) -> None:
    rig = selftest_rig(board, load_ohm=largest(board), leak_factor=leak, faults=[DacGain(gain)])
    assert bad(rig.run()) == []


def test_a_strong_source_that_cannot_reach_its_top_is_told_a_load_that_will_do() -> None:
    board, strong = "etactilekit-hv513", DacGain(1.08)
    report = selftest_rig(board, faults=[strong]).run()
    assert bad(report) == [("source", "steps")]
    advice = next(check.advice for check in report.checks if check.result == "fail")
    assert advice.startswith("test again with a --dummy-load of at most ")
    most_ohm = int(advice.split()[8])
    assert most_ohm < LOAD_OHM < largest(board)
    assert selftest_rig(board, faults=[strong], load_ohm=most_ohm).run().passed


def bits_check(board: str, load_ohm: int, leak: float, faults: list[Fault]) -> tuple[Check, int]:
    """The check after the ladder, and how many pulses both took."""
    rig = selftest_rig(board, load_ohm=load_ohm, leak_factor=leak, faults=faults)
    assert rig.options.load is not None
    fixture, log = Fixture(rig.loaded, rig.bench, rig.operator, rig.options), CheckLog()
    prober = Prober(fixture)
    fixture.board.calibrate()
    fixture.supply_on()
    fixture.wait_ms(1_000)
    fixture.is_load_confirmed, log.stage = True, "source"
    beside_ohm = 1 / (1 / load_ohm + 1 / (fixture.leak_ohm * leak))
    rungs = climb(fixture, log, prober, rig.options.load, beside_ohm, prober.strongest_ua)
    read_v = [rung.shot.voltage_v for rung in rungs]
    adcbits.check(fixture, log, prober, rig.options.load, read_v, beside_ohm / 1e6)
    return log.checks[-1], rig.watch.pulses


@given(
    board=st.sampled_from(("kajimoto-hv507", "feetthrough-relay", "etactilekit-hv513")),
    load_ohm=st.integers(10_000, 40_000),
    leak=st.floats(0.9, 1.1),
    gain=st.floats(0.92, 1.08),
)
@example(board="kajimoto-hv507", load_ohm=10_000, leak=0.92, gain=1.0)
@example(board="etactilekit-hv513", load_ohm=24_484, leak=1.0, gain=1.0)
@settings(max_examples=60, deadline=None)
def test_no_load_and_no_board_in_order_hides_a_bit_of_the_adc(
    board: str, load_ohm: int, leak: float, gain: float
) -> None:
    check, pulses = bits_check(board, load_ohm, leak, [DacGain(gain)])
    assert (check.name, check.result) == ("adc_bits", "pass"), check.measured
    assert pulses <= 16 + 4 * 8 + 2 * 16


@pytest.mark.parametrize("level", [0, 1])
@pytest.mark.parametrize("bit", range(5))
@pytest.mark.parametrize("board", ["kajimoto-hv507", "etactilekit-hv513"])
def test_a_low_bit_that_stands_still_is_named_with_its_number(
    board: str, bit: int, level: int
) -> None:
    stuck = AdcBitStuck(bit, 1 if level else 0)
    check, _ = bits_check(board, 33_000, 1.0, [stuck])
    assert (check.name, check.result) == ("adc_bits", "fail")
    assert check.measured.startswith(f"bits [{bit}] constant")


def test_the_largest_load_of_a_board_as_measured_follows_its_source_and_leak() -> None:
    rig = selftest_rig("etactilekit-hv513")
    fixture = Fixture(rig.loaded, rig.bench, rig.operator, rig.options)
    named_ohm = largest_here_ohm(fixture, 8_000)
    assert named_ohm == largest("etactilekit-hv513")
    fixture.gain = 1.08
    assert largest_here_ohm(fixture, 8_000) == 43_013
    fixture.leak_ohm *= 0.9
    assert largest_here_ohm(fixture, 8_000) == 46_371
