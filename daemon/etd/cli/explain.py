"""`etd explain FIGURE`: the paper's figures, from the model that the fake's body feels with.

Owns: the printed answer and where the plot goes. Must not know: physics (etd.explain), drawing.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

from etd.cli import options

if TYPE_CHECKING:
    from etd.explain.figure import Figure

NAME = "explain"
HELP = "show how stimulation works: the paper's figures, from the model behind the fake"
#: Named here as well: numpy is imported when a figure is made, not for `--help`.
SHOWN = {
    "strength-duration": "the shorter a pulse, the higher it must be (equations 16 and 17)",
    "activating-function": "where a cathode excites a parallel fibre, and how deep (figure 3)",
    "concentric": "a wider ring of returns stimulates more, and deeper (figure 4)",
    "optimal-width": "the width of least energy (equations 18 to 21)",
    "thickness": "thick fibres before thin ones, hence touch before pain (section 2.2.1)",
}
NAMES = tuple(SHOWN)
_FIGURES = "\n".join(f"  {name:<21}{what}" for name, what in SHOWN.items())
EPILOG = f"""
figures, by what Kajimoto's paper says of them:
{_FIGURES}

examples:
  etd explain strength-duration                    numbers of the model, beside the formula's
  etd explain concentric --plot concentric.svg     its curves, drawn
  etd explain optimal-width --json                 its curves, as numbers

It needs no daemon and no board. docs/body.md shows all plots, and says what is assumed.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("figure", nargs="?", metavar="FIGURE", help="one of those below")
    parser.add_argument(
        "--plot", type=Path, metavar="FILE.svg", help="draw it into this file, as SVG"
    )
    options.add_json(parser, "curves and checks as one JSON object")


def run(args: argparse.Namespace) -> int:
    """Exit status 0. Raises: OSError when the plot cannot be written."""
    if args.figure not in NAMES:
        said = "no figure is named" if args.figure is None else f"there is no {args.figure!r}"
        args.misused(f"{said}; name one of {', '.join(NAMES)}")
    if args.plot is not None and args.plot.suffix.lower() != ".svg":
        args.misused(
            f"--plot {args.plot}: plots are SVG: name a file that ends in .svg (browsers and office"
            " programs open it; `rsvg-convert FILE.svg -o FILE.png` or Inkscape makes a PNG of it)"
        )
    from etd.explain.figures import FIGURES
    from etd.explain.svgplot import svg_of

    figure = FIGURES[args.figure]()
    if args.plot is not None:
        args.plot.write_text(svg_of(figure), encoding="utf-8")
    if args.json:
        print(json.dumps({"ok": True, **figure.as_dict()}))
    else:
        print("\n".join(_lines(figure)))
    return 0


def _lines(figure: Figure) -> list[str]:
    wide = max(len(check.what) for check in figure.checks)
    head = f"{'':{wide}}  {'modelled':>10}  {'formula':>10}  {'off by':>8}  formula"
    return [
        f"{figure.name}: {figure.title}",
        figure.says,
        "",
        head,
        *(
            f"{check.what:{wide}}  {check.modelled:>10.4g}  {check.closed_form:>10.4g}"
            f"  {check.error_percent:>6.2f} %  {check.source}"
            for check in figure.checks
        ),
    ]
