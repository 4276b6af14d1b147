"""The walk over the electrodes: who is asked for must answer, alone, on two loads."""

from __future__ import annotations

from typing import Any, Literal

import pytest

from etd_hal.fake.faults import AlsoSwitches, OutputsSwapped
from selftest_rig import LOAD_OHM, SECOND_OHM, SelftestRig, bad, selftest_rig

SECOND = 1_000_000_000
BOARDS = ("reference-hv507", "feetthrough-relay")


class Operator:
    """Does what is asked, unless a test says otherwise; what it was asked for and told is kept."""

    def __init__(self, rig: SelftestRig) -> None:
        self.rig, self._hand = rig, rig.operator
        self.clips: list[tuple[int, int, int]] = []
        self.told: list[tuple[int, tuple[int, ...]]] = []

    def __getattr__(self, name: str) -> Any:
        return getattr(self._hand, name)

    def clip(self, load_ohm: int, first: int, second: int) -> None:
        self.clips.append((load_ohm, first, second))
        self.put(load_ohm, first, second)

    def put(self, load_ohm: int, first: int, second: int) -> None:
        assert self._hand is not None
        self._hand.clip(load_ohm, first, second)

    def misplaced(self, asked: int, found: tuple[int, ...]) -> None:
        self.told.append((asked, found))

    def in_s(self, seconds: float, *put: int) -> None:
        """Put it there after a while."""
        at_ns = self.rig.clock.now_ns() + int(seconds * SECOND)
        self.rig.clock.at(at_ns, lambda: self.put(*put))


def measured(rig: SelftestRig, name: str) -> str:
    """Of the check of this name that failed."""
    report = rig.run()
    found = [
        check.measured for check in report.checks if (check.name, check.result) == (name, "fail")
    ]
    assert found, bad(report)
    return found[0]


@pytest.mark.parametrize("board", BOARDS)
def test_every_electrode_is_asked_for_once_with_each_load(board: str) -> None:
    rig = selftest_rig(board)
    rig.operator = operator = Operator(rig)
    assert rig.run().passed
    others = [electrode for electrode in range(16) if electrode != 1]
    # Half-bridges have had it on ground before.
    back = [(LOAD_OHM, 1, 2)] if board == "reference-hv507" else []
    assert operator.clips == [
        *back,
        *((LOAD_OHM, 1, electrode) for electrode in others),
        (SECOND_OHM, 1, 2),
        *((SECOND_OHM, 1, electrode) for electrode in others),
        (LOAD_OHM, 1, 2),
    ]
    assert operator.told == []


class Misled(Operator):
    """Goes to 9 when it is asked for 5, until it is told."""

    def put(self, load_ohm: int, first: int, second: int) -> None:
        super().put(load_ohm, first, 9 if second == 5 and not self.told else second)

    def misplaced(self, asked: int, found: tuple[int, ...]) -> None:
        super().misplaced(asked, found)
        load_ohm, first, _ = self.clips[-1]
        self.in_s(2.0, load_ohm, first, asked)


def test_a_touch_in_the_wrong_place_is_told_and_may_be_put_right() -> None:
    rig = selftest_rig()
    rig.operator = operator = Misled(rig)
    assert rig.run().passed
    assert operator.told == [(5, (9,))]


class Slow(Operator):
    """Still where it was for two seconds."""

    def clip(self, load_ohm: int, first: int, second: int) -> None:
        self.clips.append((load_ohm, first, second))
        self.in_s(2.0, load_ohm, first, second)


def test_a_hand_that_is_on_its_way_is_told_nothing() -> None:
    rig = selftest_rig()
    rig.operator = operator = Slow(rig)
    assert rig.run().passed
    assert operator.told == []


@pytest.mark.parametrize("board", BOARDS)
def test_swapped_wires_are_told_at_once_and_named_both_when_time_is_over(board: str) -> None:
    rig = selftest_rig(board, faults=[OutputsSwapped(5, 9)])
    rig.operator = operator = Operator(rig)
    said = measured(rig, "every_switch")
    assert operator.told == [(5, (9,))]
    assert said.startswith("electrode 5 reads ")
    assert said.endswith("; 9 reads the load instead")


class Bridging(Operator):
    """With the first load its tip is on 6 and 7 for so long when 6 is asked for."""

    seconds = 5.0

    def put(self, load_ohm: int, first: int, second: int) -> None:
        super().put(load_ohm, first, second)
        if (load_ohm, second) == (LOAD_OHM, 6):
            self.rig.fake.world.put_in(AlsoSwitches(7, 6))
            ends_ns = self.rig.clock.now_ns() + int(self.seconds * SECOND)
            self.rig.clock.at(ends_ns, self._off)

    def _off(self) -> None:
        self.rig.fake.world.take_out(AlsoSwitches(7, 6))


def test_two_that_answer_together_are_looked_at_again_until_time_is_over() -> None:
    rig = selftest_rig()
    rig.operator = Bridging(rig)
    assert rig.run().passed


def test_two_that_go_on_answering_together_are_named() -> None:
    rig = selftest_rig()
    rig.operator = Bridging(rig)
    rig.operator.seconds = 31.0
    assert measured(rig, "one_at_a_time") == "with electrode 6: 7"


