"""The targets that are whole programs, in their short form: a gateway, an engine, a daemon."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fuzz import engine_target, gateway_target, stored, story_target
from fuzz.short_form import inputs
from fuzz.target import Target, play

pytestmark = pytest.mark.slow

TARGETS = (*gateway_target.TARGETS, *engine_target.TARGETS, *story_target.TARGETS)
each = pytest.mark.parametrize("target", TARGETS, ids=[one.name for one in TARGETS])


@each
def test_what_is_whole_and_what_was_found_once_holds(target: Target) -> None:
    for data in stored.starts(target):
        play(target, data)


@each
@settings(max_examples=30, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_anything_near_it_holds(target: Target, data: st.DataObject) -> None:
    play(target, data.draw(inputs(target)))
