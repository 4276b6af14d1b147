"""`etd calibrate --method equalize` as a process: what was too strong of what it compares with."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import pytest
from msgspec.structs import replace

from command_rig import CommandRig, command_rig
from etd.calibrate.progress import Progress
from etd.files import resources
from etd.files.calibration import load_calibration
from etd.protocol.calibration import Calibration
from stored_calibrations import exported, import_as
from terminal_rig import AtTerminal

pytestmark = pytest.mark.slow

BASELINE = "fake-fingertip-pad-8"
REFERENCE = 3
#: What the command takes for a reference by itself.
DEFAULT = 3
BY_ITSELF = (
    "calibrate", "fake", "--method", "equalize", "--baseline", BASELINE, "--board", "fake",
    "--array", "pad-8",
)  # fmt: skip
EQUAL = ("calibrate", "fake", "--method", "equalize", "--reference", str(REFERENCE), "--baseline")


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def shipped() -> Calibration:
    made = load_calibration(resources.find("calibrations", BASELINE))
    return replace(made, is_whole_accepted=True)


def go_up_to_the_reference(at: AtTerminal) -> None:
    """Up to the first comparison, whose question is on the screen then."""
    while "as strong as the first?" not in (line := at.command.line()):
        assert line, at.command.ended().err
        if "How strong was it?" in line:
            at.press(b"f")


def test_what_was_too_strong_is_taken_from_what_it_compares_with_at_once(rig: CommandRig) -> None:
    """Also of what is stored under the result's name. A key that slipped leaves both as they were,
    and the same command goes on, where the process was killed too.
    """
    before, seed = shipped(), ("--seed", "4", "--arm")
    asked = (*EQUAL, "P01", "--as", "P02", *seed)
    with rig.daemon("--array", "pad-8"):
        import_as(rig, before, "P01")
        import_as(rig, before, "P02")
        at = AtTerminal(rig, *asked)
        try:
            go_up_to_the_reference(at)
            at.press(b"t")
            at.command.line_with("Which one was too strong?", "stdout")
            assert exported(rig, "P01") != before
            at.press(b"0")
            at.command.line_with("as strong as the first?", "stdout")
            assert exported(rig, "P01") == exported(rig, "P02") == before
            at.press(b"q")
            said = at.command.ended()
        finally:
            at.close()
        assert said.status == 1, said.err
        assert "is stored so" not in said.err
        at = AtTerminal(rig, *asked)
        try:
            go_up_to_the_reference(at)
            at.press(b"t")
            at.command.line_with("Which one was too strong?", "stdout")
            at.command.process.kill()
            at.command.ended()
        finally:
            at.close()
        lowered = exported(rig, "P01")
        while rig.run("status", "--json").answer["status"]["state"] != "SAFE":
            pass  # Its lease has not lapsed yet.
        at = AtTerminal(rig, *asked)
        try:
            refused = at.command.ended()
        finally:
            at.close()
        assert exported(rig, "P02") == lowered
    assert lowered.is_whole_accepted is None
    was, now = before.electrode[REFERENCE], lowered.electrode[REFERENCE]
    assert now.cap_ua < was.comfortable_ua
    assert refused.status == 1
    assert f"the reference, electrode {REFERENCE}, is too strong" in refused.err


def test_an_electrode_that_was_too_strong_is_lowered_and_the_same_command_goes_on(
    rig: CommandRig,
) -> None:
    before = shipped()
    asked = (*EQUAL, "P01", "--as", "P01", "--seed", "11", "--arm")
    with rig.daemon("--array", "pad-8"):
        import_as(rig, before, "P01")
        at = AtTerminal(rig, *asked)
        try:
            go_up_to_the_reference(at)
            at.press(b"t")
            at.command.line_with("Which one was too strong?", "stdout")
            # By this seed the reference came last.
            at.press(b"1")
            at.command.line_with("as strong as the first?", "stdout")
            at.press(b"q")
            said = at.command.ended()
        finally:
            at.close()
        assert said.status == 1, said.err
        assert "P01 is stored so" in said.err
        lowered = exported(rig, "P01")
        again = AtTerminal(rig, *asked)
        try:
            go_up_to_the_reference(again)
        finally:
            again.close()
        assert exported(rig, "P01") == lowered
    ((was, now),) = (
        both for both in zip(before.electrode, lowered.electrode, strict=True) if both[0] != both[1]
    )
    assert now.cap_ua < was.cap_ua
    assert lowered.electrode[REFERENCE] == before.electrode[REFERENCE]


def reference_of(rig: CommandRig, name: str, *options: str) -> int | None:
    """Of a calibration that is left in its beginning."""
    at = AtTerminal(rig, *BY_ITSELF, "--as", name, *options)
    try:
        at.command.line_with("How strong was it?", "stdout")
        at.press(b"t")
        at.command.line_with("Was it so?", "stdout")
        at.press(b"q")
        assert at.command.ended().status == 1
    finally:
        at.close()
    (saved,) = (rig.folder / "state").rglob(f"{name}.json")
    return msgspec.json.decode(saved.read_bytes(), type=Progress).conditions.reference


def test_what_is_left_out_is_not_what_the_others_are_compared_with(rig: CommandRig) -> None:
    """Nor in a calibration that was begun with it: its comparisons would go on."""
    left_out = ("--leave-out", str(DEFAULT))
    assert reference_of(rig, "K7") == DEFAULT
    refused = rig.run(*BY_ITSELF, "--as", "K7", *left_out)
    assert refused.status == 2
    assert f"K7.json: conditions.reference: the saved progress has {DEFAULT}, this" in refused.err
    assert reference_of(rig, "K8", *left_out) not in (None, DEFAULT)
