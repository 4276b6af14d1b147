"""`make bench`: what the engine takes, beside the physical limit and what people use today.

Owns: which figures are made, the bounds that are asserted, and how both are shown. Counts and
modelled times are asserted (exit status 1 when a bound is passed); measured times are printed
with the machine they were measured on.
Must not know: how a figure is made.
"""

from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

# Run as a script, from a clone: the benchmark and the test rigs stand beside one another.
_TESTS = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(_TESTS)]

from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

from bench import (  # noqa: E402
    beside,
    body,
    clock_steps,
    front,
    latency,
    latency_modelled,
    machines,
    modelled,
    over_ssh,
    processor,
    stages,
    usual_script,
)
from bench.modelled import ELECTRODES, WIDTH_US, ScanFigures  # noqa: E402
from etd_hal.fake.processor import COMPILED_STAGES_NS, STAGES_NS, Stage  # noqa: E402

#: {rest in us: the most that a scan may take, over the sum of widths and rests}
MOST_OVER_LIMIT = {200: 1.10, 50: 1.20}
#: A stabilizer changes a current now and then, and its new message is laid out in memory, which a
#: rest of 50 us does not hide.
MOST_STABILIZED = {200: 1.10, 50: 1.22}
MOST_CALLS_PER_PULSE = 6.0
LEAST_OVER_SCRIPT = 4.0
#: A second of scanning 64 electrodes, of the body behind the fake, in processor time.
MOST_BODY_S = 1.0
#: What comes of a rate that was planned on a modelled machine. The contact polls of silent
#: electrodes, as many as 128 of them, are no part of a plan.
LEAST_KEPT = 0.88
#: The same where the brake pauses scans: each pause puts the next one off, and a scan of more than
#: 80 ms is paused always.
LEAST_KEPT_BRAKED = 0.80
#: {rest in us: the most that 64 electrodes may take on the modelled Pi 4, computing and the brake
#: included, over the sum of widths and rests}. Compiled, on a core that the kernel leaves alone.
MOST_WITH_COMPUTING = {200: 1.15, 50: 1.5}
#: Beside clocks that change, of the pulses beside clocks that are fixed.
LEAST_FIRED_PERCENT = 90.0
#: gpiod's own calls, assumed for a Pi 4: one line, and several lines.
GPIOD_CALLS_US = (10.0, 15.0)
#: The ESP32 kits: two words a pulse at 6.6 us each, as their sources have it; the rest as asked.
ESP32_WORD_US = 6.6


@dataclass(frozen=True)
class Bound:
    """One assertion."""

    what: str
    value: float
    bound: float
    is_met: bool


def at_most(what: str, value: float, bound: float) -> Bound:
    return Bound(what, round(value, 4), bound, value <= bound)


def at_least(what: str, value: float, bound: float) -> Bound:
    return Bound(what, round(value, 4), bound, value >= bound)


@dataclass(frozen=True)
class Comparison:
    """One rest: the engine's scan, and the others' at the same width and rest."""

    scan: ScanFigures
    #: The same with a stabilizer of each kind.
    stabilized: ScanFigures
    #: And with a probe before every pulse.
    ahead: ScanFigures
    script_us: float
    script_calls_per_pulse: float
    gpiod_us: tuple[float, ...]
    esp32_us: float

    def bounds(self) -> list[Bound]:
        rest = f"rest {self.scan.rest_us} us"
        calls = self.scan.calls_per_pulse
        return [
            at_most(f"{rest}: bus calls per pulse", calls, MOST_CALLS_PER_PULSE),
            at_most(
                f"{rest}: scan over limit, rewrite of the chain included",
                self.scan.ratio_with_rewrite,
                MOST_OVER_LIMIT[self.scan.rest_us],
            ),
            at_most(
                f"{rest}: the same with stabilizers",
                self.stabilized.ratio_with_rewrite,
                MOST_STABILIZED[self.scan.rest_us],
            ),
            at_most(
                f"{rest}: the same with probes first, over the limit of such a scan",
                self.ahead.ratio_with_rewrite,
                MOST_OVER_LIMIT[self.scan.rest_us],
            ),
            at_most(
                f"{rest}: bus calls per pulse with stabilizers",
                self.stabilized.calls_per_pulse,
                MOST_CALLS_PER_PULSE,
            ),
            at_most(
                f"{rest}: bus calls per pulse with its probe",
                self.ahead.calls_per_pulse,
                MOST_CALLS_PER_PULSE,
            ),
            at_least(
                f"{rest}: usual script over scan",
                self.script_us / (self.scan.scan_us + self.scan.rewrite_us),
                LEAST_OVER_SCRIPT,
            ),
        ]


