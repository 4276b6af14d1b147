"""The colors that all pictures share, and the one scale from little to much.

Owns: which color means what, and what can be read on top of it. Must not know: what is drawn.

The scale falls in lightness from its lowest to its highest value, so that its order survives a
printer without color. The other colors can be told apart by the color-blind (Okabe and Ito).
"""

from __future__ import annotations

INK, SOFT, GRID, PAPER = "#222222", "#555555", "#E4E4E4", "#FFFFFF"
#: Of what is not used.
FAINT = "#9A9A9A"
BLUE, VERMILLION, GREEN, PURPLE = "#0072B2", "#D55E00", "#009E73", "#CC79A7"
ORANGE, SKY = "#E69F00", "#56B4E9"
#: Of pictures with letters on it.
BROWN = "#7A5200"
#: What must not be overlooked, and outputs: dark enough for small letters.
WARNING = "#A34400"

_STOPS = ((247, 250, 253), (171, 205, 233), (70, 138, 196), (9, 50, 108))


def shade(fraction: float) -> str:
    """The color of 0 (light) to 1 (dark); beyond the ends it is that of the end."""
    at = min(max(fraction, 0.0), 1.0) * (len(_STOPS) - 1)
    below = min(int(at), len(_STOPS) - 2)
    pairs = zip(_STOPS[below], _STOPS[below + 1], strict=True)
    return "#" + "".join(f"{round(low + (high - low) * (at - below)):02X}" for low, high in pairs)


def lightness(color: str) -> float:
    """What a printer without color makes of "#RRGGBB": 0 black, 1 white (weights of BT.601)."""
    red, green, blue = (int(color[at : at + 2], 16) / 255 for at in (1, 3, 5))
    return 0.299 * red + 0.587 * green + 0.114 * blue


def ink_on(color: str) -> str:
    """What letters on this color are written in."""
    return INK if lightness(color) > 0.55 else PAPER
