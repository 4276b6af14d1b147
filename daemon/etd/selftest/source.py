"""Stage 10, strong pulses into the dummy load only: the source over its range.

Owns: the conditions on all steps together. Must not know: persons. Without a confirmed load nothing
is fired here.
"""

from __future__ import annotations

import statistics

from etd.selftest import adcbits, repeatability
from etd.selftest.array import check_alone
from etd.selftest.fixture import LOAD_OPTIONS, DummyLoad, Fixture
from etd.selftest.ladder import LINEARITY, SATURATES, climb, largest_here_ohm, reachable_ua
from etd.selftest.log import CheckLog
from etd.selftest.prober import Prober
from etd.selftest.readings import TOLERANCE, is_near_v, mean_v, read_map

#: The open voltage by the current alone, in compliances: it surely reaches the limit.
_INTO_COMPLIANCE = 1.3
#: For the operator to read the instruction, and to take the hands away.
_STAND_BACK_MS = 5_000
#: A one-shot's own tolerance.
_ONE_SHOT_TOLERANCE = 0.2


def check(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    """Raises: BusError, BoardFault, GuardRefusal."""
    load = fixture.options.load
    if load is None or not fixture.is_load_confirmed:
        for name in ("every_time", "steps", "linearity", "zero", "adc_bits", "compliance"):
            log.skip(name, "no confirmed dummy load", LOAD_OPTIONS)
    else:
        if fixture.operator is not None:
            fixture.operator.stand_back()
        # Waited for also without an operator to instruct.
        fixture.wait_ms(_STAND_BACK_MS)
        if _is_still_there(fixture, log, prober, load):
            repeatability.check(fixture, log, prober, load)
        fixture.is_load_confirmed = not log.stage_failed
        if fixture.is_load_confirmed:
            _check_steps(fixture, log, prober, load)
        if not log.stage_failed:
            _check_compliance(fixture, log, prober)
    _check_one_shot(fixture, log)


def _is_still_there(fixture: Fixture, log: CheckLog, prober: Prober, load: DummyLoad) -> bool:
    """The operator has touched the board: check again with the weak probe before strong pulses."""
    found = read_map(fixture, prober)
    is_alone = check_alone(fixture, log, found, fixture.free, "still_alone")
    ends = [mean_v(prober, electrode) for electrode in (load.first, load.second)]
    ends_v = [volts for _, volts in ends]
    expected_v = ends[0][0] * fixture.gain / 1e6 / (1 / load.resistance_ohm + 1 / fixture.leak_ohm)
    is_there = log.judge(
        "load_still_there",
        all(is_near_v(volts, expected_v, fixture.file.source) for volts in ends_v),
        " and ".join(f"{volts:.2f} V" for volts in ends_v),
        f"{expected_v:.2f} V at electrodes {load.first} and {load.second}",
        "the load has changed since it was confirmed: hands off, and test again",
    )
    fixture.is_load_confirmed = is_alone and is_there
    return fixture.is_load_confirmed


def _check_steps(fixture: Fixture, log: CheckLog, prober: Prober, load: DummyLoad) -> None:
    """A line through equal steps: measured over commanded current."""
    beside_ohm = 1 / (1 / load.resistance_ohm + 1 / fixture.leak_ohm)
    source = fixture.file.source
    most_ua = min(prober.strongest_ua, reachable_ua(fixture, beside_ohm))
    if most_ua < prober.strongest_ua:
        log.judge(
            "steps",
            False,
            f"the source reaches {most_ua} uA into this load: nothing was fired",
            f"{prober.strongest_ua} uA, the highest current allowed for a person",
            "test again with a --dummy-load of at most"
            f" {largest_here_ohm(fixture, prober.strongest_ua)} ohm",
        )
        return
    rungs = climb(fixture, log, prober, load, beside_ohm, most_ua)
    if log.stage_failed:
        return
    commanded_ua = [float(rung.commanded_ua) for rung in rungs]
    made_ua = [rung.made_ua for rung in rungs]
    gain, zero_ua = statistics.linear_regression(commanded_ua, made_ua)
    off_ua = max(
        abs(made - gain * commanded - zero_ua)
        for commanded, made in zip(commanded_ua, made_ua, strict=True)
    )
    step_ua = source.node_uv_per_code / beside_ohm
    log.judge(
        "steps",
        abs(gain - 1) <= TOLERANCE,
        f"{gain * source.full_scale_ua / (source.codes - 1):.3f} uA a code, up to {most_ua} uA",
        f"{source.full_scale_ua / (source.codes - 1):.3f} uA a code +-{TOLERANCE:.0%}",
        f"full_scale_ua of this board is about {gain * source.full_scale_ua:.0f}: put that into"
        " your own board file, and test again",
    )
    log.judge(
        "linearity",
        off_ua <= LINEARITY * most_ua + step_ua,
        f"at most {off_ua:.0f} uA off the line",
        f"within {LINEARITY:.0%} of {most_ua} uA",
        SATURATES,
    )
    log.judge(
        "zero",
        abs(zero_ua) <= LINEARITY * most_ua + step_ua,
        f"{zero_ua:.0f} uA at code 0",
        f"0 uA within {LINEARITY:.0%} of {most_ua} uA",
        "check the source for an offset",
    )
    if log.stage_failed:
        return
    read_v = [rung.shot.voltage_v for rung in rungs]
    adcbits.check(fixture, log, prober, load, read_v, gain * beside_ohm / 1e6)


def _check_compliance(fixture: Fixture, log: CheckLog, prober: Prober) -> None:
    """Into an open electrode: the node stops at the compliance voltage, or, if the body site does
    not allow enough current for that, at the voltage of the highest allowed current.
    """
    source = fixture.file.source
    wanted_ua = int(source.compliance_v * _INTO_COMPLIANCE / fixture.leak_ohm * 1e6)
    wanted_ua = min(wanted_ua, prober.strongest_ua)
    expected_v = min(source.compliance_v, wanted_ua * fixture.gain * fixture.leak_ohm / 1e6)
    if expected_v < source.compliance_v * (1 - TOLERANCE):
        log.skip(
            "compliance",
            f"the {wanted_ua} uA that are allowed raise the node to {expected_v:.0f} V only",
            "measure the rail by hand",
        )
        return
    _, result = prober.into_load(fixture.free[0], wanted_ua)
    full_scale_v = (source.adc_codes - 1) * source.node_uv_per_code / 1e6
    log.judge(
        "compliance",
        abs(result.voltage_v - expected_v) <= TOLERANCE * source.compliance_v
        and result.voltage_v < full_scale_v,
        f"{result.voltage_v:.0f} V at {wanted_ua} uA with nothing connected",
        f"{expected_v:.0f} V +-{TOLERANCE:.0%} of {source.compliance_v} V",
        "check the rail; if it is right, put the measured figure into compliance_v",
    )


def _check_one_shot(fixture: Fixture, log: CheckLog) -> None:
    """No message that the guard passes lasts as long as a one-shot: a person must measure it."""
    one_shot = fixture.file.guards.one_shot
    if one_shot == "absent":
        log.absent("one_shot")
        return
    seen_us = fixture.options.one_shot_us
    if seen_us is None:
        log.skip(
            "one_shot",
            f"it acts after {one_shot.on_us} us; no message that may be sent is as long",
            "hold the source on by hand, into the load, measure it with an oscilloscope, and give"
            " the time with --one-shot-us US (docs/bring-up.md)",
        )
        return
    log.judge(
        "one_shot",
        abs(seen_us - one_shot.on_us) <= _ONE_SHOT_TOLERANCE * one_shot.on_us,
        f"{seen_us} us, measured by the operator with an oscilloscope",
        f"{one_shot.on_us} us +-{_ONE_SHOT_TOLERANCE:.0%}",
        "repair it: no other guard is fast enough",
    )
