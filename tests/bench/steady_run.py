"""One finger under one set of stabilizers: what each scan was felt as.

Owns: the run through the real engine, its limits and drivers on the fake's wires, and what is kept
of it. Must not know: what is made of the figures.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal

import msgspec
import numpy as np

import engine_rig
from bench import steady_skin
from bench.steady_laws import K
from bench.steady_skin import Finger
from engine_rig import EngineRig
from engine_scenes import exponent as usable_exponent
from etd.files.array import PressureSensor
from etd.files.configuration import LoadedConfig, fake_config
from etd.protocol.exponent import FittedExponent
from etd.stabilize.settings import Settings
from etd_body.kinds import BodyKind
from etd_body.tissue import Floats
from etd_hal.backend import Backend
from etd_hal.boardfile import BoardFile, RailMonitor
from etd_hal.ports import Clock, Marker

ELECTRODES = 64
#: Nobody's own: of other fingers.
ANYBODYS = usable_exponent(K)
#: A pulse makes a hundred objects that are gone at once: looking for circles among them costs more
#: than all that it finds.
_COLLECT_AFTER = 200_000
_OPENING_MS, _RENEWED_MS = 1_600, 500.0
SENSOR = PressureSensor(
    address=0x48, channel=0, x_mm=0.0, y_mm=0.0, zero_v=0.5, kpa_per_v=100.0, low_v=0.2, high_v=3.2
)
#: What a conversion is given.
_CONVERTED_NS = 15_000_000


@dataclass(frozen=True)
class Kept:
    """[scan, electrode] of all that was shown: strength and pain, and what part of the contact
    lay on. `piece` and `inside_s`: in which piece the scan was, and how far; [scan].
    """

    felt: Floats
    pain: Floats
    attached: Floats
    piece: Floats
    inside_s: Floats
    body_s: Floats
    counters: dict[str, int]


#: (when it began, felt, pain) of one scan, by electrode.
Scan = tuple[int, tuple[float, ...], tuple[float, ...]]
#: Called about twice a second with the engine, the finger and all scans so far.
Watching = Callable[[EngineRig, Finger, Sequence[Scan]], None]


class Scans:
    """At the start of each scan, what was felt of the one before."""

    def __init__(self, marker: Marker, finger: Finger, clock: Clock) -> None:
        self._marker = marker
        self._finger = finger
        self._clock = clock
        self._scan_ns: int | None = None
        self._period_ns = 0
        self.found: list[Scan] = []

    def mark(self, event: Literal["frame", "mark"], seq: int, tag: int | str | None) -> None:
        begun_ns = self._clock.now_ns()
        if self._scan_ns is not None:
            self._period_ns = begun_ns - self._scan_ns
        self._begin(begun_ns)
        self._marker.mark(event, seq, tag)

    def dark(self) -> None:
        """None has begun for two periods and more: nothing is felt in so many scans."""
        while (
            self._scan_ns is not None and self._clock.now_ns() - self._scan_ns > 2 * self._period_ns
        ):
            self._begin(self._scan_ns + self._period_ns)

    def _begin(self, begun_ns: int) -> None:
        felt, pain = self._finger.body.take_felt()
        if self._scan_ns is not None:
            self.found.append((self._scan_ns, felt, pain))
        self._scan_ns = begun_ns


class _Sensed:
    """A sensor under the middle of the array, and the engine's sensor thread, without a thread:
    the chip has one converter, so that it reads the rail and the sensor by turns.
    """

    def __init__(self, rig: EngineRig, finger: Finger) -> None:
        self._rig = rig
        self._finger = finger
        self._turned_ns = 0
        self._is_rail_next = True
        rig.is_sensing = False

    def turn(self, now_ns: int) -> None:
        if now_ns - self._turned_ns < _CONVERTED_NS:
            return
        self._turned_ns = now_ns
        rail, pressure = self._rig.engine.components.rail, self._rig.engine.components.pressure
        volts = SENSOR.zero_v + self._finger.course.pressure_kpa(now_ns * 1e-9) / SENSOR.kpa_per_v
        self._rig.fake.world.set_sensor_v(SENSOR.address, SENSOR.channel, volts)
        if self._is_rail_next:
            pressure.end(0)
            rail.begin()
        else:
            rail.end()
            pressure.begin(0)
        self._is_rail_next = not self._is_rail_next


def loaded_with(settings: Settings, electrodes: int) -> LoadedConfig:
    """The fake's board and a site with these stabilizers; for those that go by pressure, with a
    sensor under the middle of the array, on the chip that watches the rail.
    """
    loaded = fake_config(electrodes=electrodes)
    site = msgspec.structs.replace(loaded.body_site, stabilize=settings)
    loaded = replace(loaded, body_site=site)
    if settings.pressure is None:
        return loaded
    guards = msgspec.structs.replace(loaded.board.guards, rail_monitor=_monitor(loaded.board))
    board = msgspec.structs.replace(loaded.board, i2c="/dev/i2c-1", guards=guards)
    return replace(
        loaded, board=board, array=msgspec.structs.replace(loaded.array, pressure=(SENSOR,))
    )


def _monitor(board: BoardFile) -> RailMonitor:
    rail_v = board.source.compliance_v
    return RailMonitor(
        address=SENSOR.address,
        channel=SENSOR.channel + 1,
        divider=200.0,
        low_v=0.9 * rail_v,
        high_v=1.1 * rail_v,
        off_v=30.0,
        rise_ms=500,
        fall_ms=3_500,
    )


def run(
    seed: int,
    settings: Settings,
    level: float,
    minutes: float,
    pieces: int | None,
    *,
    electrodes: int = ELECTRODES,
    kind: BodyKind | None = None,
    exponent: FittedExponent | None = ANYBODYS,
    rate_hz: float | None = None,
    watching: Watching | None = None,
    from_s: float = steady_skin.FIRST_S,
) -> Kept:
    """All electrodes at the same level, all the time (None) or in so many pieces of it. `exponent`:
    what was found of the person; None: nothing. `rate_hz`: None is what it was calibrated at.
    `from_s`: since the finger was laid on, where all of the time is played.
    """
    gc.set_threshold(_COLLECT_AFTER)
    loaded = loaded_with(settings, electrodes)
    finger = steady_skin.finger(
        seed, loaded.board, loaded.array, minutes, pieces, kind, from_s=from_s
    )
    made: list[Scans] = []

    def watched(backend: Backend) -> Backend:
        made.append(Scans(backend.marker, finger, backend.clock))
        return replace(backend, marker=made[0])

    rig = engine_rig.make(loaded=loaded, body=finger.body, is_traced=False, wrap=watched)
    if settings.pressure is not None:
        rig.meanwhile = _Sensed(rig, finger).turn
    # It was made with plain pulses all the same: what narrow ones and prepulses change shows.
    calibration = msgspec.structs.replace(
        finger.calibration,
        shape=settings.shape,
        exponent=exponent,
    )
    answer = rig.open_with(calibration)
    assert answer.error is None, answer.reason
    rig.arm()
    # What was not felt up to the most that anybody gets is left out, as a person's would be.
    levels = tuple(level * limits.felt for limits in finger.calibration.electrode)
    frame: dict[str, Any] = {"level": levels, "ttl_ms": 1_000}
    if rate_hz is not None:
        frame["rate_hz"] = rate_hz
    rig.hold(_OPENING_MS, **frame)
    begun_ns = rig.clock.now_ns()
    finger.course.begin(begun_ns * 1e-9)
    until_ns = begun_ns + int(finger.pieces.engine_s * 1e9)
    for _ in _held(rig, made[0], until_ns, frame):
        if watching is not None:
            watching(rig, finger, made[0].found)
    counters = dict(rig.engine.components.reporter.counters)
    problems = rig.close()
    assert problems == (), problems
    return _kept(finger, made[0], begun_ns, counters)


def _held(rig: EngineRig, scans: Scans, until_ns: int, frame: dict[str, Any]) -> Iterator[None]:
    """The same frame, sent anew before it lapses. One that is refused for its net charge is dark
    until it is taken again. A report for every pulse of ten minutes is more than anybody reads.
    """
    while rig.clock.now_ns() < until_ns:
        answer = rig.show(**frame)
        assert answer.error is None or "net charge" in answer.reason, answer.reason
        rig.run_ms(min(_RENEWED_MS, (until_ns - rig.clock.now_ns()) / 1e6))
        if answer.error is not None:
            scans.dark()
        yield
        rig.reports.clear()
        rig.others.clear()


def _kept(finger: Finger, scans: Scans, begun_ns: int, counters: dict[str, int]) -> Kept:
    found = [entry for entry in scans.found if entry[0] >= begun_ns]
    elapsed_s = [(entry[0] - begun_ns) * 1e-9 for entry in found]
    places = [finger.pieces.at(value) for value in elapsed_s]
    counted = [number for number, (_, inside_s) in enumerate(places) if inside_s >= 0.0]
    body_s = [places[number][0] for number in counted]
    return Kept(
        felt=np.array([found[number][1] for number in counted]),
        pain=np.array([found[number][2] for number in counted]),
        attached=steady_skin.attached(finger, body_s),
        piece=np.array([elapsed_s[number] // finger.pieces.each_s for number in counted]),
        inside_s=np.array([places[number][1] for number in counted]),
        body_s=np.array(body_s),
        counters=counters,
    )
