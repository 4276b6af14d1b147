"""A board's wiring: the 40-pin header with every wire and pull, and every guard.

Owns: the look of the header, and the sentences about guards. Must not know: which pin is which
(`header.py`), files.
"""

from __future__ import annotations

from etd.draw.header import (
    PIN_OF_GPIO,
    POWER_PINS,
    RESERVED_GPIO,
    Group,
    Wire,
    held_pins,
    unplaced,
    wires_of,
)
from etd.draw.palette import (
    BLUE,
    BROWN,
    FAINT,
    GREEN,
    GRID,
    INK,
    PAPER,
    PURPLE,
    SOFT,
    VERMILLION,
    WARNING,
)
from etd.draw.sheet import MARGIN_MM, MIDDLE_EM, PAGE_MM, Picture, Sheet
from etd_hal.boardfile import GUARDS, BoardFile

#: Between two pins of a row, and from row to row; much more than the header's own 2.54 mm.
_ROW_MM, _APART_MM, _PIN_MM = 8.4, 8.0, 2.7
_MIDDLE_MM = MARGIN_MM + PAGE_MM / 2
#: From a pin to what is written beside it.
_LEAD_MM = 5.5
_NAME_MM, _WORDS_MM = 2.5, 2.1

_COLORS: dict[Group, str] = {
    "switch": BLUE,
    "source": VERMILLION,
    "i2c": PURPLE,
    "guard": GREEN,
    "sync": BROWN,
}
_GROUPS: dict[Group, str] = {
    "switch": "switches",
    "source": "current path",
    "i2c": "I2C",
    "guard": "guards",
    "sync": "edges",
}
_GPIO_OF_PIN = {pin: gpio for gpio, pin in PIN_OF_GPIO.items()}
#: What reads a 5 V level; from docs/hardware.md.
_FIVE_VOLTS = ("HV507", "HV513")


def board_sheet(board: BoardFile) -> Picture:
    """The header of a board and its guards."""
    sheet = Sheet(f"Board {board.name}: the 40-pin header")
    wires = wires_of(board)
    y = _head(sheet, board)
    y = _header(sheet, {wire.pin: wire for wire in wires}, held_pins(board), y + 3.0)
    y = _guards(sheet, board, y + 2.0)
    for note in _notes(board, wires):
        y = sheet.paragraph(MARGIN_MM, y + 0.6, note, PAGE_MM, size=2.5, color=WARNING)
    present = len(board.present_guards)
    summary = f"the 40-pin header with {len(wires)} wires; {present} of {len(GUARDS)} guards"
    return sheet.picture(MARGIN_MM + PAGE_MM, y, summary)


def _head(sheet: Sheet, board: BoardFile) -> float:
    y = sheet.paragraph(MARGIN_MM, MARGIN_MM, board.title, PAGE_MM, size=5.0, bold=True)
    source = board.source
    y = sheet.paragraph(
        MARGIN_MM,
        y,
        f"board {board.name}: {board.switch.chip} with {board.switch.outputs} outputs;"
        f" {source.dac} and {source.adc} on {source.spi}, mode {source.mode},"
        f" {source.speed_hz / 1e6:g} MHz",
        PAGE_MM,
        size=2.8,
    )
    y = sheet.paragraph(
        MARGIN_MM,
        y,
        "Seen onto the pins of the Raspberry Pi: pin 1 is square, at the end of the microSD card;"
        " pins 2 to 40 are along the edge. Not to scale.",
        PAGE_MM,
        size=2.8,
    )
    x, middle = MARGIN_MM, y + 2.4
    for group, name in _GROUPS.items():
        sheet.line(x, middle, x + 5.0, middle, stroke=_COLORS[group], width=0.8)
        sheet.text(x + 6.5, middle + MIDDLE_EM * 2.6, name, size=2.6)
        x += 30.0
    sheet.circle(x + 2.0, middle, 1.6, fill=GRID, stroke=FAINT)
    sheet.text(x + 5.0, middle + MIDDLE_EM * 2.6, "not used", size=2.6, color=FAINT)
    y, x = y + 4.5, MARGIN_MM
    for level, words in ((1, "pull-up to fit"), (0, "pull-down to fit")):
        _triangle(sheet, x + 2.5, y + 2.4, level, INK)
        sheet.text(x + 6.5, y + 2.4 + MIDDLE_EM * 2.6, words, size=2.6)
        x += 30.0
    return y + 4.5


