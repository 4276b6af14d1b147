"""The daemon's state as a client is told it: the first report in which what is wanted stands.

Owns: asking again until then, within a bound. Must not know: what is tested.
"""

from __future__ import annotations

import pytest

from etd.client import Display, clock
from etd.protocol.errors import EtdError
from etd.protocol.messages import StateReport

LOOK_S = 0.01


def state_when(address: str, within_s: float, **fields: object) -> StateReport:
    """The first state report in which these fields say so; the test fails where none does."""
    deadline_ns = clock.now_ns() + int(within_s * 1e9)
    said: object = None
    while clock.now_ns() < deadline_ns:
        try:
            with Display(address=address) as display:
                said = report = display.status()
        except EtdError as error:
            said = error
        else:
            if all(getattr(report, key) == value for key, value in fields.items()):
                return report
        clock.sleep_s(LOOK_S)
    pytest.fail(f"never {fields}: {said}")
