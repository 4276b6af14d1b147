"""Stage 9, imperceptible probes: every electrode's switch, alone, on two known loads.

Owns: the instructions to the operator, their time limits, and the conclusions. Must not know: how a
touch is read (`touch.py`); how a person or a fake moves the load.

One end of the load stays on its first electrode. The operator touches every other electrode with
the other end when asked to; that electrode, and no other, must read the load. Then the same with
the second load. The other electrodes are probed on the source in the first walk, on ground in the
second.
"""

from __future__ import annotations

import statistics
from dataclasses import replace

from etd.selftest.array import check_alone
from etd.selftest.fixture import LOAD_OPTIONS, MS, SECOND_LOAD_OPTION, DummyLoad, Fixture
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd.selftest.readings import is_near_v, read_map
from etd.selftest.touch import Look, Touch
from etd_hal.bench import Operator

_FIRST, _ALONE, _CHANGE, _SECOND = _ALL = (
    "every_switch",
    "one_at_a_time",
    "second_load",
    "every_switch_again",
)
#: For each electrode, from the instruction on.
_WITHIN_MS = 30_000
#: For changing the resistor.
_CHANGE_WITHIN_MS = 60_000
_LOOK_EVERY_MS = 100
#: After a round that was not good.
_ROUND_EVERY_MS = 300
#: Of each end of a second load, at a time.
_READINGS = 4
#: While the hand moves, the load is still at the last electrode: other electrodes are probed after
#: this time, and then this often.
_ON_ITS_WAY_MS = 3_000
_OTHERS_EVERY_MS = 1_000


