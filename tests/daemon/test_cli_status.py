"""What `etd status` prints of a report."""

from __future__ import annotations

from etd.cli.status import lines_of
from etd.protocol.messages import Halt, StateReport


def labels(report: StateReport) -> list[str]:
    return [line[:14].strip() for line in lines_of("main", report, None)]


def test_a_clock_has_a_line_only_where_it_lags() -> None:
    assert "clock" not in labels(StateReport(state="SAFE", now_ns=1, engine="there"))
    lagging = StateReport(state="SAFE", now_ns=1, engine="there", clock_lag_us=42_700)
    assert [line for line in lines_of("main", lagging, None) if "42 ms" in line]
    assert "clock" in labels(lagging)


def test_no_text_of_a_report_acts_on_the_terminal_or_forges_a_line() -> None:
    forged = "x\n\x1b[31mdaemon         main: ARMED"
    halt = Halt(cause="stop", source=forged, detail=forged, t_ns=1)
    report = StateReport(
        state="HALTED",
        now_ns=1,
        engine="there",
        halt=halt,
        holder=forged,
        not_granted=(forged,),
        last_disarm=forged,
    )
    assert all(line.isprintable() for line in lines_of("main", report, None))


def test_what_the_scan_may_take_of_its_core_stands_beside_what_it_takes() -> None:
    most = "the scan takes at most 80 % of any 100 ms (core 3, not isolated)"
    report = StateReport(
        state="SAFE", now_ns=1, engine="there", busy_percent=41.6, busy_at_most=most
    )
    assert f"busy           42 %; {most}" in lines_of("main", report, None)
    older = StateReport(state="SAFE", now_ns=1, engine="there", busy_percent=41.6)
    assert "busy           42 %" in lines_of("main", older, None)
