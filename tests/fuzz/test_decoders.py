"""Each decoder's target in its short form; `make fuzz` goes on where this ends."""

from __future__ import annotations

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from fuzz import file_targets, message_targets, name_target, record_target, stored, zmtp_target
from fuzz.short_form import inputs
from fuzz.target import Target, play

TARGETS = (
    *message_targets.TARGETS,
    *zmtp_target.TARGETS,
    *file_targets.TARGETS,
    *name_target.TARGETS,
    *record_target.TARGETS,
)
each = pytest.mark.parametrize("target", TARGETS, ids=[one.name for one in TARGETS])


@each
def test_what_is_whole_and_what_was_found_once_holds(target: Target) -> None:
    for data in stored.starts(target):
        play(target, data)


@each
@settings(max_examples=15, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_anything_near_it_holds(target: Target, data: st.DataObject) -> None:
    play(target, data.draw(inputs(target)))
