"""Stage 7, imperceptible probes: what BL and POL do at the chips of half-bridges, by the load
between one electrode and the board's ground.

Owns: what the readings say of the two lines. Must not know: how a probe is fired (`prober.py`).

Between two electrodes a load reads alike in both polarities. To ground it draws current from its
electrode's output while that is high, and none while it is low. With the load at electrode A, the
readings of one command with A selected and with B selected tell the levels that the chips see:

| A selected | B selected | the chips see | the outputs |
|---|---|---|---|
| none | none | BL 0, POL 1 | all low |
| drawn | none | BL 1, POL 1 | the selected one high |
| none | drawn | BL 1, POL 0 | the selected one low |
| drawn | drawn | BL 0, POL 0 | all high |

The last is never commanded, since it puts everybody on the source. The other three commands tell
each single fault of the two lines from all others, and from a load that is still between A and B.
A chip whose A is never selected reads as one whose BL is stuck at 0.
"""

from __future__ import annotations

import statistics
from collections.abc import Callable
from dataclasses import dataclass

from etd.selftest.fixture import LOAD_OPTIONS, MS, DummyLoad, Fixture
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd_hal.bench import Operator
from etd_hal.boardfile import Relays

_NAME, _BACK = "truth_table", "load_back"
#: For moving the load to ground, and back.
_WITHIN_MS = 30_000
_LOOK_EVERY_MS = 100
#: A reading counts that is the same so often in a row: a hand that moves makes others.
_IN_A_ROW = 3
_READINGS_OPEN = 4


@dataclass(frozen=True, slots=True)
class _Lines:
    bl: int
    pol: int

    def __str__(self) -> str:
        return f"BL {self.bl} POL {self.pol}"


#: (drawn with A selected, drawn with B selected): what the chips see.
_Drawn = tuple[bool, bool]
_SEEN: dict[_Drawn, _Lines] = {
    (False, False): _Lines(0, 1),
    (True, False): _Lines(1, 1),
    (False, True): _Lines(1, 0),
    (True, True): _Lines(0, 0),
}
_COMMANDS = (_Lines(0, 1), _Lines(1, 0), _Lines(1, 1))
#: What the chips see of the commands, in this order.
_Reading = tuple[_Lines, ...]


@dataclass(frozen=True, slots=True)
class _Fault:
    """What is wrong beyond the pins, what the chips see then, and what to do."""

    what: str
    seen: Callable[[_Lines], _Lines]
    advice: str


_SWAPPED = "exchange the two wires, or their lines in your own board file"
_INVERTED = "the level shifter or transistor of this line inverts: use one that does not"
_STUCK = "follow the wire from the pin through the level shifter to the chip's own pin: {}"
_CUT = _STUCK.format("it is cut, shorted, or without a driver, and a pull holds it")
_NEVER_SELECTED = _STUCK.format(
    "it is cut or shorted. If BL moves there, electrode {first} is never selected: look at LE,"
    " DATA, CLK, and its wire"
)
_FAULTS = (
    _Fault("BL and POL are swapped", lambda line: _Lines(line.pol, line.bl), _SWAPPED),
    _Fault("POL is inverted", lambda line: _Lines(line.bl, 1 - line.pol), _INVERTED),
    _Fault("BL is inverted", lambda line: _Lines(1 - line.bl, line.pol), _INVERTED),
    _Fault("POL is stuck at 0", lambda line: _Lines(line.bl, 0), _CUT),
    _Fault("POL is stuck at 1", lambda line: _Lines(line.bl, 1), _CUT),
    _Fault("BL is stuck at 0", lambda line: _Lines(0, line.pol), _NEVER_SELECTED),
    _Fault("BL is stuck at 1", lambda line: _Lines(1, line.pol), _CUT),
)
_BY_READING = {tuple(fault.seen(line) for line in _COMMANDS): fault for fault in _FAULTS}
_OTHERS: dict[_Reading, str] = {
    (_Lines(0, 1),) * 3: "the load draws no current with any command: electrode {first}'s output or"
    " wire is dead, or the load is not on it",
    (_Lines(0, 1), _Lines(0, 0), _Lines(0, 0)): "the load is still between electrodes {first} and"
    " {second}, or solder is",
    (_Lines(0, 1), _Lines(1, 1), _Lines(1, 0)): "electrode {second} answers where electrode {first}"
    " should: their wires are swapped, or the load is on the wrong one",
}
_ADVICE = (
    "leave one end on electrode {first}, the other on ground. If it is so, follow BL and POL from"
    " the pins to the chips' own pins, then LE, DATA and CLK"
)


