"""Kills at random operations: an engine's life after life on one modelled board, in stepped time.

Owns: what an engine does until it is killed, what is done for the board then, and the verdict on
each life: what flowed, what the next engine says. Must not know: processes, real time.

A kill comes between two operations of the ports: the kernel ends each that it has begun. The judge
is the body's own account of charge.
"""

from __future__ import annotations

import io
import random
from dataclasses import dataclass, field
from pathlib import Path

from campaign.account import AccountedBody
from campaign.engine_script import CURRENT_UA, ELECTRODES, WANTED_UA, WIDTH_US
from campaign.operations import Interference, Killed, Operations, Port
from campaign.scenes import config
from charge_witness import even_skin
from engine_rig import LEASE, EngineRig, rig_on
from engine_scenes import opened_to
from etd.protocol.link import ArmBoard, ClearHalt, DisarmBoard, OpenLease
from etd.protocol.messages import Limits
from etd_hal.board import Board
from etd_hal.compose import codec_of
from etd_hal.fake.board import FakeBoard
from etd_hal.fake.clock import SteppedClock
from etd_hal.fake.trace import Trace
from etd_hal.linesetup import line_setup, spi_setup
from etd_hal.supply_note import SupplyNote

MS = 1_000_000
#: Of `etd safe`, which has to be started.
_SAFE_AFTER_MS = 1_000
#: Of the stopper.
_CUT_WITHIN_US = 20_000
_POLARITIES = ("anodic", "cathodic", "biphasic")


@dataclass
class Lives:
    """What came of so many of them; `wrong` has a sentence for each thing that must not be."""

    kills: int = 0
    powered: int = 0
    operations: int = 0
    #: The largest that one electrode got without a gap, of what one pulse of the frames has.
    largest_part: float = 0.0
    #: What flowed after a kill, in all.
    after_pc: float = 0.0
    wrong: list[str] = field(default_factory=list)

    def note(self, sentence: str) -> None:
        self.wrong.append(f"kill {self.kills}: {sentence}")


class KilledEngines:
    """One board; an engine after the other is started on it, and killed."""

    def __init__(self, board: str, folder: Path, seed: int, *, has_keeper: bool = True) -> None:
        self._chance = random.Random(seed)
        self._has_keeper = has_keeper
        self._loaded = config(board)
        self._body = AccountedBody(even_skin(self._loaded.board, ELECTRODES))
        self._clock = SteppedClock()
        self._sink = io.BytesIO()
        self._fake = FakeBoard(
            self._loaded.board,
            self._clock,
            self._body,
            electrodes=self._loaded.array.outputs(),
            trace=Trace(None),
        )
        self._note = SupplyNote(folder / f"{board}.json")
        self.lives = Lives()
        #: Of a life that is not cut short: so many operations of the ports.
        self.whole = self.live(None)

    def kill_one(self) -> None:
        """An engine's life, to a random operation of it."""
        self.lives.operations += self.live(self._chance.randrange(self.whole))

    def live(self, killed_at: int | None) -> int:
        operations, lives = Operations(), self.lives

        def before(number: int, _: Port) -> Interference | None:
            if number == killed_at:
                raise Killed
            return None

        operations.before = before
        was_left = self._note.left() is not None
        rig = None
        try:
            rig = self._started(operations, was_left)
            self._play(rig)
        except Killed:
            pass
        # A life of fewer operations is killed at its end; what comes now is the stopper's.
        operations.before = lambda *_: None
        if killed_at is None:
            if rig is not None and rig.close() != ():
                lives.note("a life that was not cut short did not end well")
        else:
            lives.kills += 1
            self._after_the_kill(rig)
        self._fake.release()
        return operations.count

    def _started(self, operations: Operations, was_left: bool) -> EngineRig:
        loaded, fake = self._loaded, self._fake
        rig = rig_on(
            *(loaded, fake, self._clock, self._sink, operations.wrap), supply_note=self._note
        )
        wanted = "HALTED" if was_left else "SAFE"
        if rig.state != wanted:
            self.lives.note(f"the next engine came up in {rig.state}, not {wanted}")
        return rig

    def _play(self, rig: EngineRig) -> None:
        """Arm, show, disarm, show; where it was halted by a crash, clear that first."""
        if rig.state == "HALTED":
            if rig.ask(ArmBoard).error != "halted":
                self.lives.note("a crash armed again")
            rig.ask(ClearHalt)
        limits = Limits(max_current_ua=1_000, width_us=100)
        rig.ask(OpenLease, lease=LEASE, client="kills", limits=limits)
        for turn in range(2):
            if self._loaded.board.guards.wearer_stop != "absent":
                rig.try_wearer_stop()
            answer = rig.ask(ArmBoard)
            if answer.error is not None:
                self.lives.note(f"not armed: {answer.reason}")
            opened_to(rig, CURRENT_UA)
            rig.send(
                current_ua=WANTED_UA,
                width_us=WIDTH_US,
                polarity=self._chance.choice(_POLARITIES),
                rate_hz=40.0,
                pulses=2,
                ttl_ms=100,
            )
            rig.run_ms(65)
            if not turn:
                rig.ask(DisarmBoard, lease=LEASE)

    def _after_the_kill(self, rig: EngineRig | None) -> None:
        lives, clock, fake = self.lives, self._clock, self._fake
        is_on = rig is not None and rig.engine.components.board.is_supply_on
        if self._loaded.board.guards.hv_enable == "absent":
            is_on = rig is not None and rig.state in ("PROBE", "ARMED")
        lives.powered += is_on
        if is_on and self._note.left() is None:
            lives.note("the supply was on, and nothing notes it")
        before_pc = self._flowed_pc()
        if rig is not None:
            rig.stopper.is_looking = False
            clock.spend(self._chance.randrange(_CUT_WITHIN_US) * 1_000)
            rig.stopper.end(cuts=self._has_keeper)
            rig.close_link()
        fake.release()
        if self._loaded.board.guards.wearer_stop != "absent":
            # Killed while it was tried: its wearer lets go of it.
            fake.world.release("wearer_stop")
        clock.spend(_SAFE_AFTER_MS * MS)
        self._make_safe()
        clock.spend(50 * MS)
        lives.after_pc += self._flowed_pc() - before_pc
        account = self._body.counted()
        pulse_pc = CURRENT_UA * WIDTH_US
        longest_pc = max(account.longest_alone_pc, account.longest_shared_pc)
        lives.largest_part = max(lives.largest_part, longest_pc / pulse_pc)
        if fake.dac_code:
            lives.note("the DAC is not at zero")
        for violation in fake.violations[:1]:
            lives.note(violation)

    def _flowed_pc(self) -> float:
        return sum(self._body.counted().alone_pc)

    def _make_safe(self) -> None:
        """As `etd safe` does."""
        loaded, fake = self._loaded, self._fake
        ports = fake.request(line_setup(loaded.board), spi_setup(loaded.board))
        codec = codec_of(loaded.board.source)
        board = Board(loaded.board, loaded.machine, codec, ports.spi, ports.gpio, self._clock)
        problems = board.safe_off()
        if problems:
            self.lives.note(f"not made safe: {problems[0]}")
        ports.close()
