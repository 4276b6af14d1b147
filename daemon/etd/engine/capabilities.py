"""The first message of an engine to a gateway: the board, the array and their maxima.

Owns: the contents of `EngineHello`. Must not know: sockets, states, how anything is driven.
"""

from __future__ import annotations

from etd.files.configuration import LoadedConfig
from etd.protocol.facts import ArrayFacts, BoardFacts, MaximaFacts
from etd.protocol.link import EngineHello
from etd.safety.maxima import PC_PER_NC, Maxima
from etd_hal import compiled


def engine_hello(
    loaded: LoadedConfig, maxima: Maxima, states: tuple[str, ...], backend: str
) -> EngineHello:
    """`states`: the states that an electrode can have on this board; `backend`: linux or fake."""
    defaults = loaded.body_site.defaults
    return EngineHello(
        board=_board_facts(loaded, states, backend),
        array=ArrayFacts(
            name=loaded.array.name,
            electrodes=loaded.array.count,
            x_mm=loaded.array.x_mm,
            y_mm=loaded.array.y_mm,
            diameter_mm=loaded.array.diameter_mm,
        ),
        body_site=loaded.body_site.name,
        maxima=maxima_facts(maxima),
        default_width_us=defaults.width_us,
        default_rate_hz=defaults.rate_hz,
        default_polarity=defaults.polarity,
        shape=loaded.body_site.stabilize.shape,
        stabilizers=loaded.body_site.stabilize.order,
        felt_may_raise=loaded.body_site.felt_may_raise,
        balance=loaded.body_site.balance,
        digests=loaded.digests,
    )


def _board_facts(loaded: LoadedConfig, states: tuple[str, ...], backend: str) -> BoardFacts:
    board = loaded.board
    source = board.source
    return BoardFacts(
        name=board.name,
        backend=backend,
        machine=loaded.machine.name,
        code=compiled.runs(),
        full_scale_ua=source.full_scale_ua,
        resolution_ua=source.full_scale_ua / (source.codes - 1),
        leak_ohm=source.leak_ohm,
        compliance_v=source.compliance_v,
        rest_us=board.rest_us,
        states=states,
        present_guards=board.present_guards,
        absent_guards=board.absent_guards,
    )


def maxima_facts(maxima: Maxima) -> MaximaFacts:
    """The maxima as clients see them; charge in nC."""
    return MaximaFacts(
        current_ua=maxima.current_ua,
        uncalibrated_current_ua=maxima.uncalibrated_current_ua,
        width_us=maxima.width_us,
        charge_nc=maxima.charge_pc / PC_PER_NC,
        rate_hz=maxima.rate_hz,
        mean_current_ua=maxima.mean_current_ua,
        array_mean_current_ua=maxima.array_mean_current_ua,
        probe_current_ua=maxima.probe_current_ua,
        net_charge_nc=maxima.net_charge_pc / PC_PER_NC,
    )