def _triangle(
    sheet: Sheet, x: float, middle: float, level: int, color: str, mark: str = ""
) -> None:
    """A resistor, to 3.3 V upwards, to ground downwards."""
    tip = -1.5 if level else 1.5
    corners = [(x, middle + tip), (x - 1.4, middle - tip * 0.6), (x + 1.4, middle - tip * 0.6)]
    sheet.polygon(corners, fill=PAPER, stroke=color, mark=mark)


# --- the header --------------------------------------------------------------------------------


def _header(sheet: Sheet, wires: dict[int, Wire], held: dict[int, str], y: float) -> float:
    """Two columns of pins, odd ones on the left. Returns the lower edge."""
    across, down = 2 * _APART_MM, 20 * _ROW_MM
    sheet.rect(_MIDDLE_MM - across / 2, y, across, down, fill=PAPER, stroke=FAINT, width=0.3)
    for pin in range(1, 41):
        is_left = pin % 2 == 1
        x = _MIDDLE_MM + (-_APART_MM if is_left else _APART_MM) / 2
        middle = y + ((pin - 1) // 2 + 0.5) * _ROW_MM
        _pin(sheet, pin, wires.get(pin), x, middle)
        side = -1.0 if is_left else 1.0
        outside = _MIDDLE_MM + side * (_APART_MM + _LEAD_MM)
        if pin in wires:
            wire = wires[pin]
            sheet.line(
                x + side * _PIN_MM, middle, outside, middle, stroke=_COLORS[wire.group],
                width=0.8, mark=f"wire-{pin}",
            )  # fmt: skip
            if wire.is_fitted and wire.level is not None:
                at = outside - side * 2.6
                _triangle(sheet, at, middle, wire.level, _COLORS[wire.group], f"pull-{pin}")
            _beside(sheet, outside + side, middle, is_left, wire)
        else:
            sheet.text(
                outside + side, middle + MIDDLE_EM * _NAME_MM, _without_wire(pin, held),
                size=_NAME_MM, anchor="end" if is_left else "start",
                color=INK if pin in POWER_PINS else FAINT, mark=f"pin-{pin}-name",
            )  # fmt: skip
    return y + down


def _pin(sheet: Sheet, pin: int, wire: Wire | None, x: float, middle: float) -> None:
    """Its number in a circle, for pin 1 in a square; dark where something is connected."""
    name = POWER_PINS.get(pin)
    if wire is not None:
        fill, ink = _COLORS[wire.group], PAPER
    elif name == "GND":
        fill, ink = INK, PAPER
    elif name is not None:
        fill, ink = PAPER, INK
    else:
        fill, ink = GRID, FAINT
    edge = INK if name is not None else FAINT
    if pin == 1:
        sheet.rect(
            x - _PIN_MM, middle - _PIN_MM, 2 * _PIN_MM, 2 * _PIN_MM, fill=fill, stroke=edge,
            width=0.3, mark="pin-1",
        )  # fmt: skip
    else:
        sheet.circle(x, middle, _PIN_MM, fill=fill, stroke=edge, width=0.3, mark=f"pin-{pin}")
    sheet.text(
        x, middle + MIDDLE_EM * 2.5, str(pin), size=2.5, anchor="middle", color=ink, bold=True,
        mark=f"pin-{pin}-number",
    )  # fmt: skip


def _beside(sheet: Sheet, x: float, middle: float, is_left: bool, wire: Wire) -> None:
    anchor = "end" if is_left else "start"
    ways = {"out": "out of the Pi", "in": "into the Pi", "both": "both ways"}
    sheet.text(
        x, middle - 1.3, f"{wire.name}: GPIO {wire.gpio}, {ways[wire.direction]}", size=_NAME_MM,
        anchor=anchor, bold=True, mark=f"pin-{wire.pin}-name",
    )  # fmt: skip
    sheet.text(x, middle + 1.2, wire.purpose, size=_WORDS_MM, anchor=anchor, color=SOFT)
    sheet.text(
        x, middle + 3.7, wire.pull, size=_WORDS_MM, anchor=anchor,
        color=_color_of_pull(wire), mark=f"pin-{wire.pin}-pull",
    )  # fmt: skip


def _color_of_pull(wire: Wire) -> str:
    if wire.is_pulled_the_other_way:
        return WARNING
    return INK if wire.is_fitted else SOFT


def _without_wire(pin: int, held: dict[int, str]) -> str:
    if pin in POWER_PINS:
        return POWER_PINS[pin]
    gpio = _GPIO_OF_PIN[pin]
    if pin in held:
        return f"GPIO {gpio}: held by {held[pin]}, leave it free"
    return f"GPIO {gpio}" + (": leave it free" if gpio in RESERVED_GPIO else "")


# --- guards and notes --------------------------------------------------------------------------


def _guards(sheet: Sheet, board: BoardFile, y: float) -> float:
    """A line each: a full circle where the guard is present, an empty one where it is absent."""
    size, indent = 2.6, 34.0
    sheet.text(MARGIN_MM, y + 3.4, "Guards", size=3.4, bold=True)
    y += 4.8
    for name in GUARDS:
        is_present = name in board.present_guards
        middle = y + 0.62 * size
        color = INK if is_present else WARNING
        sheet.circle(
            MARGIN_MM + 1.3, middle, 1.0, fill=GREEN if is_present else PAPER, stroke=color,
            width=0.3, mark=f"guard-{name}",
        )  # fmt: skip
        sheet.text(MARGIN_MM + 4.0, y + size, name, size=size, bold=True, color=color)
        y = sheet.paragraph(
            MARGIN_MM + indent, y, _guard(board, name), PAGE_MM - indent, size=size, color=color
        )
    return y


def _guard(board: BoardFile, name: str) -> str:
    guards = board.guards
    if name not in board.present_guards:
        return "absent: arming is refused unless the configuration accepts that by name"
    if name == "hv_enable" and guards.hv_enable != "absent":
        enable = guards.hv_enable
        return f"present, {_at(enable.line)}: {enable.on} is on, pulled to {1 - enable.on}"
    if name == "rail_monitor" and guards.rail_monitor != "absent":
        rail = guards.rail_monitor
        return (
            f"present, ADS1115 at 0x{rail.address:02x}, input {rail.channel}, behind a divider of"
            f" {rail.divider:g}: {rail.low_v:g} to {rail.high_v:g} V, off below {rail.off_v:g} V"
        )
    if name == "readback" and guards.readback != "absent":
        return f"present, {_at(guards.readback)}: through a divider or a level shifter"
    if name == "heartbeat" and guards.heartbeat != "absent":
        beat = guards.heartbeat
        return f"present, {_at(beat.line)}: no edge for {beat.window_ms} ms takes the supply away"
    if name == "one_shot" and guards.one_shot != "absent":
        return f"present, on the board alone: ends a pulse after {guards.one_shot.on_us} us"
    cut = "a second contact breaks the supply" if guards.stop_cuts_supply else (
        "NO second contact breaks the supply: only the program sees it"
    )  # fmt: skip
    return f"present, {_at(getattr(guards, name))}: open, 0 or unplugged is a stop; {cut}"


def _at(gpio: int) -> str:
    return f"GPIO {gpio} on pin {PIN_OF_GPIO[gpio]}"


def _notes(board: BoardFile, wires: tuple[Wire, ...]) -> list[str]:
    found = [
        f"{wire.name}: at boot the Pi pulls GPIO {wire.gpio} to {1 - (wire.level or 0)}; until a"
        f" program runs only the board's own resistor makes the {wire.level} that is wanted."
        for wire in wires
        if wire.is_pulled_the_other_way
    ]
    found += [f"{sentence}." for sentence in unplaced(board)]
    if board.switch.chip in _FIVE_VOLTS:
        found.append(
            f"{board.switch.chip} runs at 5 V and does not read 3.3 V as 1: a level shifter stands"
            " between the Pi and the switches' lines. The Pi's inputs take 3.3 V at the most."
        )
    found.append(
        "Pulls are 10 k on the board's side of the cable, so that they also act where a wire comes"
        " off. docs/hardware.md says why each is needed."
    )
    return found
