"""What an engine does while faults come: a person's use from opening the lease to the end.

Owns: the script, which goes on whatever is refused or halts. Must not know: faults.
"""

from __future__ import annotations

from campaign.account import AccountedBody
from campaign.operations import Operations
from campaign.own_memory import link_in_memory
from charge_witness import even_skin
from engine_rig import LEASE, EngineRig, make
from engine_scenes import opened_to
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.link import ArmBoard, DisarmBoard, OpenLease, StopNow
from etd.protocol.messages import Limits

ELECTRODES = 8
#: Without every guard that a board can have, with all of them, and with relays.
BOARDS = ("kajimoto-hv507", "reference-hv507", "feetthrough-relay")
CURRENT_UA, WIDTH_US = 400, 50
#: Of one pulse and phase.
PULSE_PC = CURRENT_UA * WIDTH_US
STOPPED_BY = "the script"
_LIT = (0, 2, 5)
WANTED_UA = tuple(CURRENT_UA if electrode in _LIT else 0 for electrode in range(ELECTRODES))


def config(board: str) -> LoadedConfig:
    return fake_config(board=board, electrodes=ELECTRODES)


def rig_of(board: str, operations: Operations) -> tuple[EngineRig, AccountedBody]:
    """Not opened yet; `operations` counts from the engine's beginning on."""
    loaded = config(board)
    body = AccountedBody(even_skin(loaded.board, ELECTRODES))
    rig = make(loaded=loaded, body=body, wrap=operations.wrap, is_traced=False)
    link_in_memory(rig)
    return rig, body


def play(rig: EngineRig) -> None:
    """Arm; a frame of each shape; disarm; arm again, and a stop after a frame."""
    limits = Limits(max_current_ua=1_000, width_us=100)
    _ask(rig, OpenLease, lease=LEASE, client="campaign", limits=limits)
    if rig.engine.components.loaded.board.guards.wearer_stop != "absent":
        rig.try_wearer_stop()
    _ask(rig, ArmBoard)
    for polarity in ("anodic", "cathodic", "biphasic"):
        _show(rig, polarity)
    _ask(rig, DisarmBoard, lease=LEASE)
    _ask(rig, ArmBoard)
    _show(rig, "anodic")
    _ask(rig, StopNow, client=STOPPED_BY)
    rig.run_ms(20)


def _show(rig: EngineRig, polarity: str) -> None:
    """Two pulses of each lit electrode, however late they come. The soft start is over."""
    opened_to(rig, CURRENT_UA)
    rig.send(
        current_ua=WANTED_UA,
        width_us=WIDTH_US,
        polarity=polarity,
        rate_hz=40.0,
        pulses=2,
        ttl_ms=100,
    )
    rig.run_ms(65)


def _ask(rig: EngineRig, kind: type, **fields: object) -> None:
    """A command; whatever the answer is, or none in a second, the script goes on."""
    ref = rig.next_ref()
    rig.commands.send(kind(ref=ref, **fields))
    until_ns = rig.clock.now_ns() + 1_000_000_000
    while ref not in rig.answers and rig.clock.now_ns() < until_ns:
        rig.step()
