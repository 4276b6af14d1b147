"""What tests of whole models share, and which cases of them are run by turns.

Owns: the option `--turn`. Must not know: what is tested.

All of them take half an hour of two processors. `.ci/run` has the cases of each test with many take
turns, from one commit to the next: every third one of them. A test with fewer cases is run whole.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import pytest

from made_rigs import make_rig as make_rig

#: Of so many cases of a test, every third one.
MANY, TURNS = 4, 3
_HERE = Path(__file__).parent


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--turn",
        type=int,
        choices=range(TURNS),
        help="of a test of a whole model with many cases, every third one: from which on",
    )


def its_turn(cases: Sequence[pytest.Item], turn: int) -> Sequence[pytest.Item]:
    """Those of one test."""
    return cases[turn::TURNS] if len(cases) >= MANY else cases


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    turn: int | None = config.getoption("--turn")
    if turn is None:
        return
    by_test: defaultdict[str, list[pytest.Item]] = defaultdict(list)
    # In an order that no run draws.
    for item in sorted(items, key=lambda item: item.nodeid):
        if _HERE in item.path.parents:
            by_test[item.nodeid.partition("[")[0]].append(item)
    here = {item for cases in by_test.values() for item in cases}
    left_out = here - {item for cases in by_test.values() for item in its_turn(cases, turn)}
    items[:] = [item for item in items if item not in left_out]
    config.hook.pytest_deselected(items=list(left_out))