def compare(rest_us: int) -> Comparison:
    """All of the modelled figures for one rest."""
    script = usual_script.UsualScript(rest_us).scan()
    gpiod = [usual_script.UsualScript(rest_us, call_us).scan() for call_us in GPIOD_CALLS_US]
    return Comparison(
        modelled.engine_scan(rest_us),
        modelled.engine_scan(rest_us, modelled.STABILIZED),
        modelled.engine_scan(rest_us, modelled.AHEAD),
        script.scan_us,
        script.calls_per_pulse,
        tuple(script_figures.scan_us for script_figures in gpiod),
        ELECTRODES * (2 * ESP32_WORD_US + WIDTH_US + rest_us),
    )


# --- for people --------------------------------------------------------------------------------


def show(console: Console, figures: dict[str, Any], bounds: list[Bound]) -> None:
    for comparison in figures["scans"]:
        console.print(_scan_table(comparison, figures["stabilized"]))
    console.print(_machines_table(figures["machines"]))
    console.print(_stages_table(figures["stages"]))
    console.print(_processor_table(figures["processor"], figures["stabilized"], figures["ahead"]))
    console.print(_latency_table(figures["latency"]))
    console.print(latency_modelled.front_table(figures["front"]))
    console.print(latency_modelled.table(figures["modelled latency"]))
    console.print(over_ssh.table(figures["over ssh"]))
    for table in beside.tables(figures["beside"]):
        console.print(table)
    console.print(_body_table(figures["body"]))
    console.print(clock_steps.table(figures["clocks"]))
    for bound in bounds:
        verdict = "[green]met[/]" if bound.is_met else "[red]MISSED[/]"
        console.print(f"{verdict}  {bound.what}: {bound.value:g} (bound {bound.bound:g})")


def _scan_table(found: Comparison, measured: processor.ProcessorFigures) -> Table:
    scan = found.scan
    table = Table(
        title=f"{ELECTRODES} electrodes, {WIDTH_US} us, rest {scan.rest_us} us: modelled Pi 4"
    )
    for column in ("", "scan", "over limit", "over etd", "calls a pulse"):
        table.add_column(column, justify="right" if column else "left")
    whole_us = scan.scan_us + scan.rewrite_us

    def row(who: str, took_us: float, calls: str = "", limit_us: float = scan.limit_us) -> None:
        limits, whole = took_us / limit_us, took_us / whole_us
        table.add_row(who, f"{took_us / 1_000:.2f} ms", f"{limits:.3f}", f"{whole:.2f}", calls)

    row("widths and rests alone: the limit", scan.limit_us)
    row("etd, rewrite of the chain apart", scan.scan_us, f"{scan.calls_per_pulse:.2f}")
    row("etd, with the rewrite", whole_us, f"+ {scan.rewrite_calls} a scan")
    stabilized = found.stabilized
    row(
        "etd with stabilizers, and the rewrite",
        stabilized.scan_us + stabilized.rewrite_us,
        f"{stabilized.calls_per_pulse:.2f}",
    )
    late_us = measured.late_us_on_a_pi4(scan.rest_us)
    row(
        "the same, and what a Pi 4 computes beyond its rests (5)",
        stabilized.scan_us + stabilized.rewrite_us + ELECTRODES * late_us,
    )
    ahead = found.ahead
    row("widths, probes and rests: the limit with probes first (4)", ahead.limit_us)
    row(
        "etd with stabilizers and probes first, over that limit",
        ahead.scan_us + ahead.rewrite_us,
        f"{ahead.calls_per_pulse:.2f}",
        ahead.limit_us,
    )
    row("usual script, raw calls (1)", found.script_us, f"{found.script_calls_per_pulse:.0f}")
    for call_us, took_us in zip(GPIOD_CALLS_US, found.gpiod_us, strict=True):
        row(f"usual script, gpiod, {call_us:g} us (2)", took_us)
    row("ESP32 kits (3)", found.esp32_us)
    table.caption = (
        f"(1) time.sleep assumed to take {usual_script.OVERSLEEP_US} us more than asked"
        " (2) cost of a call assumed"
        f" (3) computed: 2 words of {ESP32_WORD_US} us, as stated by the kits, and nothing else"
        f" (4) {modelled.MESSAGE_US:g} us of the kernel's for each probe's message included"
        f" (5) the median measured below, times {processor.PI4_FACTOR:g}: held to nothing"
    )
    return table


