"""`etd explain FIGURE`: the paper's figures, from the model that the fake's body feels with.

Owns: the printed answer and where the plot goes. Must not know: physics (etd.explain), drawing.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from etd.explain.figure import Figure

NAME = "explain"
HELP = "show how stimulation works: the paper's figures, from the model behind the fake"
EPILOG = """
examples:
  etd explain strength-duration
  etd explain concentric --plot concentric.svg
  etd explain optimal-width --json
"""
#: Named here as well: numpy is imported when a figure is made, not for `--help`.
NAMES = ("strength-duration", "activating-function", "concentric", "optimal-width", "thickness")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("figure", choices=NAMES, metavar="FIGURE", help=", ".join(NAMES))
    parser.add_argument(
        "--plot", type=Path, metavar="FILE.svg", help="draw it into this file, as SVG"
    )
    parser.add_argument("--json", action="store_true", help="curves and checks as one JSON object")


def run(args: argparse.Namespace) -> int:
    """Exit status 0. Raises: OSError when the plot cannot be written."""
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
        print(json.dumps({"ok": True, **figure.told()}))
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
