"""A figure drawn as SVG: axes, curves, their names at their ends.

Owns: the look. Must not know: what a figure is about, files.

Small on purpose: one plot, linear or logarithmic, in a palette that the color-blind can tell apart
(Okabe and Ito). Names stand beside the curves' ends, so no legend is needed.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from html import escape
from math import ceil, floor, isfinite, log10

from etd.draw.palette import (
    BLUE,
    GREEN,
    GRID,
    INK,
    ORANGE,
    PAPER,
    PURPLE,
    SKY,
    SOFT,
    VERMILLION,
)
from etd.explain.figure import Axis, Curve, Figure

#: Without what a long name needs beside its curve's end.
WIDTH, HEIGHT = 720, 440
_LEFT, _RIGHT, _TOP, _BOTTOM = 76, 168, 58, 58
_ACROSS, _UP = WIDTH - _LEFT - _RIGHT, HEIGHT - _TOP - _BOTTOM
_COLORS = (BLUE, VERMILLION, GREEN, PURPLE, ORANGE, SKY)
_FORMULA = "#888888"
_FONT = "system-ui, -apple-system, 'Segoe UI', 'DejaVu Sans', Helvetica, sans-serif"
#: Of a name in the widest of the fonts, and between it and the curve's end.
_LETTER, _NAME_AT = 7.6, 10
#: Between two names.
_LINE_APART = 16.0
_STEPS = (1.0, 2.0, 2.5, 5.0, 10.0)


@dataclass(frozen=True, slots=True)
class _Scaled:
    """An axis with its ends, and where a value lies between them (0..1)."""

    axis: Axis
    low: float
    high: float

    def part(self, value: float) -> float:
        if self.axis.scale == "log":
            return (log10(value) - log10(self.low)) / (log10(self.high) - log10(self.low))
        return (value - self.low) / (self.high - self.low)

    def ticks(self) -> list[float]:
        if self.axis.scale == "log":
            return _log_ticks(self.low, self.high)
        return _linear_ticks(self.low, self.high)


def svg_of(figure: Figure) -> str:
    x = _scaled(figure.x, [value for curve in figure.curves for value in curve.x], room=False)
    y = _scaled(figure.y, [value for curve in figure.curves for value in curve.y], room=True)
    width = _paper_width(figure.curves)
    lines = [
        f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {width} {HEIGHT}" width="{width}"'
        f' height="{HEIGHT}" font-family="{_FONT}" font-size="12" role="img"'
        f' aria-label="{escape(figure.title)}">',
        f'<rect width="{width}" height="{HEIGHT}" fill="{PAPER}"/>',
        _text(_LEFT, 30, figure.title, size=16, color=INK, weight=600),
        *_grid(x, y),
        f'<clipPath id="inside"><rect x="{_LEFT}" y="{_TOP}" width="{_ACROSS}"'
        f' height="{_UP}"/></clipPath>',
        *_curves(figure.curves, x, y),
        "</svg>",
    ]
    return "\n".join(lines) + "\n"


def _paper_width(curves: tuple[Curve, ...]) -> int:
    longest = max((len(curve.name) for curve in curves), default=0)
    return max(WIDTH, WIDTH - _RIGHT + _NAME_AT + ceil(_LETTER * longest))


def _x(scaled: _Scaled, value: float) -> float:
    return _LEFT + scaled.part(value) * _ACROSS


def _y(scaled: _Scaled, value: float) -> float:
    return _TOP + (1.0 - scaled.part(value)) * _UP


# --- axes --------------------------------------------------------------------------------------


def _scaled(axis: Axis, values: list[float], room: bool) -> _Scaled:
    shown = [
        value for value in values if isfinite(value) and (axis.scale == "linear" or value > 0.0)
    ]
    low = min(shown) if axis.least is None else axis.least
    high = max(shown) if axis.most is None else axis.most
    if room and axis.scale == "linear":
        margin = 0.05 * (high - low)
        low = low - margin if axis.least is None and low < 0.0 else min(low, 0.0)
        high = high + margin if axis.most is None else high
    if room and axis.scale == "log":
        low = low / 1.15 if axis.least is None else low
        high = high * 1.15 if axis.most is None else high
    return _Scaled(axis, low, high)


def _linear_ticks(low: float, high: float) -> list[float]:
    rough = (high - low) / 6.0
    power = 10.0 ** floor(log10(rough))
    step = next(step * power for step in _STEPS if step * power >= rough * 0.999)
    return [number * step for number in range(ceil(low / step), floor(high / step) + 1)]


def _log_ticks(low: float, high: float) -> list[float]:
    for parts in ((1,), (1, 3), (1, 2, 5), (1, 1.5, 2, 3, 5, 7)):
        found = [
            part * 10.0**power
            for power in range(floor(log10(low)), ceil(log10(high)) + 1)
            for part in parts
            if low * 0.999 <= part * 10.0**power <= high * 1.001
        ]
        if len(found) >= 4:
            return found
    return found


def _grid(x: _Scaled, y: _Scaled) -> Iterator[str]:
    bottom, right = HEIGHT - _BOTTOM, WIDTH - _RIGHT
    for tick in y.ticks():
        at = _y(y, tick)
        yield _line(_LEFT, at, right, at, GRID)
        yield _text(_LEFT - 8, at + 4, _number(tick), anchor="end")
    for tick in x.ticks():
        at = _x(x, tick)
        yield _line(at, _TOP, at, bottom, GRID)
        yield _text(at, bottom + 18, _number(tick), anchor="middle")
    if y.axis.scale == "linear" and y.low < 0.0 < y.high:
        yield _line(_LEFT, _y(y, 0.0), right, _y(y, 0.0), SOFT)
    yield _line(_LEFT, bottom, right, bottom, SOFT)
    yield _line(_LEFT, _TOP, _LEFT, bottom, SOFT)
    yield _text(_LEFT + _ACROSS / 2, HEIGHT - 14, x.axis.label, anchor="middle", color=INK)
    middle = _TOP + _UP / 2
    label = _text(20, middle, y.axis.label, anchor="middle", color=INK)
    yield f'<g transform="rotate(-90 20 {middle:g})">{label}</g>'


# --- curves ------------------------------------------------------------------------------------


def _curves(curves: tuple[Curve, ...], x: _Scaled, y: _Scaled) -> Iterator[str]:
    ends: list[tuple[float, str, str]] = []
    colors = iter(_COLORS)
    for curve in curves:
        color = _FORMULA if curve.dashed else next(colors)
        points = [
            (_x(x, value), _y(y, other))
            for value, other in zip(curve.x, curve.y, strict=True)
            if isfinite(other) and (y.axis.scale == "linear" or other > 0.0)
        ]
        path = " ".join(f"{value:.1f},{other:.1f}" for value, other in points)
        dashes = ' stroke-dasharray="6 4"' if curve.dashed else ""
        yield (
            f'<polyline points="{path}" fill="none" stroke="{color}" stroke-width="2"'
            f' stroke-linejoin="round"{dashes} clip-path="url(#inside)"/>'
        )
        inside = [point for point in points if _TOP <= point[1] <= HEIGHT - _BOTTOM]
        ends.append((inside[-1][1] if inside else _TOP, curve.name, color))
    for at, name, color in _apart(ends):
        yield _text(WIDTH - _RIGHT + _NAME_AT, at + 4, name, color=color, weight=600)


def _apart(ends: list[tuple[float, str, str]]) -> list[tuple[float, str, str]]:
    """Names that would lie on one another are pushed down, and up again from the bottom."""
    placed: list[tuple[float, str, str]] = []
    lowest = _TOP - _LINE_APART
    for at, name, color in sorted(ends):
        lowest = max(at, lowest + _LINE_APART)
        placed.append((lowest, name, color))
    over = max(0.0, lowest - (HEIGHT - _BOTTOM))
    ceiling = lowest - over + _LINE_APART
    lifted: list[tuple[float, str, str]] = []
    for at, name, color in reversed(placed):
        ceiling = min(at, ceiling - _LINE_APART)
        lifted.append((ceiling, name, color))
    return lifted


# --- marks -------------------------------------------------------------------------------------


def _number(value: float) -> str:
    return f"{value:.4g}" if abs(value) < 1e4 else f"{value:,.0f}".replace(",", "\u2009")


def _line(x1: float, y1: float, x2: float, y2: float, color: str) -> str:
    return f'<line x1="{x1:.1f}" y1="{y1:.1f}" x2="{x2:.1f}" y2="{y2:.1f}" stroke="{color}"/>'


def _text(
    x: float,
    y: float,
    text: str,
    *,
    anchor: str = "start",
    color: str = SOFT,
    size: int = 12,
    weight: int = 400,
) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:.1f}" text-anchor="{anchor}" fill="{color}" font-size="{size}"'
        f' font-weight="{weight}">{escape(text, quote=False)}</text>'
    )
