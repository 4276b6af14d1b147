"""What a board file requests from the kernel: its lines, in order and with levels, and its SPI.

Owns: that no intermediate level lifts an electrode or switches a supply on. Must not know:
backends, how a line is requested.
"""

from __future__ import annotations

from etd_hal.boardfile import BoardFile
from etd_hal.ports import InputLine, LineSetup, Pull, SpiSetup


def line_setup(board: BoardFile) -> LineSetup:
    """The lines to request: harmless levels, in an order that is harmless in between.

    POL, BL and the supply come first, so that no intermediate state lifts the electrodes.
    """
    lines = board.switch.lines
    guards = board.guards
    first = [(getattr(lines, name), level) for name, level in board.switch.safe_levels]
    if guards.hv_enable != "absent":
        first.append((guards.hv_enable.line, 1 - guards.hv_enable.on))
    rest = [lines.LE, lines.DATA, lines.CLK]
    if guards.heartbeat != "absent":
        rest.append(guards.heartbeat.line)
    if board.sync_line != "absent":
        rest.append(board.sync_line)
    outputs = (*first, *((line, 0) for line in rest))
    return LineSetup(outputs, _input_lines(board))


def _input_lines(board: BoardFile) -> tuple[InputLine, ...]:
    guards = board.guards
    inputs: list[InputLine] = []
    if guards.readback != "absent":
        inputs.append(InputLine(guards.readback))
    for stop in (guards.emergency_stop, guards.wearer_stop):
        if stop != "absent":
            inputs.append(InputLine(stop, pull="down", edges=True))
    for edge_input in (board.trigger, board.too_strong):
        if edge_input != "absent":
            pull: Pull = "down" if edge_input.edge == "rising" else "up"
            inputs.append(InputLine(edge_input.line, pull=pull, edges=True))
    return tuple(inputs)


def spi_setup(board: BoardFile) -> SpiSetup:
    """The SPI device, mode and speed."""
    source = board.source
    return SpiSetup(source.spi, source.mode, source.speed_hz)