def check(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    """Raises: BusError, BoardFault, GuardRefusal."""
    load, second = fixture.options.load, fixture.options.second_load
    if load is None or not fixture.is_load_confirmed:
        _skip(log, _ALL, "no confirmed dummy load", LOAD_OPTIONS)
        return
    if fixture.operator is None:
        _skip(log, _ALL, "no operator to move the load", "run it without --no-operator")
        return
    fixture.is_load_confirmed = False
    touch = Touch(fixture, prober, load)
    _Walk(fixture, log, fixture.operator, touch, load).over_all(_FIRST)
    if second is None:
        _skip(log, (_CHANGE, _SECOND), "no second load", SECOND_LOAD_OPTION)
    elif not log.stage_failed:
        fixture.operator.clip(second.resistance_ohm, second.first, second.second)
        expected_v = touch.load_v * _beside_ohm(fixture, second) / _beside_ohm(fixture, load)
        if _is_changed(fixture, log, prober, second, expected_v):
            # A crosstalk of one polarity only shows in one of the two walks.
            on_ground = Touch(fixture, prober, second, others_anodic=False)
            _Walk(fixture, log, fixture.operator, on_ground, second).over_all(_SECOND)
    if not log.stage_failed:
        fixture.operator.clip(load.resistance_ohm, load.first, load.second)
        _check_back(fixture, log, prober, touch, load)


def _skip(log: CheckLog, names: tuple[str, ...], why: str, advice: str) -> None:
    for name in names:
        log.skip(name, why, advice)


def _beside_ohm(fixture: Fixture, load: DummyLoad) -> float:
    return 1 / (1 / load.resistance_ohm + 1 / fixture.leak_ohm)


class _Walk:
    """With one load, over every electrode except that of its fixed end."""

    def __init__(
        self, fixture: Fixture, log: CheckLog, operator: Operator, touch: Touch, load: DummyLoad
    ) -> None:
        self._fixture = fixture
        self._log = log
        self._operator = operator
        self._touch = touch
        self._load = load

    def over_all(self, name: str) -> None:
        """Ends at the first electrode that fails."""
        count = self._fixture.loaded.array.count
        for asked in range(count):
            if asked == self._load.first:
                continue
            self._operator.clip(self._load.resistance_ohm, self._load.first, asked)
            look = self._wait_for(asked)
            if not look.is_good:
                self._judge(asked, look, name)
                return
        self._log.judge(
            name,
            True,
            f"{count} electrodes read {self._load.resistance_ohm} ohm",
            "the load at the electrode that was asked for, in both polarities",
        )
        self._log.judge(_ALONE, True, f"{count - 1} rounds over all others", self._alone())

    def _alone(self) -> str:
        side = "the source" if self._touch.others_anodic else "ground"
        return f"no other electrode reads the load, each alone on {side}"

    def _wait_for(self, asked: int) -> Look:
        """The first good look, or the last one when time is over."""
        begun_ns = self._fixture.clock.now_ns()
        reported: tuple[int, ...] = ()
        others_after_ms = float(_ON_ITS_WAY_MS)
        # No electrode may be probed more often than its rate.
        again_ms = _LOOK_EVERY_MS
        while True:
            self._fixture.wait_ms(again_ms)
            look = self._touch.look(asked)
            took_ms = (self._fixture.clock.now_ns() - begun_ns) / MS
            is_over = took_ms >= _WITHIN_MS
            if not look.answers and (is_over or took_ms >= others_after_ms):
                others_after_ms = took_ms + _OTHERS_EVERY_MS
                look = replace(look, others=self._touch.answering(asked))
                if look.others and look.others != reported:
                    self._operator.misplaced(asked, look.others)
                reported = look.others
            if look.is_good or is_over:
                return look
            again_ms = _ROUND_EVERY_MS if look.answers else _LOOK_EVERY_MS

    def _judge(self, asked: int, look: Look, name: str) -> None:
        """Report the failure that the last look at an electrode shows."""
        listed = ", ".join(map(str, look.others[:8]))
        if look.answers and look.others:
            self._log.judge(
                _ALONE,
                False,
                f"with electrode {asked}: {listed}",
                f"{self._alone()}, except the load's fixed end",
                _ALONE_ADVICE,
            )
            return
        measured = f"electrode {asked} reads {look.read_v[0]:.2f} V and {look.read_v[1]:.2f} V"
        if look.answers:
            measured = f"electrode {asked} was released before all others were probed"
        elif look.others:
            measured += f"; {listed} reads the load instead"
        self._log.judge(
            name,
            False,
            measured,
            f"{self._touch.load_v:.2f} V in both polarities within {_WITHIN_MS // 1_000} s",
            _FOUND_ADVICE,
        )


_FOUND_ADVICE = (
    "touch it longer. If another electrode reads the load, check the place, then for swapped wires,"
    " and the outputs in the array file; otherwise this output or its wire is defective"
)
_ALONE_ADVICE = (
    "touch one pin only. If you did, these outputs switch together, or their wires touch; if the"
    " load's fixed end is among them, its wire is connected to the wrong output"
)


def _is_changed(
    fixture: Fixture, log: CheckLog, prober: Prober, second: DummyLoad, expected_v: float
) -> bool:
    """Whether the second load has replaced the first one, and has the named value."""
    ends_v: list[float] = []

    def look() -> bool:
        ends_v[:] = [_steady_v(prober, electrode) for electrode in (second.first, second.second)]
        fixture.wait_ms(_LOOK_EVERY_MS)
        return all(is_near_v(volts, expected_v, fixture.file.source) for volts in ends_v)

    return log.judge(
        _CHANGE,
        fixture.wait_until(look, _CHANGE_WITHIN_MS),
        " and ".join(f"{volts:.2f} V" for volts in ends_v),
        f"{expected_v:.2f} V, {second.resistance_ohm} ohm, at electrodes {second.first} and"
        f" {second.second} within {_CHANGE_WITHIN_MS // 1_000} s",
        "measure this resistor, and check its place",
    )


def _steady_v(prober: Prober, electrode: int) -> float:
    return statistics.mean(prober.probe(electrode)[1].voltage_v for _ in range(_READINGS))


def _check_back(
    fixture: Fixture, log: CheckLog, prober: Prober, touch: Touch, load: DummyLoad
) -> None:
    """The load must be back at its two electrodes, and alone: strong pulses follow."""

    def look() -> bool:
        fixture.wait_ms(_LOOK_EVERY_MS)
        return touch.reads_load(load.second)

    is_there = fixture.wait_until(look, _CHANGE_WITHIN_MS)
    is_back = log.judge(
        "load_back",
        is_there,
        "it is back" if is_there else f"not there within {_CHANGE_WITHIN_MS // 1_000} s",
        f"{load.resistance_ohm} ohm between electrodes {load.first} and {load.second} again",
        "connect it again, and restart the test",
    )
    is_alone = check_alone(fixture, log, read_map(fixture, prober), fixture.free, "nothing_else")
    fixture.is_load_confirmed = is_back and is_alone
