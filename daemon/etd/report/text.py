"""The report as it is read: lines, a page, and a paragraph for a methods section.

Owns: words and rounding. Must not know: how a figure is calculated.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from typing import TypeAlias

from etd.report.figures import Figures

#: (heading, rows of what and how much).
Section: TypeAlias = tuple[str, list[tuple[str, str]]]

#: What a reader asks for and a configuration does not know.
UNKNOWN = (
    "person: age, sex, exclusion criteria",
    "skin: preparation, gel, temperature, humidity",
    "procedure: instructions, order, duration, pauses",
    "adverse events",
)


def sections(found: Figures) -> list[Section]:
    guards = [(name, "present") for name in found.present_guards]
    guards += [(name, "ABSENT") for name in found.absent_guards]
    return [
        (
            "Device",
            [
                ("etd", found.version),
                ("configuration", found.source),
                ("board, machine", f"{found.board} on {found.machine} (backend: {found.backend})"),
                ("self-test", found.selftest),
                *(
                    (f"SHA-256, {name.replace('_', ' ')}", digest)
                    for name, digest in found.digests.items()
                ),
            ],
        ),
        (
            "Electrodes",
            [
                ("array", f"{found.array}, {found.electrodes} electrodes at the {found.body_site}"),
                ("diameter, pitch", f"{found.diameter_mm:g} mm, {found.pitch_mm:g} mm"),
                ("area of one", f"{found.area_cm2:.5f} cm2"),
            ],
        ),
        (
            "Most that is accepted, for one electrode",
            [
                ("current", f"{_ma(found.current_ua)}, {_density(found.current_density_ma_cm2)}"),
                ("without a calibration", _ma(found.uncalibrated_current_ua)),
                ("width of a pulse", f"{found.width_us} us"),
                (
                    "charge of a pulse",
                    f"{found.charge_nc:g} nC, {found.charge_density_uc_cm2:.1f} uC/cm2",
                ),
                ("rate", f"{found.rate_hz} Hz"),
                (
                    "mean current",
                    f"{found.mean_current_ua} uA, {_density(found.mean_current_density_ma_cm2)}",
                ),
                ("mean current, all electrodes", f"{found.array_mean_current_ua} uA"),
                ("compliance", f"{found.compliance_v} V"),
            ],
        ),
        (
            "The strongest pulse into a resistor",
            [
                (
                    f"{at.resistance_ohm} ohm",
                    f"{_ma(at.current_ua)}, {at.voltage_v:g} V, {at.width_us:.1f} us,"
                    f" {at.energy_uj:.2f} uJ; at most {at.power_mw:.2f} mW,"
                    f" {at.power_density_mw_cm2:.1f} mW/cm2",
                )
                for at in found.at_loads
            ],
        ),
        ("Guards of the board", guards),
        (
            "If the source stays on at full scale, and every guard above has failed",
            [
                (
                    f"{row.what}{_here(row.present)}",
                    f"{_time(row.acts_within_s)}: {_uc(row.charge_uc)}",
                )
                for row in found.worst_cases
            ],
        ),
        ("Not known to etd", [(what, "") for what in UNKNOWN]),
    ]


def lines(found: Figures, more: Sequence[Section] = ()) -> Iterator[str]:
    """`more`: sections after those of the configuration."""
    for heading, rows in (*sections(found), *more):
        yield ""
        yield heading
        wide = max(len(what) for what, _ in rows) if rows else 0
        for what, how_much in rows:
            yield f"  {what:{wide}}  {how_much}".rstrip()


def html(found: Figures, more: Sequence[Section] = ()) -> str:
    """One page that prints well, without anything from elsewhere."""
    body = "".join(
        f"<h2>{escape(heading)}</h2><table>"
        + "".join(f"<tr><th>{escape(a)}</th><td>{escape(b)}</td></tr>" for a, b in rows)
        + "</table>"
        for heading, rows in (*sections(found), *more)
    )
    return (
        '<!doctype html><html lang="en"><meta charset="utf-8"><title>etd: what it can do to a'
        " person</title><style>body{font:11pt/1.4 sans-serif;max-width:50em;margin:2em auto}"
        "th{text-align:left;font-weight:normal;padding-right:2em;vertical-align:top}"
        "td{overflow-wrap:anywhere}h2{font-size:12pt;margin-bottom:.2em}</style>"
        f"<h1>Electro-tactile display: maxima, guards and worst cases</h1>{body}</html>\n"
    )


def methods(found: Figures) -> str:
    """A paragraph to paste and to complete."""
    middle = found.at_loads[1]
    return (
        f"Electrical stimuli were delivered by etd {found.version} (board {found.board}) through"
        f" {found.electrodes} electrodes of {found.diameter_mm:g} mm diameter"
        f" ({found.area_cm2:.4f} cm2), {found.pitch_mm:g} mm apart, at the {found.body_site}."
        " Pulses were rectangular and current-controlled, with a compliance of"
        f" {found.compliance_v} V. The system accepted at most {_ma(found.current_ua)}"
        f" ({_ma(found.uncalibrated_current_ua)} without an individual calibration),"
        f" {found.width_us} us and {found.charge_nc:g} nC a pulse"
        f" ({found.charge_density_uc_cm2:.1f} uC/cm2), {found.rate_hz} Hz, and a mean of"
        f" {found.mean_current_ua} uA for each electrode; the strongest pulse has"
        f" {middle.energy_uj:.1f} uJ at {middle.resistance_ohm // 1_000} kohm. Individual caps were"
        " those that the participant accepted in the calibration ([method, date]). Guards of the"
        f" hardware: {', '.join(found.present_guards) or 'none'}; absent:"
        f" {', '.join(found.absent_guards) or 'none'}. [Participants; polarity, width and rate"
        " used; skin preparation; instructions; adverse events.]"
    )


def _ma(current_ua: int) -> str:
    return f"{current_ua / 1_000:g} mA"


def _density(density_ma_cm2: float) -> str:
    return f"{density_ma_cm2:.3g} mA/cm2"


def _time(acts_s: float | None) -> str:
    if acts_s is None:
        return "never"
    if acts_s < 1e-3:
        return f"{acts_s * 1e6:g} us"
    return f"{acts_s * 1e3:g} ms" if acts_s < 1 else f"{acts_s:g} s"


def _uc(charge_uc: float) -> str:
    return f"{charge_uc:g} uC" if charge_uc < 1_000 else f"{charge_uc / 1_000:g} mC"


def _here(present: bool | None) -> str:
    if present is None:
        return ""
    return " (this board has it)" if present else " (NOT on this board)"