def _machines_table(found: list[machines.MachineScan]) -> Table:
    table = Table(
        title=f"modelled machines, computing included: {WIDTH_US} us, as fast as the plan lets it",
        caption="period: from scan to scan, with the pauses that the kernel demands: 80 % busy"
        " where it is not known, 98 % where throttle and fair server of the scan's core are off",
    )
    for column in (
        "machine",
        "electrodes",
        "rest",
        "code",
        "kernel",
        "computing",
        "plan",
        "period",
    ):
        table.add_column(column, justify="right")
    for column in ("over limit", "kept"):
        table.add_column(column, justify="right")
    table.add_column("bound by")
    for scan in found:
        table.add_row(
            scan.machine,
            str(scan.electrodes),
            f"{scan.rest_us} us",
            scan.code,
            scan.kernel,
            f"{scan.computing_us:.0f} us",
            f"{scan.planned_hz:.1f} Hz",
            f"{scan.period_ms:.2f} ms",
            f"{scan.ratio:.3f}{_verdict(scan)}",
            f"{scan.kept:.2f}",
            scan.bound_by or "",
        )
    return table


def _verdict(scan: machines.MachineScan) -> str:
    """Of every configuration of which there is a bound, also where it is not asserted."""
    most = MOST_WITH_COMPUTING[scan.rest_us]
    if (scan.machine, scan.electrodes) != ("pi4", ELECTRODES):
        return ""
    return f" (at most {most:g})" if scan.ratio <= most else f" (MORE than {most:g})"


def machine_bounds(scan: machines.MachineScan) -> Iterator[Bound]:
    least = LEAST_KEPT if scan.kernel == "both off" else LEAST_KEPT_BRAKED
    yield at_least(f"{scan}: rate over plan", scan.kept, least)
    if scan.is_the_fastest_pi4 and scan.electrodes == ELECTRODES:
        yield at_most(f"{scan}: over limit", scan.ratio, MOST_WITH_COMPUTING[scan.rest_us])


def _stages_table(found: dict[Stage, float]) -> Table:
    table = Table(
        title="computing by stage, measured here (plain pulses; medians)",
        caption="charged: what the fake's model takes for it, before a machine's slowness",
    )
    for column in ("", "here", "charged", "compiled"):
        table.add_column(column, justify="left" if not column else "right")
    for stage, charged_ns in STAGES_NS.items():
        taken_us = found.get(stage, 0.0), charged_ns / 1e3, COMPILED_STAGES_NS[stage] / 1e3
        table.add_row(stage, *(f"{us:.1f} us" for us in taken_us))
    return table


def _processor_table(
    found: processor.ProcessorFigures,
    stabilized: processor.ProcessorFigures,
    ahead: processor.ProcessorFigures,
) -> Table:
    table = Table(
        title="the engine's processor time for a pulse, measured here",
        caption=f"here: {found.machine}; the factor is assumed",
    )
    for column in ("", "median", "p99"):
        table.add_column(column, justify="left" if not column else "right")
    factor = processor.PI4_FACTOR
    kinds = (("", found), (", with stabilizers", stabilized), (", and a probe first", ahead))
    for what, processor_figures in kinds:
        table.add_row(
            f"here{what}",
            f"{processor_figures.median_us:.1f} us",
            f"{processor_figures.p99_us:.1f} us",
        )
        table.add_row(
            f"on a Pi 4, {factor:g} times slower{what}",
            f"{processor_figures.median_us * factor:.0f} us",
            f"{processor_figures.p99_us * factor:.0f} us",
        )
    return table


