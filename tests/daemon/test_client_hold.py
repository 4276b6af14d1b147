"""`hold` that is refused while it is shown."""

from __future__ import annotations

import pytest

from etd.client import clock
from etd.client.course import Pause, holding
from etd.client.session import Session
from etd.protocol.errors import Refused


def test_a_hold_that_is_refused_while_it_is_shown_ends_silent() -> None:
    session = Session("me", max_current_ua=3_000, width_us=100)
    session.lease = "a"
    first = holding(session, {"current_ua": [0, 1, 0, 0]}, 1.0, clock.now_ns)
    next(first)
    with pytest.raises(Refused, match="net charge"):
        first.throw(Refused("over_maximum", "net charge"))
    course = holding(session, {"current_ua": [0, 1, 0, 0]}, 1.0, clock.now_ns)
    next(course)
    assert isinstance(course.send(None), Pause)
    course.send(None)
    step = course.throw(Refused("over_maximum", "net charge"))
    assert not isinstance(step, Pause)
    assert b'"current_ua":[0,0,0,0]' in next(step).data
    with pytest.raises(Refused, match="net charge"):
        course.send(None)
