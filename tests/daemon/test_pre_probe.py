"""What a probe says of the pulse to come, with what was seen before and without."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from engine_parts import board_file, body_site
from engine_rig import EngineRig
from etd.pulse.measured import MAX_AGE_NS
from etd.sensing.contact import ContactMap
from etd.sensing.impedance import ImpedanceMap, Samples
from etd.sensing.pre_probe import PreProbe
from etd_hal.phase import Pulse, PulseResult

MakeRig = Callable[..., EngineRig]
LEAK_OHM = 66_000.0
MS = 1_000_000


class Seen:
    """One electrode, visit by visit: a probe, and perhaps the pulse behind it."""

    def __init__(self, probe: Pulse) -> None:
        source = board_file().source
        self.contact = ContactMap(1, source, body_site().contact)
        self.impedance = ImpedanceMap(1, source)
        self.ahead = PreProbe(1, self.contact, self.impedance)
        self._probe = probe

    def probed(self, skin_ohm: float, now_ns: int, resting_v: float = 0.0) -> bool:
        """Whether it begins not to be believed."""
        end_v = self._probe.commanded_ua / 1e6 / (1 / skin_ohm + 1 / LEAK_OHM)
        result = PulseResult(now_ns, now_ns, 0, resting_v, end_v, end_v)
        return self.ahead.update(0, self._probe, result)

    def followed(self, skin_ohm: float, now_ns: int) -> None:
        end_v = 2_000 / 1e6 / (1 / skin_ohm + 1 / LEAK_OHM)
        self.impedance.update(0, Samples(2_000, 100.0, 0.0, end_v, end_v), now_ns)
        self.contact.update(0, 2_000, end_v, now_ns)
        self.ahead.was_followed(0)


@pytest.fixture
def seen(make_rig: MakeRig) -> Seen:
    return Seen(make_rig(electrodes=8).engine.components.board.pulse(300, 50))


def lying(seen: Seen, until_ms: int = 800) -> int:
    """Skin of 40 k to a probe and 25 k to a pulse; until when, in ns."""
    for now_ms in range(0, until_ms + 1, 100):
        assert not seen.probed(40_000, now_ms * MS)
        seen.followed(25_000, now_ms * MS)
    return until_ms * MS


def test_a_risen_probe_makes_as_much_more_expected_and_a_fallen_one_nothing(seen: Seen) -> None:
    now_ns = lying(seen) + MS
    seen.probed(48_000, now_ns)
    assert seen.ahead.expected_ohm(0, now_ns) == pytest.approx(1.2 * 25_000, rel=0.01)
    seen.probed(30_000, now_ns)
    assert seen.ahead.expected_ohm(0, now_ns) is None


def test_only_a_probe_that_is_believed_tells_what_it_may_have_left(seen: Seen) -> None:
    seen.probed(40_000, 0)
    assert seen.ahead.probed_v(0) == pytest.approx(0.3 * 66 * 40 / 106, rel=0.02)
    seen.probed(40_000, MS, resting_v=5.5)
    assert seen.ahead.probed_v(0) == 0.0


def test_after_a_probe_that_is_not_believed_the_next_is_compared_with_nothing(seen: Seen) -> None:
    now_ns = lying(seen)
    assert seen.probed(40_000, now_ns, resting_v=6.0)
    seen.followed(25_000, now_ns)
    seen.probed(48_000, now_ns)
    assert seen.ahead.expected_ohm(0, now_ns) is None
    seen.followed(25_000, now_ns)
    seen.probed(60_000, now_ns)
    assert seen.ahead.expected_ohm(0, now_ns) == pytest.approx(1.25 * 25_000, rel=0.01)


@pytest.mark.parametrize(
    ("probe_ohm", "state", "expected_ohm"),
    [(40_000, "closed", 25_000), (48_000, "closed", 30_000), (76_000, "soft", 47_500)],
)
def test_after_a_pause_a_probe_tells_whether_it_is_the_contact_that_was_there(
    seen: Seen, probe_ohm: float, state: str, expected_ohm: float
) -> None:
    now_ns = lying(seen) + 5 * MAX_AGE_NS
    seen.probed(probe_ohm, now_ns)
    assert seen.contact.state(0, now_ns) == state
    assert seen.ahead.expected_ohm(0, now_ns) == pytest.approx(expected_ohm, rel=0.01)


def test_after_a_pause_a_touch_that_no_probe_can_be_compared_with_is_a_new_one(seen: Seen) -> None:
    for now_ms in range(0, 801, 100):
        seen.followed(25_000, now_ms * MS)
    now_ns = 5 * MAX_AGE_NS
    seen.probed(40_000, now_ns)
    assert seen.contact.state(0, now_ns) == "soft"
    assert seen.ahead.expected_ohm(0, now_ns) is None


def test_a_contact_found_open_is_not_taken_for_the_one_before_it(seen: Seen) -> None:
    now_ns = lying(seen)
    seen.probed(1e9, now_ns)
    assert seen.contact.state(0, now_ns) == "open"
    seen.probed(40_000, now_ns + 5 * MAX_AGE_NS)
    assert seen.contact.state(0, now_ns + 5 * MAX_AGE_NS) == "soft"
