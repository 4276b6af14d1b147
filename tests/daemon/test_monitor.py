"""The live picture's facts: what was wanted, what passed, contact, and what a model felt."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import msgspec

from etd.apps.monitor import Monitor
from etd.apps.panel import CONTACT_SIGNS, Panel
from etd.gateway.replies import hello
from etd.protocol.facts import Endpoints
from etd.protocol.messages import Contact, Fired, HelloReply, Modelled, Scan, Shown, StateReport
from etd.protocol.outcome import Clamp
from etd.pulse.measured import MAX_AGE_NS
from scripted_engine import engine_hello

COMMANDS = (Path(__file__).parents[2] / "docs" / "commands.md").read_text(encoding="utf-8")


def monitor() -> Monitor:
    return Monitor(facts())


def facts() -> HelloReply:
    return hello(
        engine_hello(),
        name="main",
        endpoints=Endpoints(frames="", telemetry=""),
        calibrations=(),
        calibrations_folder="",
        default_calibration=None,
    )


def scan(is_ended: bool = False, **changes: Any) -> Scan:
    """Two electrodes of four fired, one of them half delivered and saturated."""
    fired = Fired(
        wanted_ua=(2_000, 0, 1_000, 0),
        current_ua=(2_000, 0, 1_000, 0),
        delivered_ua=(1_500, 0, 500, 0),
        width_us=(100.0, 0.0, 100.0, 0.0),
        voltage_v=(50.0, None, 285.0, None),
        resistance_ohm=(30_000, None, None, None),
        contact=("closed", None, "saturated", None),
    )
    shown = Shown(seq=1, tag=None, begun_ns=0, first_ns=1, last_ns=2, ended=is_ended)
    return Scan(
        now_ns=0,
        shown=(shown,),
        seq=1,
        tag=None,
        scans=1,
        fired=msgspec.structs.replace(fired, **changes),
        clamped=(),
        not_fired=(),
        ceiling_ua=3_000,
        dropped_reports=0,
    )


def panel(made: Monitor, title: str) -> Panel:
    (found,) = [panel for panel in made.panels() if panel.title == title]
    return found


def test_what_was_wanted_and_what_passed_the_skin_are_seen_side_by_side() -> None:
    made = monitor()
    made.hear(scan())
    wanted, delivered = panel(made, "wanted").bright, panel(made, "delivered").bright
    assert wanted[0] is not None
    assert delivered[0] is not None
    assert delivered[0] == wanted[0] * 1_500 / 2_000
    assert delivered[1] == wanted[1] == 0.0


def test_after_a_frame_has_ended_nothing_is_delivered_and_contact_stays() -> None:
    made = monitor()
    made.hear(scan(is_ended=True))
    assert set(panel(made, "delivered").bright) == {0.0}
    assert panel(made, "contact").signs == ["#", "?", "!", "?"]


def test_what_nobody_has_told_for_a_second_is_drawn_as_unknown() -> None:
    made = monitor()
    made.hear(scan())
    made.hear(state(MAX_AGE_NS - 1))
    assert panel(made, "contact").signs == ["#", "?", "!", "?"]
    made.hear(state(MAX_AGE_NS))
    assert panel(made, "contact").signs == ["?"] * 4
    assert panel(made, "resistance").bright == [None] * 4
    assert "0 touched, 0 open, 4 unknown" in made.line()


def state(now_ns: int) -> StateReport:
    return StateReport(state="ARMED", now_ns=now_ns, engine="there")


def test_a_contact_that_is_saturated_or_shorted_is_seen_at_once() -> None:
    made = monitor()
    made.hear(scan(contact=("shorted", None, "saturated", "soft")))
    assert panel(made, "contact").alarming == {0, 2}


def test_the_contact_measurement_of_arming_is_drawn_too() -> None:
    made = monitor()
    told = Contact(
        contact=(True, False, None, True),
        resistance_ohm=(3_000, None, None, 1_000_000),
        voltage_v=(1.0, 19.0, None, 18.0),
        t_ns=0,
    )
    made.hear(told)
    assert panel(made, "contact").signs == ["#", ".", "?", "#"]
    assert panel(made, "resistance").bright == [1.0, None, None, 0.0]


def test_what_a_body_felt_is_shown_only_where_there_is_a_model_and_named_so() -> None:
    made = monitor()
    assert "felt" not in made.line()
    assert [panel.title for panel in made.panels()] == [
        "wanted",
        "delivered",
        "resistance",
        "contact",
    ]
    made.hear(Modelled(now_ns=0, felt=(1.2, 0.0, 0.4, 5.0), pain=(0.1, 0.0, 0.0, 1.0)))
    felt = panel(made, "felt (modelled)")
    assert felt.bright[3] == 1.0
    assert felt.alarming == {3}
    assert "modelled: felt at 2, strength up to 5.0, PAIN at 1" in made.line()


def test_what_laws_gave_and_took_is_a_panel_and_in_the_line_while_one_runs() -> None:
    made = monitor()
    made.hear(scan(gain=(None,) * 4))
    assert "laws" not in made.line()
    assert not [panel for panel in made.panels() if panel.title.startswith("laws")]
    made.hear(scan(gain=(1.3, None, 0.0, 1.0)))
    found = panel(made, "laws: + gave, - took")
    assert found.signs == ["+", ".", "-", "="]
    given, unfired, taken, left = found.bright
    assert unfired is None
    assert (taken, left) == (0.0, 0.5)
    assert given is not None
    assert 0.5 < given < 1.0
    assert "laws x0.00-1.30" in made.line()
    made.hear(scan(gain=(0.814, None, None, None)))
    assert "laws x0.81" in made.line().split(", ")
    made.hear(scan(is_ended=True, gain=(0.814, None, None, None)))
    assert "laws" not in made.line()


def test_the_docs_show_the_line_that_is_printed() -> None:
    made = monitor()
    silent = form_of(made.line().replace("?", "SAFE"))
    made.hear(state(0))
    made.hear(scan())
    made.hear(Modelled(now_ns=0, felt=(1.2, 0.0, 0.4, 5.0), pain=(0.0,) * 4))
    forms = {silent, form_of(made.line()), form_of(made.line(60.0))}
    clamp = Clamp(electrode=0, wanted_ua=2_000, allowed_ua=500, reason="soft_start", limited_by=0)
    made.hear(msgspec.structs.replace(scan(), clamped=(clamp,)))
    forms.add(form_of(made.line(60.0)))
    shown = [line for line in COMMANDS.splitlines() if ", ceiling " in line]
    assert {form_of(line) for line in shown} == forms


def form_of(line: str) -> str:
    return re.sub(r"\d+(\.\d)?", "N", line)


def test_every_kind_of_contact_has_a_sign_of_its_own() -> None:
    assert len(set(CONTACT_SIGNS.values())) == len(CONTACT_SIGNS)


def test_pressure_is_a_panel_where_there_are_sensors_and_unknown_when_nobody_tells() -> None:
    heard = monitor()
    heard.hear(scan())
    assert "pressure" not in {panel.title for panel in heard.panels()}
    pressed = msgspec.structs.replace(scan(), pressure_kpa=(40.0, 150.0, None, 0.0))
    heard.hear(pressed)
    panel = next(panel for panel in heard.panels() if panel.title == "pressure")
    assert panel.bright == [0.4, 1.0, None, 0.0]
    silent = {"pressure[1] (0x49, channel 2)": "it reads 0.00 V"}
    heard.hear(
        StateReport(
            state="ARMED", now_ns=MAX_AGE_NS, engine="there", counters={}, sensor_problems=silent
        )
    )
    panel = next(panel for panel in heard.panels() if panel.title == "pressure")
    assert panel.bright == [None] * 4
    assert "no readings from pressure[1] (0x49, channel 2)" in heard.line()
