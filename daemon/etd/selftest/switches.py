"""Stage 7, imperceptible probes: every electrode's switch on two known loads, and nothing with it.

Owns: who is asked to touch what, how long, and what is concluded. Must not know: how a touch is
read (`touch.py`); how a person or a fake moves the load.

One end of the load stays on its first electrode. The other end touches every other electrode when
it is asked for, and that one must answer, alone. Then the same with the second load. Whoever else
may answer is looked at on the source in the first walk, and on ground in the second.
"""

from __future__ import annotations

import statistics
from dataclasses import replace

from etd.selftest.fixture import LOAD_OPTIONS, MS, SECOND_LOAD_OPTION, DummyLoad, Fixture
from etd.selftest.log import CheckLog
from etd.selftest.probe import check_alone
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
#: For each electrode, from when it was asked for.
_WITHIN_MS = 30_000
#: To put one resistor in the place of another.
_CHANGE_WITHIN_MS = 60_000
_LOOK_EVERY_MS = 100
#: After a round that was not good.
_ROUND_EVERY_MS = 300
#: Of either end of a second load, in one look.
_READINGS = 4
#: A hand on its way is still where it was: who else answers is asked after this, and so often.
_ON_ITS_WAY_MS = 3_000
_OTHERS_EVERY_MS = 1_000


def check(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    """Raises: BusError, BoardFault, GuardRefusal."""
    load, second = fixture.options.load, fixture.options.second_load
    if load is None or not fixture.is_load_confirmed:
        _skip(log, _ALL, "no load was found", LOAD_OPTIONS)
        return
    if fixture.operator is None:
        _skip(log, _ALL, "nobody is there to move the load", "run it without --no-operator")
        return
    fixture.is_load_confirmed = False
    touch = Touch(fixture, prober, load)
    _Walk(fixture, log, fixture.operator, touch, load).over_all(_FIRST)
    if second is None:
        _skip(log, (_CHANGE, _SECOND), "no second load was named", SECOND_LOAD_OPTION)
    elif not log.stage_failed:
        fixture.operator.clip(second.resistance_ohm, second.first, second.second)
        expected_v = touch.load_v * _beside_ohm(fixture, second) / _beside_ohm(fixture, load)
        if _is_changed(fixture, log, prober, second, expected_v):
            # Who is taken along in one polarity alone shows in one of the two walks.
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
    """With one load, over every electrode but its fixed end's."""

    def __init__(
        self, fixture: Fixture, log: CheckLog, operator: Operator, touch: Touch, load: DummyLoad
    ) -> None:
        self._fixture = fixture
        self._log = log
        self._operator = operator
        self._touch = touch
        self._load = load

    def over_all(self, name: str) -> None:
        """Ends at the first electrode that does not answer as it should."""
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
            f"{count} electrodes found on {self._load.resistance_ohm} ohm",
            "the load, where it was asked for and in both polarities",
        )
        self._log.judge(_ALONE, True, f"{count - 1} rounds over all others", self._nobody())

    def _nobody(self) -> str:
        side = "the source" if self._touch.others_anodic else "ground"
        return f"nobody else answers, each alone on {side}"

    def _wait_for(self, asked: int) -> Look:
        """The look that is good, or the last one when time is over."""
        begun_ns = self._fixture.clock.now_ns()
        told: tuple[int, ...] = ()
        others_after_ms = float(_ON_ITS_WAY_MS)
        # However fast the hand, no electrode is probed oftener than its rate.
        again_ms = _LOOK_EVERY_MS
        while True:
            self._fixture.wait_ms(again_ms)
            look = self._touch.look(asked)
            took_ms = (self._fixture.clock.now_ns() - begun_ns) / MS
            is_over = took_ms >= _WITHIN_MS
            if not look.answers and (is_over or took_ms >= others_after_ms):
                others_after_ms = took_ms + _OTHERS_EVERY_MS
                look = replace(look, others=self._touch.answering(asked))
                if look.others and look.others != told:
                    self._operator.misplaced(asked, look.others)
                told = look.others
            if look.is_good or is_over:
                return look
            again_ms = _ROUND_EVERY_MS if look.answers else _LOOK_EVERY_MS

    def _judge(self, asked: int, look: Look, name: str) -> None:
        """What was wrong with the last look at an electrode."""
        listed = ", ".join(map(str, look.others[:8]))
        if look.answers and look.others:
            self._log.judge(
                _ALONE,
                False,
                f"with electrode {asked}: {listed}",
                f"{self._nobody()}, but the load's fixed end",
                _ALONE_ADVICE,
            )
            return
        said = f"electrode {asked} reads {look.read_v[0]:.2f} V and {look.read_v[1]:.2f} V"
        if look.answers:
            said = f"electrode {asked} was let go of before all others were looked at"
        elif look.others:
            said += f"; {listed} answers in its place"
        self._log.judge(
            name,
            False,
            said,
            f"{self._touch.load_v:.2f} V in both polarities within {_WITHIN_MS // 1_000} s",
            _FOUND_ADVICE,
        )


_FOUND_ADVICE = (
    "touch it longer. If another one answers, look for the right place, then for swapped wires and"
    " the array file's outputs; else this output or its wire is dead, or half dead"
)
_ALONE_ADVICE = (
    "let the tip touch one pin only. If it does, these outputs switch together, or their wires"
    " touch; if the load's fixed end is among them, its wire is another one's"
)


def _is_changed(
    fixture: Fixture, log: CheckLog, prober: Prober, second: DummyLoad, expected_v: float
) -> bool:
    """The second load is in the first one's place, and is what it is said to be."""
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
        "measure this resistor, too, and look where it is",
    )


def _steady_v(prober: Prober, electrode: int) -> float:
    return statistics.mean(prober.probe(electrode)[1].voltage_v for _ in range(_READINGS))


def _check_back(
    fixture: Fixture, log: CheckLog, prober: Prober, touch: Touch, load: DummyLoad
) -> None:
    """The load between its two electrodes and nothing else: what comes next is strong."""

    def look() -> bool:
        fixture.wait_ms(_LOOK_EVERY_MS)
        return touch.reads_load(load.second)

    is_there = fixture.wait_until(look, _CHANGE_WITHIN_MS)
    is_back = log.judge(
        "load_back",
        is_there,
        "it is back" if is_there else f"not seen there within {_CHANGE_WITHIN_MS // 1_000} s",
        f"{load.resistance_ohm} ohm between electrodes {load.first} and {load.second} again",
        "put it back, and begin again",
    )
    is_alone = check_alone(fixture, log, read_map(fixture, prober), fixture.free, "nothing_else")
    fixture.is_load_confirmed = is_back and is_alone
