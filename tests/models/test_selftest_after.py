"""After the last pulse: how the machine is then, and what is said that nobody saw."""

from __future__ import annotations

from typing import Any

import pytest

from etd_hal.fake.faults import MachineTrouble
from selftest_rig import bad, selftest_rig


def test_what_no_check_covers_is_in_the_report() -> None:
    report = selftest_rig("feetthrough-relay", load_ohm=None).run()
    assert any("another width than a probe's" in sentence for sentence in report.not_seen)


@pytest.mark.parametrize(
    ("kind", "lasts", "said"),
    [
        ("hot", True, "84 C, hot"),
        ("throttled", True, "52 C, slowed down, slowed down during the test"),
        ("under_voltage", True, "52 C, under-voltage, under-voltage during the test"),
        ("was_throttled", True, "52 C, slowed down during the test"),
        ("was_under_voltage", True, "52 C, under-voltage during the test"),
        ("hot", False, None),
    ],
)
def test_what_comes_over_the_machine_while_pulses_are_fired_is_named(
    kind: Any, lasts: bool, said: str | None
) -> None:
    """Heat that was over by the last pulse is no reason; of the rest the firmware keeps account."""
    rig = selftest_rig(second_ohm=None)
    trouble = MachineTrouble(kind)
    rig.watch.before_pulse[5] = lambda: rig.fake.world.put_in(trouble)
    if not lasts:
        rig.watch.before_pulse[9] = lambda: rig.fake.world.take_out(trouble)
    report = rig.run()
    assert bad(report) == ([] if said is None else [("source", "machine_after")])
    assert said is None or [
        check.measured for check in report.checks if check.name == "machine_after"
    ] == [said]


@pytest.mark.parametrize("kind", ["was_throttled", "was_under_voltage"])
def test_what_the_firmware_had_noted_before_the_test_is_no_reason(kind: Any) -> None:
    assert bad(selftest_rig(second_ohm=None, faults=[MachineTrouble(kind)]).run()) == []
