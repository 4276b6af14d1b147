"""The picture on a terminal: what is in it, whatever room there is."""

from __future__ import annotations

import io
from typing import Any

import msgspec
import pytest
from rich.console import Console
from rich.live import Live

from etd.apps.monitor import Monitor
from etd.cli.live import Drawn
from etd.client import clock
from etd.gateway.replies import hello
from etd.protocol.facts import Endpoints
from etd.protocol.messages import Contact, Halt, HelloReply, Modelled, StateReport
from scripted_engine import engine_hello

SIZES = [(80, 24), (200, 60), (80, 14), (40, 24), (20, 10)]


def facts_of(side: int) -> HelloReply:
    """A square array."""
    made = engine_hello()
    places = [(column * 2.0, row * 2.0) for row in range(side) for column in range(side)]
    array = msgspec.structs.replace(
        made.array,
        electrodes=side**2,
        x_mm=tuple(x for x, _ in places),
        y_mm=tuple(y for _, y in places),
    )
    return hello(
        msgspec.structs.replace(made, array=array),
        name="main",
        endpoints=Endpoints(frames="", telemetry=""),
        calibrations=(),
        calibrations_folder="",
        default_calibration=None,
    )


def drawn(size: tuple[int, int], *reports: Any, side: int = 8, old_s: float = 0.0) -> list[str]:
    console = Console(
        width=size[0], height=size[1], file=io.StringIO(), force_terminal=True, color_system=None
    )
    monitor = Monitor(facts_of(side))
    picture = Drawn(monitor, Live(console=console, auto_refresh=False), "etd main (a title)")
    for report in reports:
        monitor.hear(report)
    made = picture.picture(clock.now_ns() + int(old_s * 1e9), 60.0)
    with console.capture() as captured:
        console.print(made)
    return captured.get().rstrip("\n").split("\n")


def armed(**changes: Any) -> StateReport:
    report = StateReport(state="ARMED", now_ns=0, engine="there", ceiling_ua=2_000)
    return msgspec.structs.replace(report, **changes)


def felt(side: int = 8) -> Modelled:
    return Modelled(now_ns=0, felt=(0.5,) * side**2, pain=(0.0,) * side**2)


@pytest.mark.parametrize("size", SIZES)
@pytest.mark.parametrize("side", [2, 8, 16])
def test_it_fits_wherever_one_panel_does(size: tuple[int, int], side: int) -> None:
    lines = drawn(size, armed(), felt(side), side=side)
    assert "etd main" in lines[0]
    assert lines[1].startswith("ARMED")
    if side + 8 <= size[1] and 2 * side <= size[0]:
        assert len(lines) <= size[1]


def test_at_80_by_24_state_contact_felt_and_legend_are_there() -> None:
    text = "\n".join(drawn((80, 24), armed(), felt()))
    for part in ("ARMED", "delivered", "contact", "felt (modelled)", "wanted", "contact: # closed"):
        assert part in text
    assert "no room for" in text


def test_with_more_room_there_is_more_of_it() -> None:
    text = "\n".join(drawn((200, 60), armed(), felt()))
    assert "resistance" in text
    assert "no room" not in text


def test_a_halt_stands_at_the_top() -> None:
    halt = Halt(cause="wearer_stop", source="wearer_stop", detail="it opened", t_ns=0)
    lines = drawn((80, 24), armed(state="HALTED", halt=halt), felt())
    assert lines[1].startswith("HALTED")
    assert "halted by wearer_stop" in " ".join(lines[1:4])


def test_what_is_old_is_told() -> None:
    assert not any("no report" in line for line in drawn((80, 24), armed(), old_s=1.0))
    assert any("no report for 5 s: this is old" in line for line in drawn((80, 24), old_s=5.0))


def test_what_is_unknown_counts_neither_as_touched_nor_as_open() -> None:
    contact = Contact(
        contact=(True, False, None, True),
        resistance_ohm=(1, None, None, 1),
        voltage_v=(1.0, None, None, 1.0),
        t_ns=0,
    )
    text = " ".join(drawn((80, 24), armed(), contact, side=2))
    assert "2 touched, 1 open, 1 unknown" in text
