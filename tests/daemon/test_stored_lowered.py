"""What was too strong is taken from what is stored; what another program stored never rises."""

from __future__ import annotations

import datetime

import pytest
from msgspec.structs import replace

from calibrate_scenes import BASELINE, ROW
from etd.calibrate.conditions import identity
from etd.calibrate.progress import Progress
from etd.cli.stored_lowered import StoredLowered
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.errors import Refused

WAS = replace(BASELINE, is_whole_accepted=True)
LIMITS = WAS.electrode[0]
OTHERS = replace(WAS, participant="P02")
#: What another program stores meanwhile.
CORRECTED = replace(WAS, electrode=(replace(LIMITS, comfortable_ua=1_100, cap_ua=1_200),) * 4)


class Shelf:
    """A store of calibrations, for any program."""

    def __init__(self, **stored: Calibration) -> None:
        self.stored = stored
        self.sets = 0
        self.unreadable: set[str] = set()

    def calibrations(self) -> tuple[str, ...]:
        return tuple(self.stored)

    def calibration(self, name: str) -> Calibration:
        if name in self.unreadable:
            raise Refused("bad_calibration", "it cannot be read")
        return self.stored[name]

    def set_calibration(self, name: str, calibration: Calibration) -> None:
        self.sets += 1
        self.stored[name] = calibration


def caps(made: Calibration) -> list[int]:
    return [limits.cap_ua for limits in made.electrode]


def test_it_is_taken_from_all_that_the_command_stands_on_or_replaces() -> None:
    """And from nothing of another person."""
    shelf = Shelf(P01=WAS, anew=WAS, other=OTHERS, apart=WAS)
    stored = StoredLowered(shelf, ("P01", "anew", "other", None), ROW)
    stored.lower({2: (900, 1_500)})
    for name in ("P01", "anew"):
        assert shelf.stored[name].electrode[2] == replace(
            LIMITS, comfortable_ua=1_000, cap_ua=1_500
        )
        assert caps(shelf.stored[name]) == [2_000, 2_000, 1_500, 2_000]
        assert shelf.stored[name].is_whole_accepted is None
    assert (shelf.stored["other"], shelf.stored["apart"]) == (OTHERS, WAS)
    assert stored.lower_names == ("P01", "anew")
    assert not list(stored.changed)


def test_a_key_that_slipped_gives_it_back_and_where_nothing_was_nothing_is_stored() -> None:
    shelf = Shelf(P01=WAS)
    stored = StoredLowered(shelf, ("P01",), ROW)
    stored.lower({})
    assert shelf.sets == 0
    stored.lower({0: (500, 500)})
    stored.lower({})
    assert shelf.stored["P01"] == WAS
    assert not list(stored.lower_names)


def test_what_another_program_has_lowered_meanwhile_never_rises() -> None:
    shelf = Shelf(P01=WAS)
    stored = StoredLowered(shelf, ("P01",), ROW)
    shelf.stored["P01"] = CORRECTED
    stored.lower({0: (1_500, 1_500)})
    assert shelf.stored["P01"] == CORRECTED
    stored.lower({0: (1_500, 1_500), 1: (1_050, 1_050)})
    assert caps(shelf.stored["P01"]) == [1_200, 1_050, 1_200, 1_200]
    stored.lower({0: (1_500, 1_500)})
    assert shelf.stored["P01"] == CORRECTED, "a key that slipped"
    assert list(stored.changed) == ["P01"]


def test_what_was_taken_before_another_program_stored_it_is_not_given_back() -> None:
    """It may be that program's own."""
    shelf = Shelf(P01=WAS)
    stored = StoredLowered(shelf, ("P01",), ROW)
    stored.lower({0: (1_500, 1_500)})
    theirs = replace(shelf.stored["P01"], program="another")
    shelf.stored["P01"] = theirs
    stored.lower({})
    assert shelf.stored["P01"] == theirs


def test_a_result_is_not_stored_over_what_another_program_has_stored() -> None:
    shelf = Shelf(P01=WAS)
    stored = StoredLowered(shelf, ("P01", "new"), ROW)
    assert not list(stored.changed)
    shelf.stored["new"] = OTHERS
    assert list(stored.changed) == ["new"]
    shelf.stored["P01"] = CORRECTED
    assert list(stored.changed) == ["P01", "new"]
    del shelf.stored["P01"], shelf.stored["new"]
    assert not list(stored.changed), "there is nothing to lose"


def test_what_is_saved_is_of_the_baseline_as_it_is_now_unless_another_program_stored_it() -> None:
    shelf = Shelf(P01=WAS)
    stored = StoredLowered(shelf, ("P01",), ROW)
    known = identity("P01", WAS)
    assert stored.identity_of("P01", known) == known
    stored.lower({0: (1_500, 1_500)})
    assert stored.identity_of("P01", known) == identity("P01", shelf.stored["P01"]) != known
    assert stored.identity_of(None, None) is None
    shelf.stored["P01"] = CORRECTED
    stored.lower({0: (1_100, 1_100)})
    assert stored.identity_of("P01", known) == known


def test_what_cannot_be_read_is_nobodys_from_the_beginning_only() -> None:
    shelf = Shelf(P01=WAS, bad=WAS)
    shelf.unreadable = {"bad"}
    stored = StoredLowered(shelf, ("P01", "bad"), ROW)
    stored.lower({0: (500, 500)})
    assert caps(shelf.stored["bad"]) == caps(WAS)
    shelf.unreadable = {"P01"}
    with pytest.raises(Refused):
        stored.lower({0: (400, 400)})


def test_a_shipped_one_is_of_no_person() -> None:
    shelf = Shelf(**{"fake-fingertip-pad-8": WAS})
    StoredLowered(shelf, ("fake-fingertip-pad-8",), ROW).lower({0: (500, 500)})
    assert shelf.sets == 0


def test_an_electrode_that_was_not_felt_keeps_what_it_is_felt_from() -> None:
    unfelt = ElectrodeLimits(threshold_ua=900, comfortable_ua=900, cap_ua=900, felt=False)
    below = replace(unfelt, felt_from_ua=1_000)
    shelf = Shelf(P01=replace(WAS, electrode=(unfelt, below, LIMITS, LIMITS)))
    StoredLowered(shelf, ("P01",), ROW).lower({0: (700, 700), 1: (700, 700)})
    now = shelf.stored["P01"].electrode
    assert (now[0].cap_ua, now[0].felt, now[0].felt_from_ua) == (700, False, None)
    assert (now[1].cap_ua, now[1].felt, now[1].felt_from_ua) == (700, False, 1_000)


def test_what_is_left_is_of_each_alone_and_of_all_at_once() -> None:
    """And bounds what is found of an electrode later."""
    progress = Progress(conditions=ROW, found={0: LIMITS, 1: LIMITS})
    progress.take_down(1.25)
    progress.lower(1, 1_500)
    progress.lower(2, 700)
    assert progress.left_ua == {0: (1_360, 1_600), 1: (1_360, 1_500), 2: (700, 700)}
    today = replace(LIMITS, date=datetime.date(2026, 1, 15))
    progress.keep(0, today)
    assert progress.found[0] == replace(today, comfortable_ua=1_360, cap_ua=1_600)
    progress.take_down(1.0)
    assert progress.left_ua[0] == (1_360, 1_600)
