"""What a fault is put into: the board, its clock, who is connected to it, and the engine's link.

Owns: where each is found while a scene is played. Must not know: faults, scenes.
"""

from __future__ import annotations

from dataclasses import dataclass

from campaign.account import AccountedBody
from engine_rig import EngineRig
from etd_hal.fake.board import FakeBoard
from etd_hal.fake.clock import SteppedClock


@dataclass
class Subject:
    """`rig` None: no engine has begun yet, or there is none."""

    fake: FakeBoard
    clock: SteppedClock
    body: AccountedBody
    rig: EngineRig | None = None
    #: False: nothing more comes from it, and it takes nothing back.
    is_client_alive: bool = True
