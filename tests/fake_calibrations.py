"""The shipped calibrations of the fake, made from the body that the fake has.

Owns: what a person with that fingertip would have said when it was laid on; the files' names.
Must not know: how the body makes its thresholds.

    python tests/fake_calibrations.py        writes them anew

One who is asked for first feeling says the true threshold; comfortable is twice that, and stays
well below pain; the cap is never where it would hurt.
"""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

CLONE = Path(__file__).parents[1]
sys.path[:0] = [str(CLONE / "daemon"), str(CLONE / "hal")]

import datetime  # noqa: E402

from etd.files.array import Array, load_array  # noqa: E402
from etd.files.calibration import to_toml  # noqa: E402
from etd.protocol.calibration import Calibration, ElectrodeLimits  # noqa: E402
from etd_body.living import LivingBody  # noqa: E402
from etd_hal.boardfile import load_board  # noqa: E402
from etd_hal.fake.fingertip import living_fingertip  # noqa: E402

FOLDER = CLONE / "config" / "calibrations"
WIDTH_US, RATE_HZ = 100, 60.0
_STEP_UA = 10
_MOST_UA = 4_000
_BELOW_PAIN, _COMFORTABLE_BELOW_PAIN = 0.9, 0.75


def array_of(file: Path) -> Array:
    """The array that a shipped calibration of the fake is for; its name says so."""
    name = _words_of(file).removesuffix("cathodic").removesuffix("-") or "grid-8x8"
    return load_array(CLONE / "config" / "arrays" / f"{name}.toml")


def polarity_of(file: Path) -> Literal["anodic", "cathodic"]:
    """Its polarity, likewise."""
    return "cathodic" if _words_of(file).endswith("cathodic") else "anodic"


def _words_of(file: Path) -> str:
    return file.stem.removeprefix("fake-fingertip").removeprefix("-")


def calibration_of(array: Array, polarity: Literal["anodic", "cathodic"]) -> Calibration:
    """All boards that are shipped have the same leak, so one of them stands for all."""
    board = load_board(CLONE / "config" / "boards" / "kajimoto-hv507.toml")
    body = living_fingertip(board, list(zip(array.x_mm, array.y_mm, strict=True)))
    return Calibration(
        participant="fake",
        body_site="fingertip",
        array=array.name,
        polarity=polarity,
        width_us=WIDTH_US,
        rate_hz=RATE_HZ,
        returns="all",
        date=datetime.date(2025, 1, 15),
        program="etd 0.1.0",
        electrode=tuple(limits_of(body, electrode, polarity) for electrode in range(array.count)),
        modelled=True,
    )


def limits_of(
    body: LivingBody, electrode: int, polarity: Literal["anodic", "cathodic"]
) -> ElectrodeLimits:
    threshold_ua = body.commanded_threshold_ua(electrode, WIDTH_US, polarity)
    pain_ua = body.commanded_pain_threshold_ua(electrode, WIDTH_US, polarity)
    comfortable_ua = min(2.0 * threshold_ua, _COMFORTABLE_BELOW_PAIN * pain_ua, _MOST_UA)
    return ElectrodeLimits(
        threshold_ua=_down(threshold_ua) + _STEP_UA,
        comfortable_ua=_down(max(comfortable_ua, threshold_ua + 2 * _STEP_UA)),
        cap_ua=_down(min(_MOST_UA, _BELOW_PAIN * pain_ua)),
        resistance_ohm=round(body.resistance_ohm(electrode, threshold_ua), -2),
    )


def text_of(file: Path) -> str:
    """The file's content."""
    array = array_of(file)
    head = (
        f"# The calibration of the fake's own body on {array.name}: modelled, no person was"
        " measured.\n"
    )
    return head + to_toml(calibration_of(array, polarity_of(file)))


def _down(current_ua: float) -> int:
    return int(current_ua // _STEP_UA) * _STEP_UA


if __name__ == "__main__":
    for path in sorted(FOLDER.glob("fake-*.toml")):
        path.write_text(text_of(path), encoding="utf-8")
