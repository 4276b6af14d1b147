"""What is too strong in a calibration anew is taken at once from the one that is in use."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import pytest
from msgspec.structs import replace

from calibrate_scenes import ROW
from command_rig import CommandRig, command_rig
from etd.calibrate.conditions import identity
from etd.calibrate.progress import Progress, save_progress
from etd.files import resources
from etd.files.calibration import load_calibration
from etd.protocol.calibration import Calibration, ElectrodeLimits
from stored_calibrations import exported, import_as
from terminal_rig import SEED, AtTerminal

pytestmark = pytest.mark.slow

ANEW = ("calibrate", "P01", "--max-current-ua", "2000", "--seed", str(SEED), "--arm")
EQUAL = ("calibrate", "P01", "--method", "equalize", "--seed", str(SEED), "--arm")


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def in_use() -> Calibration:
    made = load_calibration(resources.find("calibrations", "fake-fingertip-pad-8"))
    return replace(made, participant="P01", is_whole_accepted=True)


def caps(made: Calibration) -> list[int]:
    return [limits.cap_ua for limits in made.electrode]


@pytest.mark.parametrize("named", [("--baseline", "P01"), ()])
def test_it_is_stored_before_it_is_asked_whether_it_was(
    rig: CommandRig, named: tuple[str, ...]
) -> None:
    before = in_use()
    with rig.daemon("--array", "pad-8"):
        import_as(rig, before, "P01")
        at = AtTerminal(rig, *ANEW, *named)
        try:
            for again in (b"f", b"t"):
                at.command.line_with("How strong was it?", "stdout")
                at.press(b"t")
                at.command.line_with("Was it so? t again", "stdout")
                lowered = exported(rig, "P01")
                assert sum(lowered.electrode[one] != before.electrode[one] for one in range(8)) == 1
                at.press(again)
                if again == b"f":
                    at.command.line_with("How strong was it?", "stdout")
                    assert exported(rig, "P01") == before, "a key that slipped"
                    at.press(b"n")
            at.command.line_with("How strong was it?", "stdout")
            at.press(b"q")
            said = at.command.ended()
        finally:
            at.close()
        assert "P01 is stored so" in said.err
        assert exported(rig, "P01") == lowered
        at = AtTerminal(rig, *ANEW, *named)
        try:
            at.command.line_with("How strong was it?", "stdout")
        finally:
            at.close()


@pytest.mark.parametrize("is_equalized", [False, True])
def test_of_all_at_once_too_and_nothing_that_another_program_has_lowered_rises(
    rig: CommandRig, *, is_equalized: bool
) -> None:
    """Nor is the result stored over that: it is in a file."""
    limits = ElectrodeLimits(threshold_ua=500, comfortable_ua=1_600, cap_ua=1_900)
    before = replace(in_use(), electrode=(limits,) * 8)
    conditions = replace(ROW, array="pad-8", electrodes=8, cap_ua=2_000, method="staircase")
    asked: tuple[str, ...] = ANEW
    if is_equalized:
        known = identity("P01", before)
        conditions = replace(
            conditions, method="equalize", reference=3, baseline=known, cap_ua=1_900
        )
        asked = (*EQUAL, "--baseline", "P01", "--reference", "3")
    progress = Progress(
        conditions=conditions,
        seed=SEED,
        found=dict.fromkeys(range(8), limits),
        made_on=f"kajimoto-hv507 (fake), daemon ipc://{rig.folder}/run/etd/main/control.sock",
    )
    save_progress(rig.folder / "state" / "etd" / "main" / "calibrating" / "P01.json", progress)
    corrected = replace(before, electrode=(replace(limits, cap_ua=1_600), *before.electrode[1:]))
    whole = "How strong was all of it together?"
    with rig.daemon("--array", "pad-8"):
        import_as(rig, before, "P01")
        at = AtTerminal(rig, *asked)
        try:
            for key in (b"f", b"f"):
                at.command.line_with(whole, "stdout")
                at.press(key)
            at.command.line_with(whole, "stdout")
            import_as(rig, corrected, "P01")
            at.press(b"t")
            at.command.line_with("Was it so? t again", "stdout")
            lowered = exported(rig, "P01")
            at.press(b"t")
            while line := at.command.line():
                if whole in line:
                    at.press(b"f")
            said = at.command.ended()
        finally:
            at.close()
        assert exported(rig, "P01") == lowered
    assert max(caps(lowered)) < 1_100
    assert said.status == 1, said.err
    assert "another program has stored P01 since this command began" in said.err
    (kept,) = rig.folder.glob("P01_2*.toml")
    made = load_calibration(kept)
    assert msgspec.structs.asdict(made)["program"].startswith("etd ")
    assert caps(made)[1:] == caps(lowered)[1:]
