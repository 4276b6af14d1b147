"""What was felt, drawn: how it drifts, and what a peeling does.

Owns: which curves are drawn of a run. Must not know: how they are drawn, how a run is made.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bench.steady_figures import firm_of
from bench.steady_run import Kept
from bench.steady_skin import PIECE_S
from etd.explain.figure import Axis, Curve, Figure, floats
from etd.explain.svgplot import svg_of

#: Those that are compared; the others differ in something else than steadiness.
_DRAWN = ("none", "contact", "energy", "power_law", "linear_law", "contact + power_law + probe")


def write(folder: Path, kept: dict[str, Kept]) -> None:
    """Two files, of one finger."""
    drawn = {name: kept[name] for name in _DRAWN if name in kept}
    if not drawn:
        return
    folder.mkdir(parents=True, exist_ok=True)
    for figure in (_drift(drawn), _peeling(drawn)):
        (folder / f"{figure.name}.svg").write_text(svg_of(figure), encoding="utf-8")


def _drift(kept: dict[str, Kept]) -> Figure:
    curves = tuple(Curve(name, *_by_minute(run)) for name, run in kept.items())
    return Figure(
        name="steady-drift",
        title="Felt strength over ten minutes, mean of firm contacts (modelled)",
        says="",
        x=Axis("minutes since the finger was laid on"),
        y=Axis("felt strength over the first minute's", least=0.0),
        curves=curves,
        checks=(),
    )


def _by_minute(kept: Kept) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Of the minutes of which anything was kept."""
    felt = np.where(firm_of(kept), kept.felt, np.nan)
    minute = kept.body_s // 60.0
    kinds = np.unique(minute)
    at = [float(kept.body_s[minute == kind].mean()) / 60.0 for kind in kinds]
    means = [float(np.nanmean(felt[minute == kind])) for kind in kinds]
    return floats(at), floats(mean / means[0] for mean in means)


def _peeling(kept: dict[str, Kept]) -> Figure:
    electrode = _peeled_most(next(iter(kept.values())))
    curves = tuple(
        Curve(name, floats(run.inside_s[_first(run)]), floats(run.felt[_first(run), electrode]))
        for name, run in kept.items()
    )
    return Figure(
        name="steady-peeling",
        title="One electrode peels and touches again (modelled)",
        says="",
        x=Axis("s"),
        y=Axis("felt strength; 1 is the threshold", least=0.0),
        curves=curves,
        checks=(),
    )


def _first(kept: Kept) -> np.ndarray:
    return np.asarray((kept.piece == kept.piece[0]) & (kept.inside_s < PIECE_S))


def _peeled_most(kept: Kept) -> int:
    """The electrode that was off for longest around the first peeling."""
    return int((kept.attached[_first(kept)] == 0.0).sum(axis=0).argmax())
