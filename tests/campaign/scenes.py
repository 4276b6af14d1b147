"""What is played while faults come: each part of a person's use, as a scene with a name.

Owns: the scenes with an engine, their scripts, and on which boards they are played. Must not know:
faults, how the engine is asked (`engine_script.py`).
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import msgspec

from campaign.account import Course
from campaign.engine_script import (
    ARMED_NS,
    ELECTRODES,
    LIT,
    LONG_MS,
    SHORT_MS,
    STOPPED_BY,
    EngineScript,
    lease_of,
)
from campaign.operations import Operations
from campaign.scene import Over, Scene
from campaign.selftest_scene import SelftestScene
from engine_rig import LEASE
from engine_scenes import balancing, calibration, exponent, opened_to
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.link import (
    ArmBoard,
    ClearHalt,
    DisarmBoard,
    MeasureContact,
    OpenLease,
    StopNow,
)
from etd.protocol.messages import Limits
from etd.stabilize.law_settings import ContactSettings, EnergySettings, PowerLawSettings
from etd.stabilize.settings import Settings

#: Without every guard that a board can have, with all of them, and with relays.
BOARDS = ("kajimoto-hv507", "reference-hv507", "feetthrough-relay")
_LIMITS = Limits(max_current_ua=1_000, width_us=100)
_STRONGEST_LIMITS = Limits(max_current_ua=3_000, width_us=100)
_K = 0.7
#: What a frame of `CURRENT_UA` and `WIDTH_US` leaves at 40 Hz in a second, and less.
_BALANCED_NC = 300


def config(board: str) -> LoadedConfig:
    return fake_config(board=board, electrodes=ELECTRODES)


class _Engine(EngineScript):
    """Powered up before faults come, and a frame is held after them."""

    limits = _LIMITS

    def prepare(self) -> None:
        self.power_up()

    def open(self) -> None:
        self.ask(OpenLease, **lease_of(limits=self.limits))

    def arm(self) -> None:
        """What follows begins at a time that does not depend on how long this took: from one beat
        on, until another.
        """
        self.wait_for_beat()
        begun_ns = self.rig.clock.now_ns()
        self.ask(ArmBoard)
        self.wait_for_beat(begun_ns, ARMED_NS)
        opened_to(self.rig, self.current_ua)

    def armed(self) -> None:
        self.open()
        self.try_wearer_stop()
        self.arm()

    def play_on(self, is_long: bool) -> None:
        self.hold(LONG_MS if is_long else SHORT_MS)


class _PowerUp(_Engine):
    """From the first call of the engine to its first safe state, and one arming after it."""

    def prepare(self) -> None:
        pass

    def play(self) -> None:
        self.power_up()

    def play_on(self, is_long: bool) -> None:
        self.armed()
        super().play_on(is_long)


class _Arming(_Engine):
    """A lease, arming, disarming, and arming again."""

    def play(self) -> None:
        self.armed()
        self.hold(30)
        self.ask(DisarmBoard, lease=LEASE)
        self.arm()


class _Frames(_Engine):
    """Two pulses of each electrode in each polarity, and nothing for a while."""

    def prepare(self) -> None:
        super().prepare()
        self.armed()

    def play(self) -> None:
        for polarity in ("anodic", "cathodic", "biphasic"):
            opened_to(self.rig, self.current_ua)
            self.send(polarity=polarity, rate_hz=40.0, pulses=2, ttl_ms=100)
            self.run_ms(65)


class _StrongestFrames(_Frames):
    """The same with the strongest pulses that the net charge of a site lets stand at this rate:
    0.192 uC.
    """

    current_ua, width_us, limits = 2_400, 80, _STRONGEST_LIMITS


class _BalancedFrames(_Engine):
    """A frame that names no polarity and could not stand for ever, on a site that has both phases
    fired then: its bound of net charge is so low here that these pulses pass it.
    """

    def __init__(
        self, loaded: LoadedConfig, operations: Operations, course: Course | None = None
    ) -> None:
        super().__init__(balancing(loaded, _BALANCED_NC), operations, course)

    @property
    def pulse_pc(self) -> int:
        """Of both phases: what each visit of an electrode gives."""
        return 2 * super().pulse_pc

    def prepare(self) -> None:
        super().prepare()
        self.armed()

    def play(self) -> None:
        self.hold(75)


class _Laws(_Engine):
    """Frames under stabilizers, on a site that has them, with a probe before each pulse."""

    def __init__(
        self,
        law: str,
        loaded: LoadedConfig,
        operations: Operations,
        course: Course | None = None,
    ) -> None:
        laws: dict[str, Any] = {"energy": EnergySettings(), "power_law": PowerLawSettings()}
        table = Settings(
            order=("contact", law),  # type: ignore[arg-type]
            contact=ContactSettings(),
            probe_first=True,
            **{law: laws[law]},
        )
        site = msgspec.structs.replace(loaded.body_site, stabilize=table)
        super().__init__(dataclasses.replace(loaded, body_site=site), operations, course)

    def prepare(self) -> None:
        self.power_up()
        rig = self.rig
        loaded = rig.engine.components.loaded
        made = calibration(
            rig,
            (1_000,) * ELECTRODES,
            width_us=self.width_us,
            exponent=exponent(_K, loaded.board.name, loaded.board.source.leak_ohm),
            shape=loaded.body_site.stabilize.shape,
        )
        self.ask(OpenLease, **lease_of(calibrations=rig.wanted(made)))
        self.try_wearer_stop()
        self.arm()
        self.hold(100)

    def play(self) -> None:
        self.hold(75)


class _Calibrating(_Engine):
    """What `etd calibrate` has the engine do: the contact of all, weak pulses until the soft start
    is over, presentations at single electrodes that rise, and the whole array in the end.
    """

    def prepare(self) -> None:
        super().prepare()
        self.open()
        self.try_wearer_stop()

    def play(self) -> None:
        self.wait_for_beat()
        self.ask(MeasureContact, lease=LEASE)
        self.arm()
        self._present({0: 50}, pulses=None, ttl_ms=60)
        for electrode, current_ua in ((2, 200), (2, 300), (5, self.current_ua)):
            self._present({electrode: current_ua})
        self._present(dict.fromkeys(LIT, self.current_ua), allow_slower=True)

    def _present(self, currents_ua: dict[int, int], **options: object) -> None:
        opened_to(self.rig, self.current_ua)
        each_ua = tuple(currents_ua.get(electrode, 0) for electrode in range(ELECTRODES))
        shown = {"rate_hz": 60.0, "pulses": 2, "ttl_ms": 100, **options}
        self.send(current_ua=each_ua, **{key: one for key, one in shown.items() if one is not None})
        self.run_ms(50)


class _Stopping(_Engine):
    """While a frame is shown: a stop in the middle of a scan, a disarming, and each stop line that
    the board has.
    """

    def prepare(self) -> None:
        super().prepare()
        self.armed()

    def play(self) -> None:
        self._begin_scan()
        self.ask(StopNow, client=STOPPED_BY)
        self._again()
        self._begin_scan()
        self.ask(DisarmBoard, lease=LEASE)
        guards = self._loaded.board.guards
        for name in ("emergency_stop", "wearer_stop"):
            if getattr(guards, name) == "absent":
                continue
            self._again()
            self._begin_scan()
            self.subject.fake.world.press(name)
            self.run_ms(10)
            self.subject.fake.world.release(name)
            self.run_ms(100)
        self._again()

    def _begin_scan(self) -> None:
        """Stop at once when its first pulse is fired."""
        opened_to(self.rig, self.current_ua)
        self.send(rate_hz=40.0, ttl_ms=100)
        self.run_ms(30)
        engine = self.rig.engine
        for _ in range(1_000):
            engine.step()
            if not engine.is_between_scans:
                return
        raise Over

    def _again(self) -> None:
        # Nothing wants the supply now, and what failed is tried again within so long.
        self.run_ms(20)
        self.note_supply()
        if self.rig.state == "HALTED":
            self.ask(ClearHalt)
            self.open()
            self.try_wearer_stop()
        self.arm()


#: Scenes that begin as others do, in the same words of the script: what comes at these places has
#: been played there.
BEGUN_AS: Mapping[str, Sequence[str]] = {
    "calibration": ("arming",),
    "stopping": ("arming", "calibration"),
}
Making = Callable[[LoadedConfig, Operations, Course | None], Scene]
#: In the order in which they are played: a self-test takes longest, and nobody is connected.
SCENES: dict[str, Making] = {
    "power-up": _PowerUp,
    "arming": _Arming,
    "frames": _Frames,
    "strongest frames": _StrongestFrames,
    "balanced frames": _BalancedFrames,
    "laws": lambda *given: _Laws("power_law", *given),
    "energy law": lambda *given: _Laws("energy", *given),
    "calibration": _Calibrating,
    "stopping": _Stopping,
    "self-test": SelftestScene,
}