def _latency_table(found: list[latency.LatencyFigures]) -> Table:
    table = Table(title="frame sent to first pulse: gateway and engine in processes, measured here")
    for column in ("", "sent", "shown", "p50", "p99", "p99.9"):
        table.add_column(column, justify="left" if not column else "right")
    for latency_figures in found:
        times = (
            f"{us / 1_000:.2f} ms"
            for us in (latency_figures.p50_us, latency_figures.p99_us, latency_figures.p999_us)
        )
        load = (
            f"{latency_figures.load} ({latency_figures.cut_short} cut short: {latency_figures.why})"
            if latency_figures.cut_short
            else latency_figures.load
        )
        table.add_row(load, str(latency_figures.sent), str(latency_figures.shown), *times)
    return table


def _body_table(found: list[body.BodyFigures]) -> Table:
    table = Table(
        title=f"the modelled body: {body.SCANS} scans of all electrodes, processor time here",
    )
    for column in ("electrodes", "to set up", "for the scans", "a pulse"):
        table.add_column(column, justify="right")
    for body_figures in found:
        table.add_row(
            str(body_figures.electrodes),
            f"{body_figures.setup_s:.2f} s",
            f"{body_figures.busy_s:.2f} s",
            f"{body_figures.pulse_us:.0f} us",
        )
    return table


def main() -> int:
    parser = argparse.ArgumentParser(prog="bench", description=(__doc__ or "").split("\n")[0])
    parser.add_argument("--json", action="store_true", help="one JSON object for all figures")
    parser.add_argument("--quick", action="store_true", help="fewer samples of what is measured")
    args = parser.parse_args()
    comparisons = [compare(rest_us) for rest_us in MOST_OVER_LIMIT]
    figures: dict[str, Any] = {
        "scans": comparisons,
        "machines": list(machines.measure_all(2 if args.quick else None)),
        "stages": stages.measure(10 if args.quick else 40),
        "processor": processor.measure(10 if args.quick else 100),
        "stabilized": processor.measure(10 if args.quick else 100, modelled.STABILIZED),
        "ahead": processor.measure(10 if args.quick else 100, modelled.AHEAD),
        "latency": list(latency.measure(args.quick)),
        "front": [
            front.measure(electrodes, 100 if args.quick else 400)
            for electrodes in latency_modelled.ELECTRODES_IN_USE
        ],
        "modelled latency": latency_modelled.measure_all(20 if args.quick else 100),
        "clocks": clock_steps.measure_all(),
        "over ssh": over_ssh.measure(args.quick),
        "beside": beside.measure(args.quick),
        "body": [body.measure(side) for side in ((8,) if args.quick else (8, 16))],
    }
    bounds = [bound for comparison in comparisons for bound in comparison.bounds()]
    for scan in figures["machines"]:
        bounds += machine_bounds(scan)
    for found in figures["modelled latency"]:
        what = f"latency, {found.configuration}, {found.electrodes} electrodes, {found.load}"
        if found.most_p50_ms is not None:
            bounds.append(at_most(f"{what}: p50 in ms", found.whole_ms(0.5), found.most_p50_ms))
        bounds.append(at_most(f"{what}: p99 in ms", found.whole_ms(0.99), found.most_p99_ms))
    busy_s = figures["body"][0].busy_s
    bounds.append(at_most("a second of the body with 64 electrodes, s", busy_s, MOST_BODY_S))
    bounds += [
        at_least(
            f"clocks {steps.factor:g} times slower every {steps.every_ms} ms: pulses fired, %",
            steps.fired_percent,
            LEAST_FIRED_PERCENT,
        )
        for steps in figures["clocks"]
    ]
    if args.json:
        plain = {
            "scans": [asdict(comparison) for comparison in comparisons],
            "machines": [asdict(scan) for scan in figures["machines"]],
            "stages": figures["stages"],
            "processor": asdict(figures["processor"]),
            "stabilized": asdict(figures["stabilized"]),
            "ahead": asdict(figures["ahead"]),
            "latency": [asdict(figure) for figure in figures["latency"]],
            "front": [asdict(figure) for figure in figures["front"]],
            "modelled latency": [asdict(figure) for figure in figures["modelled latency"]],
            "clocks": [asdict(figure) for figure in figures["clocks"]],
            "over ssh": asdict(figures["over ssh"]),
            "beside": asdict(figures["beside"]),
            "body": [asdict(figure) for figure in figures["body"]],
            "bounds": [asdict(bound) for bound in bounds],
        }
        print(json.dumps(plain))
    else:
        show(Console(), figures, bounds)
    return 0 if all(bound.is_met for bound in bounds) else 1


if __name__ == "__main__":
    sys.exit(main())
