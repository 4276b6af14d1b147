"""Which pulse of a replay belongs to which of its record, and what is told where they differ."""

from __future__ import annotations

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd.protocol.pulse_row import PulseRow
from etd.replay.compare import Comparer, Comparison
from record_rows import pulse

STEP_UA = 2.44
ROWS = [
    pulse(10.0 * scan + electrode, electrode, 1, 1_000) for scan in range(6) for electrode in (0, 1)
]


def compared(recorded: list[PulseRow], replayed: list[PulseRow]) -> Comparison:
    comparer = Comparer(STEP_UA)
    for row in recorded:
        comparer.recorded(row)
    for row in replayed:
        comparer.replayed(row)
    return comparer.done()


def test_the_same_is_the_same() -> None:
    found = compared(ROWS, [msgspec.structs.replace(row, t_ns=row.t_ns + 30_000) for row in ROWS])
    assert found.is_same
    assert (found.same, found.latest_us) == (len(ROWS), 30.0)


@given(st.integers(0, len(ROWS) - 1))
def test_one_that_is_missing_is_told_and_no_other(at: int) -> None:
    for recorded, replayed in ((ROWS, ROWS[:at] + ROWS[at + 1 :]),):
        missing, more = compared(recorded, replayed), compared(replayed, recorded)
        assert (missing.same, missing.missing, missing.more) == (len(ROWS) - 1, 1, 0)
        assert (more.same, more.missing, more.more) == (len(ROWS) - 1, 0, 1)
        (difference,) = missing.differences
        assert difference.recorded == ROWS[at]
        assert "in the record only" in str(difference)


@pytest.mark.parametrize(
    ("fields", "is_same"),
    [
        ({"current_ua": 1_003}, True),
        ({"current_ua": 1_005}, False),
        ({"width_us": 100.9}, True),
        ({"width_us": 102.0}, False),
        ({"wanted_ua": 1_001}, False),
        ({"prepulse_ua": 300}, False),
        ({"polarity": "cathodic"}, False),
        ({"electrode": 5}, False),
        ({"seq": 2}, False),
        ({"t_ns": ROWS[3].t_ns + 5_000_000}, False),
        ({"delivered_ua": 1}, True),
    ],
)
def test_what_counts_as_another_pulse(fields: dict[str, object], is_same: bool) -> None:
    replayed = [*ROWS[:3], msgspec.structs.replace(ROWS[3], **fields), *ROWS[4:]]
    assert compared(ROWS, replayed).is_same is is_same


def test_pulses_that_were_withheld_need_no_partner_and_are_none_to_a_fired_one() -> None:
    withheld = pulse(0.5, 2, 1, 0)
    assert compared([*ROWS[:1], withheld, *ROWS[1:]], ROWS).is_same
    assert compared(ROWS, [msgspec.structs.replace(ROWS[0], current_ua=0), *ROWS[1:]]).other == 1


def test_a_poll_may_fall_into_another_scan_and_is_counted() -> None:
    early, late = pulse(5.0, 7, None, 300), pulse(25.0, 7, None, 300)
    found = compared([early, *ROWS], [*ROWS, late])
    assert found.is_same
    assert (found.polls, found.polls_alone) == (1, 0)
    assert compared([early, *ROWS], ROWS).polls_alone == 1
