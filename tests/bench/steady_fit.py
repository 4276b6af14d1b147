"""What the impedance laws need of a person, found on fingers that the benchmark leaves out.

Owns: which fingers laws are tuned on, and the two fits. Must not know: engines, wires, what comes
out of the benchmark.

    python tests/bench/steady_fit.py        prints them

For instants of each finger's time, the pulse is sought that stands as far above the threshold of
that instant as the comfortable one did when it was calibrated: its width at the same current (for
`fitted`, log width over log resistance), and its charge and energy in the skin (for `lines`, over
R / R0). A person's would come from a few skin states in the same way. What would need a narrower
pulse than those looked at is left out, and what would need a wider one counts as the widest, above
which nobody gets any: how many these are is printed.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from pathlib import Path

_CLONE = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(_CLONE / one) for one in ("tests", "daemon", "hal")]

import numpy as np  # noqa: E402

from bench.steady_skin import CALIBRATED_S, WIDTH_US, attachment_of, body_of, seen_ohm  # noqa: E402
from etd.files.configuration import fake_config  # noqa: E402
from etd_body.tissue import Floats  # noqa: E402

TUNING_SEEDS = (1, 2, 3, 4, 5, 6, 7, 8)
_AT_S = (3.0, 21.0, 47.0, 90.0, 170.0, 290.0, 430.0, 590.0)
_WIDTHS_US = np.array([35.0, 50.0, 70.0, 100.0, 140.0, 200.0])
#: Whoever needs another width than those is found at an end of them, but for rounding.
_AT_THE_END = 1e-9
_EVERY = 5
_OVER = 2.0


@dataclass(frozen=True)
class Fit:
    """`k` of `fitted`, with how much of the variance it explains; and the slopes of `lines`."""

    k: float
    charge_slope: float
    energy_slope: float
    r_squared: float
    samples: int
    #: Less than 35 us was needed: they are not among the samples.
    left_out: int
    #: 200 us or more was needed: samples of 200 us.
    at_widest: int


def fit(seeds: tuple[int, ...] = TUNING_SEEDS) -> Fit:
    """Of all these fingers together."""
    return fit_of(*(np.concatenate(one) for one in zip(*map(_finger, seeds), strict=True)))


def fit_of(ratio: Floats, width_us: Floats, charge: Floats, energy: Floats) -> Fit:
    """By least squares through the reference: at R0 nothing changes. Arrays of one length:
    R / R0, the width that was needed, and charge and energy over those of the reference.
    """
    is_in = width_us > _WIDTHS_US[0] * (1.0 + _AT_THE_END)
    is_widest = width_us > _WIDTHS_US[-1] * (1.0 - _AT_THE_END)
    log_r, log_w = np.log(ratio[is_in]), np.log(width_us[is_in] / WIDTH_US)
    slope = float((log_r * log_w).sum() / (log_r * log_r).sum())
    left = log_w - slope * log_r
    rise = np.expm1(log_r)
    return Fit(
        k=-slope,
        charge_slope=_slope(rise, charge[is_in]),
        energy_slope=_slope(rise, energy[is_in]),
        r_squared=float(1.0 - left.var() / log_w.var()),
        samples=len(log_r),
        left_out=int((~is_in).sum()),
        at_widest=int(is_widest.sum()),
    )


def _slope(rise: Floats, part: Floats) -> float:
    return float((rise * (part - 1.0)).sum() / (rise * rise).sum())


def _finger(seed: int) -> tuple[Floats, ...]:
    loaded = fake_config(electrodes=64)
    asked = body_of(seed, loaded.board, loaded.array)
    asked.look_at(0)
    asked.look_at(int(CALIBRATED_S * 1e9))
    lies_on = attachment_of(seed, loaded.array).at(CALIBRATED_S).area >= 1.0
    electrodes = [electrode for electrode in range(0, 64, _EVERY) if lies_on[electrode]]
    commanded_ua = {
        electrode: _OVER * asked.commanded_threshold_ua(electrode, WIDTH_US)
        for electrode in electrodes
    }
    first_ohm = {
        electrode: seen_ohm(asked, electrode, commanded_ua[electrode]) for electrode in electrodes
    }
    skin_ua = {
        electrode: asked.sensation.true_threshold_ua(electrode, WIDTH_US)
        for electrode in electrodes
    }
    body = body_of(seed, loaded.board, loaded.array)
    rows: list[tuple[float, float, float, float]] = []
    body.look_at(0)
    for at_s in _AT_S:
        body.look_at(int(at_s * 1e9))
        for other in electrodes:
            if not body.skin.is_touching[other]:
                continue
            needed_ua = np.array(
                [_OVER * body.commanded_threshold_ua(other, w) for w in _WIDTHS_US]
            )
            width_us = float(
                np.exp(
                    np.interp(-np.log(commanded_ua[other]), -np.log(needed_ua), np.log(_WIDTHS_US))
                )
            )
            ratio = seen_ohm(body, other, commanded_ua[other]) / first_ohm[other]
            true_ua = body.sensation.true_threshold_ua(other, width_us)
            charge = true_ua * width_us / (skin_ua[other] * WIDTH_US)
            energy = (true_ua / skin_ua[other]) ** 2 * ratio * width_us / WIDTH_US
            rows.append((ratio, width_us, charge, energy))
    return tuple(np.array(rows).T)


if __name__ == "__main__":
    print(fit())
