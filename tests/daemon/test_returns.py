"""When what is measured of the returns becomes what a pulse may be given."""

from __future__ import annotations

import pytest

from etd.engine.returns import Returns
from etd.safety.ledger import Ledger
from etd.safety.limits import path_of
from etd_body.electrode import load
from ledger_parts import AMPLE
from path_readings import SOURCE, exact, paths_ohm

N, CAP_UA = 16, 1_000
START_NS, PROBE_NS = 5_000_000_000, 2_000_000
PATH = path_of(0, (CAP_UA,) * N, range(1, N))


def measure_all(returns: Returns) -> tuple[int, float]:
    """One probe for each, as in a power-up; when it is over, and the least share before the last of
    them.
    """
    now_ns, least_share = START_NS, 1.0
    for electrode, path_ohm in enumerate(paths_ohm([load(50e3)] * N)):
        returns.path_now(PATH, now_ns)
        least_share = min(least_share, returns.share.share(0))
        returns.share.update(electrode, touches=True, now_ns=now_ns, reading=exact(path_ohm))
        now_ns += PROBE_NS
    return now_ns, least_share


@pytest.fixture
def returns() -> Returns:
    found = Returns(N, SOURCE, Ledger(N, AMPLE))
    found.set_caps((CAP_UA,) * N)
    return found


def test_a_power_up_finds_what_follows_once_for_all(returns: Returns) -> None:
    """For each probe it would cost a Pi milliseconds, which plans would take for a pulse's."""
    returns.begin_measuring(START_NS)
    now_ns, least_share = measure_all(returns)
    assert least_share == 1.0
    assert returns.path_now(PATH, now_ns).return_ua == CAP_UA
    returns.all_measured()
    assert returns.path_now(PATH, now_ns).return_ua > 0.8 * CAP_UA * (N - 1)


def test_without_a_power_up_each_that_becomes_known_counts_within_milliseconds(
    returns: Returns,
) -> None:
    _, least_share = measure_all(returns)
    assert least_share < 2 / N


def test_a_supply_that_goes_off_in_a_power_up_ends_it(returns: Returns) -> None:
    returns.begin_measuring(START_NS)
    returns.reset()
    _, least_share = measure_all(returns)
    assert least_share < 2 / N
