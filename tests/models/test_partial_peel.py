"""A contact that loses most of its area and keeps the rest, for good: what laws by resistance do.

The benchmark's peelings come back within seconds; this one does not. What is read is true: an edge
of skin carries the whole current, and resists several times as much.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace

import msgspec
import numpy as np
import pytest

import engine_rig
from bench import steady_skin
from bench.steady_laws import AHEAD, LAWS, NONE, K
from engine_scenes import exponent
from etd.files.configuration import fake_config
from etd_body.course import Course, SkinNow

SEED, ELECTRODES, PEELED, STILL_S, PEELING_S = 3, 16, 5, 300.0, 0.08
#: With their neighbors, so that something is in common.
LIT = (4, 5, 6, 7, 9)


class Peels(Course):
    """Skin that stands still, until one contact is left with a part of its area."""

    def __init__(self, course: Course, left: float) -> None:
        self.script = course.script
        self.from_s = math.inf
        self._still = course.at(STILL_S)
        self._left = left

    def at(self, t_s: float) -> SkinNow:
        area = np.ones_like(self._still.area)
        gone = min(max(0.0, (t_s - self.from_s) / PEELING_S), 1.0)
        area[PEELED] = 1.0 - gone * (1.0 - self._left)
        return replace(self._still, area=area)


@contextmanager
def shown(law: str, left: float) -> Iterator[Callable[[float], float]]:
    """A level that has stood for four seconds when the contact peels; and what hurts at most in so
    many milliseconds more, where pain begins at 1.
    """
    loaded = fake_config(electrodes=ELECTRODES)
    site = msgspec.structs.replace(loaded.body_site, stabilize=LAWS[law])
    loaded = replace(loaded, body_site=site)
    body = steady_skin.body_of(SEED, loaded.board, loaded.array)
    made = steady_skin.calibrated(SEED, loaded.board, loaded.array)
    body.skin.course = peels = Peels(body.skin.course, left)
    body.skin.refresh(0.0)
    body.look_at(0)
    rig = engine_rig.make(loaded=loaded, body=body, is_traced=False)
    made = msgspec.structs.replace(made, shape=LAWS[law].shape, exponent=exponent(K))
    assert rig.open_with(made).error is None
    rig.arm()
    levels = tuple(0.6 if electrode in LIT else 0.0 for electrode in range(ELECTRODES))
    rig.hold(4_000, level=levels, ttl_ms=1_000)
    peels.from_s = rig.clock.now_ns() / 1e9

    def most_pain(duration_ms: float) -> float:
        body.take_felt()
        rig.hold(duration_ms, level=levels, ttl_ms=1_000)
        _, pain = body.take_felt()
        return float(pain[PEELED])

    yield most_pain
    assert rig.close() == ()


@pytest.mark.parametrize("left", [0.3, 0.2])
def test_an_edge_that_is_left_does_not_hurt_however_long_it_stays(left: float) -> None:
    with shown(AHEAD, left) as most_pain:
        assert most_pain(13_000) < 0.6


def test_without_a_law_it_does() -> None:
    """What the test above is about."""
    with shown(NONE, 0.2) as most_pain:
        assert most_pain(500) > 1.0


@pytest.mark.parametrize("law", ["energy", "linear_law"])
def test_no_law_by_resistance_makes_it_worse(law: str) -> None:
    """From the second pulse on: the first one goes by the resistance before it peeled."""
    with shown(NONE, 0.1) as most_pain:
        most_pain(500)
        plain = most_pain(1_000)
    with shown(law, 0.1) as most_pain:
        most_pain(500)
        assert most_pain(1_000) <= plain
