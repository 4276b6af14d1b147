"""At which operations of a scene faults are put in, in the campaign."""

from __future__ import annotations

import pytest

from campaign.forked import places_of
from campaign.kinds import kinds_of
from campaign.places import Operation, chosen
from campaign.scenes import BEGUN_AS, config


def test_of_a_place_the_first_the_second_and_the_last_operation_are_chosen() -> None:
    operations = [Operation("set", 1, 0)] * 9 + [Operation("spi", 2, 0)] * 4
    at = chosen(operations, 3)
    assert at.once == {0, 1, 8, 9, 10, 12}
    assert at.staying == {1, 9, 12}
    assert at.parts == {1}
    assert chosen(operations, None).once == set(range(13))
    assert chosen(operations, 3, is_long=True).once == {4, 11}


def test_what_no_message_meets_is_put_in_once_in_each_part() -> None:
    kinds = {kind.fault_class: kind for kind in kinds_of(config("reference-hv507").board)}
    at = chosen([Operation("set", 1, 0)] * 9 + [Operation("spi", 2, 0)] * 2, 3)
    aside, staying = kinds["a stop does not cut the supply"], kinds["a solder bridge"]
    assert [n for n in range(11) if aside.applies(n, "spi", at)] == [1]
    assert [n for n in range(9) if staying.applies(n, "spi", at)] == [1]


def test_what_stays_is_put_in_at_one_end_of_a_place_by_lot() -> None:
    kinds = [kind for kind in kinds_of(config("reference-hv507").board) if kind.stays]
    at = chosen([Operation("spi", 1, 0)] * 5, 3)
    points = [
        [n for n in range(5) if kind.applies(n, "spi", at)] for kind in kinds if not kind.is_aside
    ]
    assert all(point in ([0], [4]) for point in points)
    assert min(points.count([0]), points.count([4])) > len(points) / 4


def test_a_place_that_another_scene_had_is_left_out() -> None:
    operations = [Operation("set", 1, 0), Operation("set", 2, 0), Operation("spi", 1, 0)]
    at = chosen(operations, 3, had={("set", 1)})
    assert at.once == {1, 2}
    assert at.parts == {1}


@pytest.mark.parametrize("scene", BEGUN_AS)
def test_a_scene_that_begins_as_another_has_places_of_its_own(scene: str) -> None:
    had = places_of("kajimoto-hv507", BEGUN_AS[scene])
    own = places_of("kajimoto-hv507", [scene])
    assert had & own
    assert own - had
