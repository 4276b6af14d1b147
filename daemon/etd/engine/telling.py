"""What the engine says of itself: the greeting to a gateway, and its state.

Owns: the facts in both. Must not know: sockets, how anything came about.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from etd.link import Greeting
from etd.protocol import ArrayFacts, BoardFacts, StateReport

if TYPE_CHECKING:
    from etd.engine.engine import Engine


def greeting(engine: Engine) -> Greeting:
    """What there is to drive."""
    loaded = engine.loaded
    defaults = loaded.body_site.defaults
    return Greeting(
        board=_board_facts(engine),
        array=ArrayFacts(
            name=loaded.array.name,
            electrodes=loaded.array.count,
            x_mm=loaded.array.x_mm,
            y_mm=loaded.array.y_mm,
            diameter_mm=loaded.array.diameter_mm,
        ),
        body_site=loaded.body_site.name,
        maxima=engine.maxima.facts(),
        default_width_us=defaults.width_us,
        default_rate_hz=defaults.rate_hz,
        default_polarity=defaults.polarity,
    )


def _board_facts(engine: Engine) -> BoardFacts:
    board = engine.loaded.board
    source = board.source
    return BoardFacts(
        name=board.name,
        backend=engine.backend.name,
        machine=engine.loaded.machine.name,
        full_scale_ua=source.full_scale_ua,
        resolution_ua=source.full_scale_ua / (source.codes - 1),
        leak_ohm=source.leak_ohm,
        compliance_v=source.compliance_v,
        rest_us=board.rest_us,
        states=engine.board.switch.states,
        present_guards=board.present_guards,
        absent_guards=board.absent_guards,
    )


def state_report(engine: Engine, now_ns: int) -> StateReport:
    """What `status` shows."""
    timing = engine.board.timing
    return StateReport(
        state=engine.states.state,
        now_ns=now_ns,
        engine="there",
        halt=engine.states.halt,
        holder=None if engine.lease is None else engine.lease.client,
        ceiling_ua=engine.opening.ceiling_ua,
        rail_v=engine.rail.rail_v(now_ns),
        supply_on=engine.board.is_supply_on,
        absent_guards=engine.loaded.board.absent_guards,
        not_granted=engine.not_granted,
        counters=dict(engine.reporter.counters),
        busy_percent=round(engine.clock.busy_percent, 1),
        clock_lag_us=engine.backend.lag_ns() // 1_000,
        timing={
            "word_us": round(timing.word_us, 3),
            "delay_extra_us": round(timing.delay_extra_us, 3),
            "message_us": round(timing.message_us, 3),
            "spread_us": round(timing.spread_us, 3),
        },
        last_disarm=engine.last_silence,
    )
