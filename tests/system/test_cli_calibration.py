"""`etd calibration` against a daemon: a person's limits come in, are shown, and go again."""

from __future__ import annotations

import datetime
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

from command_rig import CommandRig, command_rig
from engine_parts import calibration
from etd.files.calibration import load_calibration, to_toml
from etd.files.resources import find

pytestmark = pytest.mark.slow


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


@pytest.fixture(scope="module")
def shared() -> Iterator[CommandRig]:
    """With a daemon that more than one test asks."""
    with command_rig() as made, made.daemon("--array", "pad-8"):
        yield made


def written(folder: Path, name: str, electrodes: int = 8) -> Path:
    made = calibration(
        electrodes, array="pad-8", method="limits", pulses=10, date=datetime.date(2025, 3, 4)
    )
    path = folder / name
    path.write_text(to_toml(made))
    return path


def test_a_calibration_is_imported_shown_exported_and_deleted(shared: CommandRig) -> None:
    path = written(shared.folder, "P01.toml")
    taken = shared.run("calibration", "import", str(path))
    assert taken.status == 0, taken.err
    listed = shared.run("calibration", "list", "--json").answer["calibrations"]
    assert listed["P01"]["method"] == "limits"
    assert listed["P01"]["electrodes"] == 8

    shown = shared.run("calibration", "show", "P01").out
    assert re.search(r"^polarity +anodic$", shown, re.MULTILINE)
    assert "        7       1000         2000      3000        not known\n" in shown

    assert shared.run("calibration", "export", "P01").out == path.read_text()
    copy = shared.folder / "copy.toml"
    assert shared.run("calibration", "export", "P01", str(copy)).status == 0
    assert load_calibration(copy) == load_calibration(path)

    assert shared.run("calibration", "delete", "P01").status == 0
    gone = shared.run("calibration", "show", "P01", "--json")
    assert (gone.status, gone.answer["error"]) == (1, "not_found")
    again = shared.run("calibration", "delete", "P01")
    assert again.status == 1
    assert "no calibration 'P01'; those that can be deleted: none" in again.err


def test_what_does_not_fit_or_is_there_already_is_refused_in_a_sentence(shared: CommandRig) -> None:
    short = shared.run("calibration", "import", str(written(shared.folder, "P02.toml", 4)))
    assert short.status == 1
    assert "etd: " in short.err
    there = shared.run(
        "calibration", "export", "fake-fingertip-pad-8", str(written(shared.folder, "P03.toml"))
    )
    assert there.status == 1
    assert "it exists" in there.err
    shipped = shared.run("calibration", "delete", "fake-fingertip-pad-8")
    assert shipped.status == 1
    assert "shipped" in shipped.err
    path = written(shared.folder, "P04.toml")
    assert shared.run("calibration", "import", str(path), "--as", "../x").status == 1
    for verb in ("show", "delete", "export"):
        named = shared.run("calibration", verb, "../x")
        assert (named.status, "calibration's name: '../x'" in named.err) == (1, True)
    nowhere = shared.run("calibration", "export", "fake-fingertip-pad-8", "none/P05.toml")
    assert nowhere.status == 1
    assert "none: there is no such folder" in nowhere.err
    endless = shared.run("calibration", "import", "/dev/zero", "--as", "P06")
    assert (endless.status, "it is a pipe, a device or a socket" in endless.err) == (1, True)


def test_the_name_of_another_persons_calibration_is_taken(shared: CommandRig) -> None:
    """Who replaced it would give one person the currents of another."""
    path = written(shared.folder, "P08.toml")
    assert shared.run("calibration", "import", str(path)).status == 0
    theirs = shared.run("calibration", "export", "P08").out
    other = path.with_name("other.toml")
    other.write_text(theirs.replace('participant = "P01"', 'participant = "S02"'))
    assert other.read_text() != theirs
    asked = ("--max-current-ua", "2000")
    for taking in (
        ("calibration", "import", str(other), "--as", "P08"),
        ("calibrate", "S02", "--as", "P08", *asked),
        ("calibrate", "P01", "--as", "P08", "--polarity", "cathodic", *asked),
        ("calibrate", "fake", "--fit", "--baseline", "fake-fingertip-pad-8", "--as", "P08", *asked),
        ("calibrate", "fake", "--adaptation", "--baseline", "fake-fingertip-pad-8", "--as", "P08"),
    ):
        refused = shared.run(*taking)
        assert refused.status != 0
        assert "P08: it is the name of a calibration of p" in refused.err
        assert "which would be lost; choose another one with --as, or discard" in refused.err
    assert shared.run("calibration", "export", "P08").out == theirs
    again = path.with_name("again.toml")
    again.write_text(theirs.replace("2025-03-04", "2025-03-05"))
    assert shared.run("calibration", "import", str(again), "--as", "P08").status == 0, "a newer one"
    replaced = shared.run("calibration", "import", str(other), "--as", "P08", "--replace")
    assert replaced.status == 0, replaced.err
    assert shared.run("calibration", "delete", "P08").status == 0