@pytest.mark.parametrize(
    ("fault", "said"),
    [
        (AlsoSwitches(5, 6), "with electrode 6: 5"),
        (AlsoSwitches(6, 5), "with electrode 5: 6"),
        (AlsoSwitches(1, 6), "with electrode 6: 1"),
    ],
)
def test_who_switches_along_is_found_from_whichever_side_it_can_be(
    fault: AlsoSwitches | OutputsSwapped, said: str
) -> None:
    """1 is the load's fixed end: it must read the load at every touch."""
    assert measured(selftest_rig(faults=[fault]), "one_at_a_time") == said


@pytest.mark.parametrize(
    ("polarity", "others", "loads"),
    [
        ("anodic", (5, 6), [LOAD_OHM]),
        ("anodic", (1, 6), [LOAD_OHM]),
        ("cathodic", (5, 6), [LOAD_OHM, SECOND_OHM]),
        ("cathodic", (1, 6), [LOAD_OHM, SECOND_OHM]),
    ],
)
def test_who_switches_along_in_one_polarity_is_found_in_one_of_the_walks(
    polarity: Literal["anodic", "cathodic"], others: tuple[int, int], loads: list[int]
) -> None:
    rig = selftest_rig(faults=[AlsoSwitches(*others, polarity)])
    rig.operator = operator = Operator(rig)
    assert measured(rig, "one_at_a_time") == f"with electrode 6: {others[0]}"
    assert list(dict.fromkeys(load_ohm for load_ohm, _, _ in operator.clips)) == loads


class Hasty(Operator):
    """Takes the tip away from 6 at the third pulse after it was asked for, for a second."""

    for_s = 1.0
    at_pulse = 3

    def clip(self, load_ohm: int, first: int, second: int) -> None:
        super().clip(load_ohm, first, second)
        if (load_ohm, second) == (LOAD_OHM, 6):
            self.rig.watch.before_pulse[self.rig.watch.pulses + self.at_pulse] = self._lift

    def _lift(self) -> None:
        self.rig.fake.world.lift(6)
        self.in_s(self.for_s, *self.clips[-1])


def test_a_touch_that_ends_before_the_round_over_the_others_does_not_count() -> None:
    rig = selftest_rig(faults=[AlsoSwitches(7, 6)])
    rig.operator = Hasty(rig)
    assert measured(rig, "one_at_a_time") == "with electrode 6: 7"


def test_a_touch_that_is_over_too_soon_is_asked_for_until_time_is_over() -> None:
    rig = selftest_rig()
    rig.operator = Hasty(rig)
    rig.operator.for_s = 31.0
    said = measured(rig, "every_switch")
    assert said.startswith("electrode 6 reads ")
    assert "instead" not in said


class Flickering(Hasty):
    """The same at each touch, in the round over the others: a tip that slides off and on."""

    for_s = 0.03
    at_pulse = 12

    def put(self, load_ohm: int, first: int, second: int) -> None:
        super().put(load_ohm, first, second)
        if second == 6:
            self.rig.watch.before_pulse[self.rig.watch.pulses + self.at_pulse] = self._lift


def test_a_tip_that_slides_off_again_and_again_is_said_to_be_let_go_of() -> None:
    rig = selftest_rig()
    rig.operator = Flickering(rig)
    assert "released before all others" in measured(rig, "every_switch")


def test_without_a_second_load_the_second_walk_is_a_skip_that_says_what_to_add() -> None:
    report = selftest_rig(second_ohm=None).run()
    skipped = [check for check in report.checks if check.result == "skip"]
    assert [check.name for check in skipped] == ["second_load", "every_switch_again"]
    assert {check.advice for check in skipped} == {"--second-load OHM"}
    assert (bad(report), report.passed, report.second_load_ohm) == ([], False, None)


def test_the_report_names_both_loads() -> None:
    report = selftest_rig().run()
    assert (report.dummy_load_ohm, report.second_load_ohm) == (LOAD_OHM, SECOND_OHM)


class Lazy(Operator):
    """Leaves the first load where it is when the second one is asked for."""

    def put(self, load_ohm: int, first: int, second: int) -> None:
        super().put(LOAD_OHM, first, second)


def test_a_first_load_that_stays_is_no_second_one() -> None:
    rig = selftest_rig()
    rig.operator = Lazy(rig)
    assert measured(rig, "second_load") == "2.68 V and 2.68 V"


@pytest.mark.parametrize(("load_ohm", "second_ohm"), [(47_000, 31_000), (66_000, 100_000)])
def test_two_loads_that_the_command_takes_are_told_apart(load_ohm: int, second_ohm: int) -> None:
    rig = selftest_rig(load_ohm=load_ohm, second_ohm=second_ohm)
    assert rig.run().passed
    mixed_up = selftest_rig(
        load_ohm=load_ohm, second_ohm=second_ohm, really_ohm={second_ohm: load_ohm}
    )
    assert bad(mixed_up.run()) == [("switches", "second_load")]


def test_every_other_electrode_is_probed_at_every_touch() -> None:
    """With somebody in order: two walks of 15 touches, each with all 16 and three more."""
    pulses = []
    for second_ohm in (SECOND_OHM, None):
        rig = selftest_rig(second_ohm=second_ohm)
        rig.run()
        pulses.append(rig.watch.pulses)
    assert pulses[0] - pulses[1] >= 15 * (14 + 1 + 3)
