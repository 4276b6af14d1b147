"""The page on safety names ceilings, bounds and deadlines as they are, and files that there are."""

from __future__ import annotations

import re
from collections import Counter
from pathlib import Path
from typing import get_args

import pytest

from bench.kills import MOST_MS, P50_MS
from etd.engine import sequencer, source_check
from etd.engine import stopper as stopper_seen
from etd.engine.machine_watch import MachineWatch
from etd.engine.timing_calibration import ATTEMPTS
from etd.planning import lateness
from etd.protocol.frame import TtlMs
from etd.protocol.link import SILENCE_NS
from etd.safety.bookings import WINDOW_NS
from etd.safety.net_charge import LEAK_NS
from etd.sensing import sensors
from etd_hal import ceilings, source_rules, stopper
from etd_hal.board_lines import SILENT_MS

CLONE = Path(__file__).resolve().parents[1]
PAGE = (CLONE / "docs" / "safety.md").read_text(encoding="utf-8")


def test_the_ceilings_on_the_page_are_those_in_force() -> None:
    (table,) = re.findall(r"\| \| at most \|\n\|---\|---\|\n((?:\|.*\n)+)", PAGE)
    figures = [int(figure) for figure in re.findall(r"\b(\d+)\b", table)]
    assert figures == [
        ceilings.CURRENT_UA,
        ceilings.WIDTH_US,
        ceilings.CHARGE_NC,
        ceilings.RATE_HZ,
        ceilings.INTERVAL_US,
        ceilings.MEAN_CURRENT_UA,
        ceilings.ARRAY_MEAN_CURRENT_UA,
        ceilings.NET_CHARGE_NC // 1_000,
        ceilings.PROBE_CURRENT_UA,
        ceilings.PROBE_WIDTH_US,
        ceilings.HALT_EXCESS_US,
        ceilings.DRIFT_US,
        ceilings.SPREAD_US,
    ]


def test_the_files_that_it_names_are_there() -> None:
    named = re.findall(r"`((?:daemon|hal)/[\w/]+\.py)`", PAGE)
    assert len(named) >= 5
    assert [name for name in named if not (CLONE / name).is_file()] == []


def ms(ns: float) -> str:
    return f"{ns / 1e6:g} ms"


def second(ns: int) -> str:
    """As the page writes one, and a tenth of one."""
    return {1_000_000_000: "second", 100_000_000: "tenth of a second"}[ns]


def asked_every_s() -> int:
    """As the machine's watch does it, in whole seconds."""
    asked: list[None] = []

    def ask() -> tuple[str, ...]:
        asked.append(None)
        return ()

    watch, second_s = MachineWatch(ask, Counter()), 0
    while len(asked) < 2:
        watch.look(second_s * 1_000_000_000)
        second_s += 1
    return second_s - 1


(_MOST_TTL_MS,) = [meta.le for meta in get_args(TtlMs)[1:]]
#: A fifth and a tenth, as the page writes them.
_WORDS = {3: "three"}
_PARTS = {0.2: "a fifth", 0.1: "a tenth"}
_CHECKED = stopper.PERIOD_NS

#: What each row of "What is checked while it runs" says in figures: how often, and the bound.
ROWS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "the bytes of the message and the lines of the switch": ((), ()),
    f"the charge, pulses and time with current of the last {second(WINDOW_NS)}": ((), ()),
    f"net charge, with a leak of a {second(LEAK_NS)}": ((), ("`net_charge_nc` of the site",)),
    "the node with the DAC at zero": ((), (f"{source_rules.RESTED_V:g} V,",)),
    "the node in a pulse": ((), (_PARTS[source_rules.TOLERANCE],)),
    "the source with nothing connected": (
        (f"each {second(source_check.PERIOD_NS)}",),
        (_PARTS[source_rules.TOLERANCE],),
    ),
    "the latch": ((f"each {second(source_check.LATCH_PERIOD_NS)}",), ()),
    "each call to the kernel": ((), ()),
    "the lines of the safe state, read back": ((), ()),
    "the length of the message": ((), ("`halt_excess_us` of the machine file",)),
    "the mean of these lengths": ((), ("`drift_us`",)),
    "scans that come late": (
        (f"each {second(lateness.WINDOW_NS)}",),
        (_PARTS[round(lateness.LATE - 1.0, 3)],),
    ),
    "a message that is overdue": ((f"every {ms(_CHECKED)},",), (ms(stopper.OVERDUE_NS),)),
    "the stopper": ((), (ms(stopper_seen.SILENT_NS),)),
    "the engine's polls": (
        (f"every {ms(_CHECKED)},",),
        ("`window_ms` of the heartbeat", f"{SILENT_MS} ms on a board without one",
         ms(stopper.COUNTED_NS)),
    ),
    "whether the engine is alive": (
        (f"every {ms(_CHECKED)},",),
        (f"within {P50_MS:g} ms, each within {MOST_MS:g} ms",),
    ),
    "how the last engine ended": ((), ()),
    "the register of the switches": ((), ()),
    "the rail": ((), (f"older than {ms(sensors.STALE_NS)}",)),
    "the stop lines": ((f"every {ms(sequencer.POLL_NS)} between scans",), ()),
    "the gateway": ((), (ms(SILENCE_NS),)),
    "the Pi's own report": ((f"every {asked_every_s()} s,",), ()),
    "the lease, and the frame's `ttl_ms`": ((), (f"never above {_MOST_TTL_MS // 1_000} s",)),
}  # fmt: skip
_FIGURE = re.compile(r"\d+(?:\.\d+)?")


def checked() -> list[list[str]]:
    """The cells of that table, row by row."""
    _, _, after = PAGE.partition("## What is checked while it runs")
    rows = [line for line in after.partition("\n## ")[0].splitlines() if line.startswith("|")]
    return [[cell.strip() for cell in row.strip("|").split("|")] for row in rows[2:]]


def test_each_check_of_the_page_is_known_here_and_has_a_reaction() -> None:
    rows = checked()
    assert [row[0] for row in rows if not row[3]] == []
    for row, name in zip(rows, ROWS, strict=True):
        assert row[0].startswith(name), f"{row[0]!r} is not {name!r}"


@pytest.mark.parametrize("name", ROWS)
def test_deadlines_and_bounds_are_those_in_force(name: str) -> None:
    cells = checked()[list(ROWS).index(name)]
    for cell, said in zip(cells[1:3], ROWS[name], strict=True):
        missing = [figure for figure in said if figure not in cell]
        assert missing == [], cell
        # And no figure that nothing here vouches for.
        vouched = {figure for text in said for figure in _FIGURE.findall(text)}
        rest = re.sub(r"\]\([^)]*\)", "", cell)
        assert set(_FIGURE.findall(rest)) <= vouched, cell


def test_a_timing_that_fails_so_often_halts() -> None:
    (row,) = [row for row in checked() if row[0] == "the mean of these lengths"]
    assert f"{_WORDS[ATTEMPTS]} failures" in row[3]
