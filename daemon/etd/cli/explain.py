"""`etd explain FIGURE`: the paper's figures, computed with the fake's body model.

Owns: the printed answer and where the plot goes. Must not know: physics (etd.explain), drawing.
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path
from typing import TYPE_CHECKING

from etd.cli import options
from etd.cli.extras import check_installed
from etd.files.trust import open_own

if TYPE_CHECKING:
    from etd.explain.figure import Figure

HELP = "compute the figures of Kajimoto's paper from the fake's body model"
#: Repeated here, so that `--help` does not import numpy.
SHOWN = {
    "strength-duration": "shorter pulses need more current (equations 16 and 17)",
    "activating-function": "where a cathode excites a parallel fibre, and how deep (figure 3)",
    "concentric": "a wider ring of returns stimulates more strongly and deeper (figure 4)",
    "optimal-width": "the width of least energy (equations 18 to 21)",
    "thickness": "thick fibres before thin ones, hence touch before pain (section 2.2.1)",
}
NAMES = tuple(SHOWN)
_FIGURES = "\n".join(f"  {name:<21}{what}" for name, what in SHOWN.items())
EPILOG = f"""
figures (numbers are those of the paper):
{_FIGURES}

examples:
  etd explain strength-duration                    compares the model with the formula
  etd explain concentric --plot concentric.svg     draws the curves
  etd explain optimal-width --json                 prints the curves as numbers

No daemon and no board are needed. docs/body.md shows all plots, and what the model assumes.
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("figure", nargs="?", metavar="FIGURE", help="a name from the list below")
    parser.add_argument("--plot", type=Path, metavar="FILE.svg", help="draw it as SVG")
    options.add_json(parser, "curves and checks as one JSON object")


def run(args: argparse.Namespace) -> int:
    """Exit status 0. Raises: FileError, OSError when the plot cannot be written."""
    if args.figure not in NAMES:
        said = "no figure is named" if args.figure is None else f"unknown figure {args.figure!r}"
        args.misused(f"{said}; name one of {', '.join(NAMES)}")
    if args.plot is not None and args.plot.suffix.lower() != ".svg":
        args.misused(
            f"--plot {args.plot}: plots are SVG: name a file that ends in .svg"
            " (`rsvg-convert FILE.svg -o FILE.png` converts it)"
        )
    check_installed("numpy")
    from etd.explain import FIGURES
    from etd.explain.svgplot import svg_of

    figure = FIGURES[args.figure]()
    if args.plot is not None:
        _write_plot(args.plot, svg_of(figure))
    if args.json:
        print(json.dumps({"ok": True, **figure.as_dict()}))
    else:
        print("\n".join(_lines(figure)))
    return 0


def _write_plot(path: Path, svg: str) -> None:
    """Over an old one, and past no link. Raises: FileError, OSError."""
    number = open_own(path, os.O_WRONLY | os.O_CREAT, 0o644)
    with os.fdopen(number, "w", encoding="utf-8") as file:
        file.truncate()
        file.write(svg)


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
