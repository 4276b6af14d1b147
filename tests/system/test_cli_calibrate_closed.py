"""`etd calibrate` whose input ends: before anything was presented, and after."""

from __future__ import annotations

import subprocess
from collections.abc import Iterator

import pytest

from command_rig import Command, CommandRig, command_rig

pytestmark = pytest.mark.slow

PLAIN = ("calibrate", "P01", "--max-current-ua", "2000")
BASELINE = ("--baseline", "fake-fingertip-pad-8")
OTHERS = {
    "fit": ("calibrate", "fake", *BASELINE, "--as", "F01", "--fit", "--max-current-ua", "2000"),
    "adaptation": ("calibrate", "fake", *BASELINE, "--as", "A01", "--adaptation"),
}
CASES = {"plain": PLAIN, **OTHERS}


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def state(rig: CommandRig) -> tuple[str, str]:
    """And what it says of a halt."""
    said = rig.run("status", "--json").answer["status"]
    return said["state"], str(said["halt"])


def end_input(at: Command, keys: bytes = b"") -> None:
    pipe, at.process.stdin = at.process.stdin, None
    assert pipe is not None
    with pipe:
        pipe.write(keys)


@pytest.mark.parametrize("how", ["wait", "arm"])
@pytest.mark.parametrize("kind", list(CASES))
def test_without_a_keyboard_it_is_refused_and_nothing_is_halted(
    rig: CommandRig, kind: str, how: str
) -> None:
    """As from cron, or over ssh without a terminal."""
    asked = CASES[kind] if how == "wait" else (*CASES[kind], "--arm")
    with rig.daemon("--array", "pad-8"):
        said = rig.run(*asked)
        assert said.status == 1, said.err
        assert "no key can be pressed; use a terminal" in said.err
        assert "stopped" not in said.err
        assert "waiting for the operator" not in said.err
        assert state(rig) == ("SAFE", "None")


def test_an_input_that_ends_while_the_operator_is_waited_for_was_no_keyboard(
    rig: CommandRig,
) -> None:
    with rig.daemon("--array", "pad-8"):
        at = rig.start(*PLAIN, stdin=subprocess.PIPE)
        at.line_with("waiting for the operator")
        end_input(at)
        said = at.ended()
        assert (said.status, state(rig)[0]) == (1, "SAFE"), said.err
        assert "no key can be pressed; use a terminal" in said.err


@pytest.mark.parametrize("first_key", [b"", b"n"])
def test_once_it_is_armed_its_end_is_a_stop_that_says_so(rig: CommandRig, first_key: bytes) -> None:
    with rig.daemon("--array", "pad-8"):
        at = rig.start(*PLAIN, "--arm", stdin=subprocess.PIPE)
        at.line_with("How strong was it", "stdout")
        end_input(at, first_key)
        said = at.ended()
        assert said.status == 1, said.err
        assert "stopped (the input was closed): the daemon is halted, until `etd clear`" in said.err
        name, halt = state(rig)
        assert name == "HALTED"
        assert "etd calibrate P01, the input was closed" in halt
