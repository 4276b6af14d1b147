"""Stage 5, no electrode connected: the supply switches on, off, and off without a heartbeat.

Owns: how the supply is measured, and what follows the checks of its gates. Must not know: the
checks (`rail_by_monitor.py`, `rail_by_node.py`).

A rail monitor is used if there is one. Otherwise the node shows a supply that can be switched: a
probe raises it only while the supply is on.
"""

from __future__ import annotations

from etd.selftest import killed, overdue, rail_by_monitor, rail_by_node, stopgate
from etd.selftest.array import check_ramp
from etd.selftest.buses import check_idle
from etd.selftest.fixture import Fixture
from etd.selftest.log import CheckLog
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
        killed.check(fixture, log)
    if not log.stage_failed:
        overdue.check(fixture, log)
    if not log.stage_failed:
        if guards.hv_enable != "absent":
            supply.rises("rise_after_kill")
        prober.reset_chain()
