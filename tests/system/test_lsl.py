"""`etd lsl` with a real liblsl: an inlet on this machine, held against the bus trace."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from command_rig import WITHIN_S, CommandRig, command_rig
from etd.cli import extras
from etd.protocol.errors import LibraryMissing, PackageMissing
from followed_trace import FollowedTrace
from ssh_rig import missing, ssh_rig

pytestmark = pytest.mark.slow

#: Nothing leaves this machine.
_HERE_ALONE = """
[ports]
IPv6 = disable
[multicast]
ResolveScope = machine
ListenAddress = 127.0.0.1
[lab]
KnownPeers = {127.0.0.1}
"""
_STIMULI = """
from etd import Display
with Display() as display:
    display.arm(open_to=0.4)
    for tag in range(1, 6):
        display.present({2: 0.4}, seconds=0.1, tag=tag)
    display.mark(99)
"""
#: Reads until the mark, or for a minute.
_INLET = """
import json, time
import pylsl
found = pylsl.resolve_byprop("name", "etd-events", 1, 60.0)
info = found[0]
inlet = pylsl.StreamInlet(info)
inlet.open_stream(60.0)
about = inlet.info(60.0).desc().child("stamps")
said = about.child_value("clock"), about.child_value("within_ns")
print(json.dumps([info.type(), info.channel_count(), *said, inlet.time_correction(60.0)]))
print(pylsl.local_clock() - time.monotonic(), flush=True)
until_s = time.monotonic() + 60.0
while time.monotonic() < until_s:
    sample, stamp_s = inlet.pull_sample(1.0)
    if sample is not None:
        print(json.dumps([sample[0], json.loads(sample[1]), stamp_s]), flush=True)
        if sample[0] == "mark/99":
            break
"""


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    try:
        extras.check_lsl()
    except (PackageMissing, LibraryMissing) as missing:
        pytest.skip(str(missing))
    with command_rig() as made:
        configured = made.folder / "lsl.cfg"
        configured.write_text(_HERE_ALONE)
        made.environment["LSLAPICFG"] = str(configured)
        yield made


def first_pulses(trace: Path) -> dict[int, int]:
    """By tag, when the first pulse of electrode 2 began."""
    found: dict[int, int] = {}
    for phase in FollowedTrace(io.BytesIO(trace.read_bytes())).phases():
        if phase.electrode == 2 and phase.tag is not None and phase.current_ua:
            found.setdefault(phase.tag, phase.from_ns)
    return found


def test_an_inlet_reads_the_first_pulses_of_the_wires(rig: CommandRig) -> None:
    trace = rig.folder / "bus.jsonl"
    patient = ("--timeout-factor", "10")
    with rig.daemon("--array", "pad-8", "--trace", str(trace), *patient):
        offered = rig.start("lsl", "--json", "--seconds", "90")
        assert json.loads(offered.line())["streams"] == ["etd-events", "etd-contact"]
        inlet = subprocess.Popen(
            [sys.executable, "-c", _INLET], env=rig.environment, stdout=subprocess.PIPE, text=True
        )
        try:
            assert inlet.stdout is not None
            kind, channels, clock, within_ns, correction_s = json.loads(inlet.stdout.readline())
            behind_s = float(inlet.stdout.readline())
            stimuli = subprocess.run(
                [sys.executable, "-c", _STIMULI],
                env={**rig.environment, "PYTHONWARNINGS": "error"},
                timeout=WITHIN_S,
                check=False,
            )
            assert stimuli.returncode == 0
            lines, _ = inlet.communicate(timeout=WITHIN_S)
        finally:
            inlet.kill()
            inlet.communicate()
    said = offered.ended()
    assert said.status == 3, "the daemon has ended"
    assert (kind, channels, within_ns) == ("Markers", 2, "0")
    assert "CLOCK_MONOTONIC" in clock
    assert abs(behind_s) < 0.1, "liblsl's clock is CLOCK_MONOTONIC"
    assert abs(correction_s) < 0.01
    begun = {}
    for line in lines.splitlines():
        name, facts, stamp_s = json.loads(line)
        if name.startswith("frame/"):
            board_ns = round(stamp_s * 1e9) - 1_000 * facts["clock_lag_us"]
            assert abs(board_ns - facts["first_ns"]) < 2_000
            begun[int(name.removeprefix("frame/"))] = board_ns
    fired = first_pulses(trace)
    assert set(begun) == {1, 2, 3, 4, 5}
    for tag, board_ns in begun.items():
        # A pulse is timed from its message, a phase from the DAC's word in it.
        assert 0 <= fired[tag] - board_ns < 100_000


@pytest.mark.skipif(missing() is not None, reason=str(missing()))
def test_stamps_of_a_daemon_elsewhere_say_within_how_much_they_are_right(rig: CommandRig) -> None:
    with ssh_rig(rig) as there, rig.daemon("--array", "pad-8"):
        there.admit()
        said = subprocess.run(
            [sys.executable, "-m", "etd", "lsl", "--host", "display", "--json", "--seconds", "2"],
            env=there.environment,
            capture_output=True,
            text=True,
            timeout=WITHIN_S,
            check=False,
        )
    assert said.returncode == 0, said.stderr
    assert 0 < json.loads(said.stdout)["within_us"] < 1_000_000


def test_without_liblsl_it_is_said_where_it_comes_from(rig: CommandRig) -> None:
    hidden = rig.folder / "hidden"
    (hidden / "pylsl").mkdir(parents=True)
    (hidden / "pylsl" / "__init__.py").write_text("raise RuntimeError('no liblsl')\n")
    rig.environment["PYTHONPATH"] = os.pathsep.join(
        [str(hidden), rig.environment.get("PYTHONPATH", "")]
    )
    said = rig.run("lsl", "--seconds", "1")
    assert said.status == 1
    assert "the library liblsl is not there" in said.err
    assert "PYLSL_LIB" in said.err