def test_a_name_of_what_cannot_be_read_is_taken_too(rig: CommandRig) -> None:
    with rig.daemon("--array", "pad-8"):
        (folder,) = rig.folder.glob("state/etd/main")
        kept = folder / "calibrations"
        kept.mkdir(exist_ok=True)
        (kept / "P01.toml").write_text("[")
        path = written(rig.folder, "P01.toml")
        refused = rig.run("calibration", "import", str(path))
        assert (refused.status, "that cannot be read" in refused.err) == (1, True)
        assert rig.run("calibration", "import", str(path), "--replace").status == 0


def test_what_a_file_says_does_not_write_over_the_terminal(shared: CommandRig) -> None:
    path = written(shared.folder, "P01.toml")
    path.write_text(path.read_text().replace('program = "', 'program = "\\u001b[2J'))
    refused = shared.run("calibration", "import", str(path))
    assert refused.status == 1
    assert "program: it says" in refused.err
    assert "\x1b" not in refused.err


def test_what_to_do_with_calibrations_must_be_said(rig: CommandRig) -> None:
    told = rig.run("calibration")
    assert told.status == 2
    assert "required: list|show|export|import|delete" in told.err


def test_a_file_of_another_kind_is_called_what_it_is(rig: CommandRig) -> None:
    site = find("bodysites", "fingertip")
    told = rig.run("calibration", "import", str(site), "--json")
    assert told.status == 1
    assert told.answer["error"] == "file_error"
    assert "it is a body site file, not a calibration; name a file that" in told.answer["reason"]


def test_a_shipped_calibration_is_listed_with_what_it_holds_for(shared: CommandRig) -> None:
    lines = shared.run("calibration", "list").out
    assert "fake-fingertip-pad-8" in lines
    assert "anodic, 100 us, 60 Hz, caps up to 4000 uA" in lines


def test_one_that_cannot_be_used_is_named_and_the_others_are_listed(rig: CommandRig) -> None:
    folder = rig.folder / "state" / "etd" / "main" / "calibrations"
    folder.mkdir(parents=True)
    written(folder, "P02.toml")
    bad = written(folder, "P01.toml")
    bad.write_text(bad.read_text().replace("gamma = 1.0", "gamma = 99.0"))
    with rig.daemon("--array", "pad-8"):
        told = rig.run("calibration", "list")
        assert told.status == 1
        assert "P02 " in told.out
        assert "fake-fingertip-pad-8" in told.out
        assert "P01" not in [line.split(" ")[0] for line in told.out.splitlines()]
        assert "etd: P01 cannot be used: " in told.err
        assert "gamma: it says 99" in told.err
        answer = rig.run("calibration", "list", "--json").answer
        assert list(answer["unreadable"]) == ["P01"]
        assert "P02" in answer["calibrations"]
        assert answer["ok"] is False


def test_one_that_another_user_could_have_written_is_named_as_open_refuses_it(
    rig: CommandRig,
) -> None:
    folder = rig.folder / "state" / "etd" / "main" / "calibrations"
    folder.mkdir(parents=True)
    written(folder, "P01.toml").chmod(0o666)
    with rig.daemon("--array", "pad-8"):
        told = rig.run("calibration", "list")
        why = "another user could have written it: everybody may write it"
        assert (told.status, why in told.err) == (1, True)
        assert "P01" not in told.out
        (folder / "P01.toml").chmod(0o644)
        assert rig.run("calibration", "list").status == 0


def test_of_many_that_cannot_be_used_ten_are_named(rig: CommandRig) -> None:
    folder = rig.folder / "state" / "etd" / "main" / "calibrations"
    folder.mkdir(parents=True)
    names = [f"P{number}" for number in range(10, 23)]
    for name in names:
        (folder / f"{name}.toml").touch()
    with rig.daemon("--array", "pad-8"):
        lines = rig.run("calibration", "list").err.splitlines()
        assert [line.split(" ")[1] for line in lines[:-1]] == names[:10]
        assert lines[-1] == "etd: 3 more cannot be used: --json has why"
        assert list(rig.run("calibration", "list", "--json").answer["unreadable"]) == names