def check(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    """Raises: BusError, BoardFault, GuardRefusal."""
    load, operator = fixture.options.load, fixture.operator
    if isinstance(fixture.file.switch, Relays):
        log.absent(_NAME, "relays have neither BL nor POL")
    elif load is None:
        log.skip(_NAME, "no dummy load", LOAD_OPTIONS)
    elif operator is None:
        log.skip(_NAME, "no operator to move the load", "run it without --no-operator")
    else:
        _Table(fixture, prober, load).check(log, operator)


class _Table:
    def __init__(self, fixture: Fixture, prober: Prober, load: DummyLoad) -> None:
        self._fixture = fixture
        self._prober = prober
        self._load = load
        #: The node's voltage with nothing connected.
        self._open_v = 0.0

    def check(self, log: CheckLog, operator: Operator) -> None:
        load, free = self._load, self._fixture.free[0]
        # With both ends of the load on one side, whatever the two lines do.
        self._open_v = statistics.mean(
            self._prober.probe(free)[1].voltage_v for _ in range(_READINGS_OPEN)
        )
        operator.ground(load.resistance_ohm, load.first)
        reading = self._settled()
        log.judge(
            _NAME,
            reading == _COMMANDS,
            self._described(reading),
            f"as commanded, with {load.resistance_ohm} ohm between electrode {load.first} and the"
            f" board's ground within {_WITHIN_MS // 1_000} s",
            self._advice(reading),
        )
        operator.clip(load.resistance_ohm, load.first, load.second)
        if not log.stage_failed:
            self._check_back(log)

    def _settled(self) -> _Reading:
        """The first reading that stays and is explained by the lines alone, or the last one."""
        begun_ns = self._fixture.clock.now_ns()
        last, in_a_row = self._read(), 1
        while self._fixture.clock.now_ns() - begun_ns < _WITHIN_MS * MS:
            is_explained = last == _COMMANDS or last in _BY_READING
            if is_explained and in_a_row >= _IN_A_ROW:
                break
            self._fixture.wait_ms(_LOOK_EVERY_MS)
            reading = self._read()
            in_a_row = in_a_row + 1 if reading == last else 1
            last = reading
        return last

    def _read(self) -> _Reading:
        load = self._load
        return tuple(
            _SEEN[self._is_drawn(load.first, line), self._is_drawn(load.second, line)]
            for line in _COMMANDS
        )

    def _is_drawn(self, electrode: int, line: _Lines) -> bool:
        """Nearer to what the load makes of a probe than to what an open node does."""
        if line.bl:
            _, result = self._prober.probe(electrode, is_anodic=bool(line.pol))
        else:
            _, result = self._prober.blanked(electrode)
        ohm = self._load.resistance_ohm
        of_open = ohm / (ohm + self._fixture.file.source.leak_ohm)
        return result.voltage_v < self._open_v * (1 + of_open) / 2

    def _described(self, reading: _Reading) -> str:
        if reading == _COMMANDS:
            return "; ".join(map(str, _COMMANDS)) + ": each as commanded"
        acts = [
            f"{line}{', the outputs are' if not index else ''} as with {seen}"
            for index, (line, seen) in enumerate(zip(_COMMANDS, reading, strict=True))
            if seen != line
        ]
        listed = "; ".join(acts)
        fault = _BY_READING.get(reading)
        if fault is not None:
            return f"{fault.what} beyond the pin: commanded {listed}"
        other = _OTHERS.get(reading, "commanded " + listed)
        return other.format(first=self._load.first, second=self._load.second)

    def _advice(self, reading: _Reading) -> str:
        fault = _BY_READING.get(reading)
        return (_ADVICE if fault is None else fault.advice).format(first=self._load.first)

    def _check_back(self, log: CheckLog) -> None:
        """The load must be between its two electrodes again: so it is measured next."""
        load = self._load

        def is_back() -> bool:
            self._fixture.wait_ms(_LOOK_EVERY_MS)
            ends = (load.first, load.second)
            return all(self._is_drawn(end, _Lines(1, pol)) for end in ends for pol in (0, 1))

        is_there = self._fixture.wait_until(is_back, _WITHIN_MS)
        log.judge(
            _BACK,
            is_there,
            "it is back" if is_there else f"not there within {_WITHIN_MS // 1_000} s",
            f"{load.resistance_ohm} ohm between electrodes {load.first} and {load.second} again",
            f"connect it again, and restart the test; if it is connected, electrode {load.second}'s"
            " output or wire is dead",
        )
