"""Stage 5, no electrode connected: the supply comes, goes, and goes by itself without a heartbeat.

Owns: who looks at the supply, and what comes after its gates. Must not know: how it is looked at
(`rail_by_monitor.py`, `rail_by_node.py`).

Where a monitor watches the rail it is asked. Where the supply can be switched and nobody watches
it, the node tells: a probe lifts it only while the supply is there.
"""

from __future__ import annotations

from etd.selftest import killed, rail_by_monitor, rail_by_node, stopgate
from etd.selftest.buses import check_idle
from etd.selftest.fixture import Fixture
from etd.selftest.log import CheckLog
from etd.selftest.probe import check_ramp
from etd.selftest.prober import Prober


def check(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    """Ends with the supply on. Raises: BusError, BoardFault, GuardRefusal."""
    guards = fixture.file.guards
    if guards.hv_enable == "absent":
        log.absent("hv_enable")
    if guards.rail_monitor == "absent":
        supply = rail_by_node.watch(fixture, log, prober)
        if guards.hv_enable != "absent":
            rail_by_node.check(fixture, log, prober)
        elif fixture.board.stops():
            check_ramp(fixture, log, prober, "ramp_before_stops")
    else:
        supply = rail_by_monitor.watch(fixture, log, guards.rail_monitor)
        rail_by_monitor.check(fixture, log, guards.rail_monitor)
    if guards.heartbeat == "absent":
        log.absent("heartbeat")
    if not log.stage_failed:
        stopgate.check(fixture, log, supply)
    if not log.stage_failed:
        check_idle(fixture, log, "idle_node_live")
    if not log.stage_failed:
        killed.check(fixture, log, supply.rises)
        prober.reset_chain()
