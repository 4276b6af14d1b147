"""Stage 2, supply off where it can be: the lines, the chips on SPI and I2C, the stop lines.

Owns: the checks that all devices answer and all outputs are off. Must not know: pulses.
"""

from __future__ import annotations

from etd.selftest.fixture import Fixture
from etd.selftest.log import CheckLog
from etd_hal.bench import Operator, StopName
from etd_hal.boardfile import HalfBridgeLines
from etd_hal.chips import ads1115, mcp4725
from etd_hal.errors import BoardFault, BusError

#: The node with the DAC at zero: no more than the ADC's offset.
IDLE_V = 1.0
_ECHOES = 8
_OPERATOR_WITHIN_MS = 20_000
_RELEASED_WITHIN_MS = 5_000


def check(fixture: Fixture, log: CheckLog) -> None:
    """Raises: BusError, BoardFault, GuardRefusal."""
    problems = fixture.board.safe_off()
    if _check_echo(fixture, log):
        check_idle(fixture, log, "idle_node")
    log.judge(
        "safe_state",
        not problems,
        "; ".join(problems) or "commanded, and the node is at rest",
        "outputs off, DAC at zero, nothing selected",
        "check the first item listed; leave the supply off",
    )
    if log.stage_failed:
        return
    _check_lines(fixture, log)
    _check_monitor(fixture, log)
    _check_setpoint(fixture, log)
    _check_stop(fixture, log, "emergency_stop")
    _check_stop(fixture, log, "wearer_stop")


def _check_echo(fixture: Fixture, log: CheckLog) -> bool:
    """The ADC answers each word with two zeros, twelve bits, two zeros."""
    advice = "check MISO, chip select and SPI mode: 0xffff means that MISO floats high or is cut"
    try:
        codes = _echoes(fixture)
    except BoardFault as fault:
        return log.judge("spi_echo", False, fault.measured, fault.expected, advice)
    return log.judge("spi_echo", True, f"{len(codes)} frames, codes up to {max(codes)}")


def _echoes(fixture: Fixture) -> list[int]:
    return [fixture.board.node_code() for _ in range(_ECHOES)]


def check_idle(fixture: Fixture, log: CheckLog, name: str) -> None:
    """With the DAC at zero the node is drained by the leak. Raises: BusError, BoardFault."""
    idle_v = max(_echoes(fixture)) * fixture.file.source.node_uv_per_code / 1e6
    log.judge(
        name,
        idle_v <= IDLE_V,
        f"{idle_v:.2f} V with the DAC at zero",
        f"at most {IDLE_V} V",
        "cut the supply: the DAC does not go to zero, or the source has an offset",
    )


def _check_lines(fixture: Fixture, log: CheckLog) -> None:
    """Each output of the header is moved, and read back at the pin."""
    wrong = [name for name, level in _moves(fixture) if not level]
    log.judge(
        "lines",
        not wrong,
        f"{', '.join(dict.fromkeys(wrong))} did not follow" if wrong else "all follow",
        "each output reads back as it is driven",
        "something else drives this line, or it is shorted: test again without the board",
    )


def _moves(fixture: Fixture) -> list[tuple[str, bool]]:
    """(line, whether it followed); the DAC stands at zero throughout."""
    board, used = fixture.board, fixture.file.used_lines()
    found: list[tuple[str, bool]] = []

    def look(name: str, level: int) -> None:
        found.append((name, fixture.gpio.get(used[name]) == level))

    board.switch.clear()
    for name in ("DATA", "CLK", "LE", "HEARTBEAT", "SYNC"):
        if name in used:
            for level in (1, 0):
                board.guard.gpio.set(((used[name], level),))
                look(name, level)
    if isinstance(fixture.file.switch.lines, HalfBridgeLines):
        selection = board.selection(0, None)
        board.switch.reset()
        board.prepare(selection, whole=True)
        for is_anodic in (True, False):
            board.connect(selection, is_anodic)
            look("BL", 1)
            look("POL", int(is_anodic))
            board.discharge()
            look("BL", 0)
            look("POL", 1)
    board.switch.clear()
    return found


def _check_monitor(fixture: Fixture, log: CheckLog) -> None:
    monitor = fixture.file.guards.rail_monitor
    if monitor == "absent":
        log.absent("rail_monitor")
        return
    expected = f"an ADS1115 at 0x{monitor.address:02x}"
    try:
        volts = ads1115.convert_v(
            fixture.i2c, monitor.address, monitor.channel, lambda ns: fixture.wait_ms(ns / 1e6)
        )
    except BusError as error:
        log.judge("rail_monitor", False, str(error), expected, _I2C_ADVICE)
        return
    log.judge("rail_monitor", True, f"{volts:.3f} V at its input", expected)


def _check_setpoint(fixture: Fixture, log: CheckLog) -> None:
    setpoint = fixture.file.rail_setpoint
    if setpoint == "absent":
        return
    expected = "an MCP4725 with power-up code 0 that accepts a code"
    try:
        stored = mcp4725.read_power_up(fixture.i2c, setpoint.address)
        mcp4725.write(fixture.i2c, setpoint.address, setpoint.code)
    except (BusError, BoardFault) as error:
        log.judge("rail_setpoint", False, str(error), expected, _I2C_ADVICE)
        return
    log.judge(
        "rail_setpoint",
        stored == 0,
        f"code {stored} at power-up, {setpoint.code} now",
        expected,
        "write 0 into its EEPROM: at power-up the rail is set by that code",
    )


_I2C_ADVICE = "check SDA, SCL, their pull-ups and the chip's supply; i2cdetect lists the chips"


def _check_stop(fixture: Fixture, log: CheckLog, name: StopName) -> None:
    """Closed, then seen to open, then closed again."""
    stops = fixture.board.stops()
    if name not in stops:
        log.absent(name)
        return
    if stops[name]:
        log.judge(
            name, False, "open", "closed", "release it, or plug it in: an open loop means stop"
        )
        return
    if fixture.operator is None:
        log.skip(name, "closed; no operator to press it", "run it without --no-operator")
        return
    is_seen, is_closed = _pressed_and_released(fixture, fixture.operator, name)
    measured = "pressed and released" if is_closed else "pressed, but not seen to close again"
    log.judge(
        name,
        is_closed,
        measured if is_seen else f"not seen to open within {_OPERATOR_WITHIN_MS // 1_000} s",
        "seen to open, and closed again",
        "measure the loop at the line: the contact must open it",
    )


def _pressed_and_released(
    fixture: Fixture, operator: Operator, name: StopName
) -> tuple[bool, bool]:
    """Whether it was seen to open, and to close again; a board without enable is energized."""
    fixture.held_stop = name
    try:
        operator.press(name)
        is_seen = fixture.wait_until(lambda: fixture.board.stops()[name], _OPERATOR_WITHIN_MS)
        return is_seen, is_seen and fixture.wait_until(
            lambda: not fixture.board.stops()[name], _RELEASED_WITHIN_MS
        )
    finally:
        fixture.held_stop = None
