"""A whole scene over the real character devices: self-test, calibration, arm, frames, stop."""

from __future__ import annotations

import signal
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

import kernel_trace
import trace_decoder
import trace_rules
from daemon_scene import arm, running_daemon, write_config
from etd.client import Display
from etd.selftest.run import STAGES
from etd_body.electrode import skin
from etd_hal.fake import wire
from guest_board import (
    BOARD,
    BOARD_PATH,
    MACHINE_PATH,
    Chips,
    report,
    running_chips,
    set_parameter,
    trace_header,
)
from operator_scene import selftest

#: Stamps are cut to whole microseconds.
REST_US = BOARD.rest_us - 1
#: A walk over n electrodes is two times n x n probes, a hundredth of a second each in this guest.
_ARRAY, _ELECTRODES = "pad-8", 8
#: Which are to be felt, and how strong in uA.
_SHOWN = {3: 400, 6: 700}


def felt() -> list[trace_decoder.Phase]:
    """What the wires did, by the kernel's trace: a decoding apart from all of ours."""
    records = kernel_trace.records(kernel_trace.events(), trace_header())
    assert trace_rules.violations(records, REST_US) == []
    return trace_decoder.decode(records)


@pytest.fixture
def tested(tmp_path: Path) -> Iterator[tuple[Chips, Path]]:
    """A board that passed its self-test, then put on skin; the report."""
    set_parameter("strict_gpiod", 1)
    kernel_trace.begin()
    with (
        tempfile.TemporaryDirectory(prefix="rig") as folder,
        running_chips(Path(folder), "--on-bench") as chips,
    ):
        config, kept = Path(folder) / "etd.toml", tmp_path / "report.json"
        write_config(config, str(BOARD_PATH), MACHINE_PATH, BOARD.absent_guards, _ARRAY)
        status, found = selftest(config, chips, kept)
        assert [check for check in found.checks if not check.is_good] == []
        assert (status, found.passed, found.subject.backend) == (0, True, "linux")
        assert {check.stage for check in found.checks} == {name for name, _ in STAGES} | {"end"}
        report(f"self-test of a sound board: {len(found.checks)} checks passed")
        for electrode in range(BOARD.switch.outputs):
            chips.knock(wire.Touch(electrode, skin()))
        kernel_trace.begin()
        yield chips, kept
        state = chips.state()
    set_parameter("strict_gpiod", 0)
    assert state.dac_code == 0
    assert state.violations == ()


@pytest.mark.timeout(300)
def test_a_board_that_passed_makes_felt_what_a_frame_says_until_a_stop(
    tested: tuple[Chips, Path],
) -> None:
    """Timing is calibrated by the engine; arming accepts the report of the self-test itself."""
    chips, kept = tested
    currents_ua = [_SHOWN.get(electrode, 0) for electrode in range(_ELECTRODES)]
    with running_daemon(str(BOARD_PATH), MACHINE_PATH, BOARD.absent_guards, kept, _ARRAY) as daemon:
        daemon.start_engine()
        daemon.wait_until(engine="there", state="SAFE")
        with Display(address=daemon.address, max_current_ua=1_000, width_us=100) as display:
            arm(display, chips)
            display.hold_current(currents_ua, seconds=0.6, rate_hz=5, allow_slower=True)
            display.stop()
            assert display.status().state == "HALTED"
        daemon.end_engine(signal.SIGTERM)
    shown = [phase for phase in felt() if phase.current_ua > 310]
    assert {phase.electrode for phase in shown} == set(_SHOWN)
    for electrode, most_ua in _SHOWN.items():
        assert max(phase.current_ua for phase in shown if phase.electrode == electrode) <= most_ua
    assert all(phase.is_anodic for phase in shown)
