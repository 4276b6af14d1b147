"""`etd calibrate --adaptation` as a process: what it is added to, what is kept, and how it ends."""

from __future__ import annotations

import signal
import subprocess
import sys
from collections.abc import Iterator

import pytest
from msgspec.structs import replace

from command_rig import WITHIN_S, CommandRig, command_rig
from etd.calibrate.adaptation import QUESTIONS, USE_LEVEL
from etd.files import resources
from etd.files.calibration import load_calibration, to_toml
from etd.protocol.calibration import current_of_level
from stored_calibrations import exported, import_as
from terminal_rig import AtTerminal

pytestmark = pytest.mark.slow

BASELINE = "fake-fingertip-pad-8"
IN_USE = ("calibrate", "fake", "--adaptation", "--baseline", BASELINE, "--as", "A01")
ON_FAKE = ("--board", "fake", "--answers", "simulated")


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def test_what_use_does_is_added_to_a_calibration(rig: CommandRig) -> None:
    """In the least time that there is, so that it is told why it does not count. The fake has the
    array of the calibration.
    """
    out, trials = rig.folder / "A01.toml", rig.folder / "A01.tsv"
    files = ("--out", str(out), "--trials", str(trials))
    told = rig.run(*IN_USE, *ON_FAKE, "--use-s", str(QUESTIONS), *files, "--json")
    assert told.status == 0, told.err
    answer = told.answer
    assert (answer["usable"], answer["why_not"]) == (False, "at least 480 s are needed")
    made = load_calibration(out)
    baseline = load_calibration(resources.find("calibrations", BASELINE))
    assert made.electrode == baseline.electrode
    assert made.adaptation is not None
    assert (made.adaptation.answers, made.adaptation.use_s) == (QUESTIONS // 2, QUESTIONS)
    rows = [row.split("\t") for row in trials.read_text().splitlines()]
    asked = [row[rows[0].index("question")] for row in rows[1:]]
    assert asked.count("in_use") == QUESTIONS
    assert set(asked[: asked.index("in_use")]) <= {"whole", "sure"}, "up to level 1 first"
    checked = rig.run("check", str(out))
    assert "the person's word raises nothing" in checked.out
    assert "at least 480 s are needed" in checked.out


def test_an_interruption_keeps_nothing_and_says_so(rig: CommandRig) -> None:
    trials = rig.folder / "A01.tsv"
    at = rig.start(*IN_USE, *ON_FAKE, "--use-s", str(QUESTIONS), "--trials", str(trials))
    while not (trials.exists() and len(trials.read_text().splitlines()) > 2):
        assert at.process.poll() is None
        rig.run("status")
    at.process.send_signal(signal.SIGINT)
    said = at.ended()
    assert said.status == 130, said.err
    assert "nothing that was asked is kept: the same command begins again, after a rest" in said.err


class Wearer:
    """Keys at a terminal, each after its question."""

    def __init__(self, at: AtTerminal) -> None:
        self._at = at

    def answer(self, question: str, *keys: str) -> None:
        for key in keys:
            self._at.command.line_with(question, "stdout")
            self._at.press(key.encode())
            if key == "t":
                self._at.command.line_with("Was it so? t again", "stdout")
                self._at.press(b"t")


def test_what_is_too_strong_in_use_takes_the_levels_down_for_good(rig: CommandRig) -> None:
    """And what was measured before is of levels that do not hold any more."""
    before = load_calibration(resources.find("calibrations", BASELINE))
    asked = ("calibrate", "fake", "--adaptation", "--baseline", "A01", "--as", "A01", "--arm")
    with rig.daemon("--array", "pad-8"):
        import_as(rig, before, "A01")
        at = AtTerminal(rig, *asked, "--use-s", str(QUESTIONS))
        try:
            wearer = Wearer(at)
            wearer.answer("How strong was all of it together?", *"fffffffff")
            wearer.answer("Is it as strong as at first?", "s", "t")
            said = at.command.ended()
        finally:
            at.close()
        assert said.status == 1, said.err
        assert "it was too strong after 2 s of use, so nothing was measured" in said.err
        assert "all electrodes at once were too strong" in said.err
        assert "A01 is stored so" in said.err
        after = exported(rig, "A01")
    assert after.adaptation is None
    for was, now in zip(before.electrode, after.electrode, strict=True):
        level_ua = current_of_level(was, USE_LEVEL, before.gamma)
        assert now.comfortable_ua < level_ua or now.comfortable_ua == now.threshold_ua
        assert now.cap_ua < was.cap_ua


def test_what_was_too_strong_in_use_is_stored_before_it_is_asked_whether_it_was(
    rig: CommandRig,
) -> None:
    """The process may be killed at that question. A key that slipped gives it back."""
    before = load_calibration(resources.find("calibrations", BASELINE))
    path = rig.folder / "P.toml"
    path.write_text(to_toml(before))
    asked = ("calibrate", "fake", "--adaptation", "--baseline", "A04", "--as", "A04", "--arm")
    with rig.daemon("--array", "pad-8"):
        assert rig.run("calibration", "import", str(path), "--as", "A04").status == 0
        at = AtTerminal(rig, *asked, "--use-s", str(QUESTIONS))
        try:
            Wearer(at).answer("How strong was all of it together?", *"fffffffff")
            for again in ("s", "t"):
                at.command.line_with("Is it as strong as at first?", "stdout")
                at.press(b"t")
                at.command.line_with("Was it so? t again", "stdout")
                assert exported(rig, "A04").electrode != before.electrode
                if again == "s":
                    at.press(b"s")
                    at.command.line_with("Is it as strong as at first?", "stdout")
                    assert exported(rig, "A04").electrode == before.electrode
                    at.press(b"s")
            at.command.process.kill()
            at.command.ended()
        finally:
            at.close()
        lowered = exported(rig, "A04")
    for was, now in zip(before.electrode, lowered.electrode, strict=True):
        assert now.cap_ua < was.cap_ua


@pytest.mark.parametrize("is_in_use", [False, True])
def test_too_strong_by_another_program_takes_the_stored_levels_down(
    rig: CommandRig, *, is_in_use: bool
) -> None:
    before = load_calibration(resources.find("calibrations", BASELINE))
    path = rig.folder / "P.toml"
    path.write_text(to_toml(before))
    asked = ("calibrate", "fake", "--adaptation", "--baseline", "A06", "--as", "A06", "--arm")
    says = "import etd; etd.Display(max_current_ua=100, width_us=50).felt('too_strong')"
    with rig.daemon("--array", "pad-8"):
        assert rig.run("calibration", "import", str(path), "--as", "A06").status == 0
        at = AtTerminal(rig, *asked, "--use-s", str(QUESTIONS))
        try:
            question = "How strong was all of it together?"
            if is_in_use:
                Wearer(at).answer(question, *"fffffffff")
                question = "Is it as strong as at first?"
            at.command.line_with(question, "stdout")
            program = [sys.executable, "-c", says]
            subprocess.run(program, env=rig.environment, check=True, timeout=WITHIN_S)
            said = at.command.ended()
        finally:
            at.close()
        lowered = exported(rig, "A06")
    assert said.status == 1, said.err
    assert "stopped (too strong, by a button, a monitor or another program)" in said.err
    assert "A06 is stored so" in said.err
    for was, now in zip(before.electrode, lowered.electrode, strict=True):
        assert now.cap_ua < was.cap_ua


def test_what_is_stored_under_that_name_is_taken_down_from_what_it_is_and_never_rises(
    rig: CommandRig,
) -> None:
    """It may be of another day than the baseline. A key that slipped leaves it as it was."""
    before = load_calibration(resources.find("calibrations", BASELINE))
    another_day = replace(
        before,
        is_whole_accepted=True,
        electrode=tuple(
            replace(
                one,
                threshold_ua=600,
                comfortable_ua=700,
                cap_ua=one.cap_ua if number % 2 else 1_200,
            )
            for number, one in enumerate(before.electrode)
        ),
    )
    asked = ("calibrate", "fake", "--adaptation", "--baseline", BASELINE, "--as", "B04", "--arm")
    path = rig.folder / "P.toml"
    with rig.daemon("--array", "pad-8"):
        path.write_text(to_toml(another_day))
        assert rig.run("calibration", "import", str(path), "--as", "B04").status == 0
        at = AtTerminal(rig, *asked, "--use-s", str(QUESTIONS))
        try:
            Wearer(at).answer("How strong was all of it together?", *"fffffffff")
            at.command.line_with("Is it as strong as at first?", "stdout")
            at.press(b"t")
            at.command.line_with("Was it so? t again", "stdout")
            lowered = exported(rig, "B04")
            at.press(b"s")
            at.command.line_with("Is it as strong as at first?", "stdout")
            assert exported(rig, "B04") == another_day
            at.command.process.kill()
            at.command.ended()
        finally:
            at.close()
    assert lowered != another_day
    for was, now in zip(another_day.electrode, lowered.electrode, strict=True):
        assert now.cap_ua <= was.cap_ua
        assert now.comfortable_ua <= was.comfortable_ua


def test_what_another_program_has_stored_meanwhile_is_left_as_it_is(rig: CommandRig) -> None:
    """Nothing of it rises: neither where nothing was too strong, nor by the result."""
    before = load_calibration(resources.find("calibrations", BASELINE))
    corrected = replace(
        before, electrode=tuple(replace(one, cap_ua=one.comfortable_ua) for one in before.electrode)
    )
    asked = ("calibrate", "fake", "--adaptation", "--baseline", "A07", "--as", "A07", "--arm")
    with rig.daemon("--array", "pad-8"):
        import_as(rig, before, "A07")
        at = AtTerminal(rig, *asked, "--use-s", str(QUESTIONS))
        try:
            wearer = Wearer(at)
            wearer.answer("How strong was all of it together?", *"fff")
            import_as(rig, corrected, "A07")
            wearer.answer("How strong was all of it together?", *"ffffff")
            wearer.answer("Is it as strong as at first?", *("s" * QUESTIONS))
            said = at.command.ended()
        finally:
            at.close()
        assert exported(rig, "A07") == corrected
    assert said.status == 1, said.err
    assert "another program has stored A07 since this command began" in said.err
    (kept,) = rig.folder.glob("A07_*.toml")
    assert f"it is in {kept.name}" in said.err
    assert load_calibration(kept).adaptation is not None


def test_a_name_under_which_caps_are_lower_is_no_place_for_the_baselines(rig: CommandRig) -> None:
    before = load_calibration(resources.find("calibrations", BASELINE))
    first, *others = before.electrode
    path = rig.folder / "P.toml"
    path.write_text(
        to_toml(replace(before, electrode=(replace(first, cap_ua=first.cap_ua - 10), *others)))
    )
    with rig.daemon("--array", "pad-8"):
        assert rig.run("calibration", "import", str(path), "--as", "A01").status == 0
        told = rig.run(*IN_USE)
    assert told.status == 2
    assert "A01 has lower caps than fake-fingertip-pad-8" in told.err
    assert "--baseline A01" in told.err


def test_what_could_not_be_stored_is_not_said_to_be(rig: CommandRig) -> None:
    before = load_calibration(resources.find("calibrations", BASELINE))
    path = rig.folder / "P.toml"
    path.write_text(to_toml(before))
    asked = ("calibrate", "fake", "--adaptation", "--baseline", "A05", "--as", "A05", "--arm")
    with rig.daemon("--array", "pad-8"):
        assert rig.run("calibration", "import", str(path), "--as", "A05").status == 0
        at = AtTerminal(rig, *asked, "--use-s", str(QUESTIONS))
        try:
            Wearer(at).answer("How strong was all of it together?", *"fffffffff")
            at.command.line_with("Is it as strong as at first?", "stdout")
            (stored,) = rig.folder.rglob("A05.toml")
            stored.unlink()
            stored.mkdir()
            at.press(b"t")
            said = at.command.ended()
        finally:
            at.close()
    assert said.status != 0
    assert "A05 is NOT stored so" in said.err
    assert "is stored so" not in said.err


def test_what_is_too_strong_on_the_way_up_is_stored_before_anything_comes_again(
    rig: CommandRig,
) -> None:
    """Of levels that stay at their thresholds the caps fall; and the process may be killed."""
    made = load_calibration(resources.find("calibrations", BASELINE))
    at_threshold = tuple(replace(one, comfortable_ua=one.threshold_ua) for one in made.electrode)
    path, exported = rig.folder / "AT.toml", rig.folder / "A03.toml"
    path.write_text(to_toml(replace(made, electrode=at_threshold, is_whole_accepted=True)))
    with rig.daemon("--array", "pad-8"):
        assert rig.run("calibration", "import", str(path), "--as", "A03").status == 0
        asked = ("calibrate", "fake", "--adaptation", "--baseline", "A03", "--as", "A03")
        at = AtTerminal(rig, *asked, "--arm", "--use-s", str(QUESTIONS))
        try:
            Wearer(at).answer("How strong was all of it together?", *"fffffft")
            at.command.line_with("How strong was all of it together?", "stdout")
            at.command.process.kill()
            at.command.ended()
        finally:
            at.close()
        assert rig.run("calibration", "export", "A03", str(exported)).status == 0
    after = load_calibration(exported)
    assert after.is_whole_accepted is None
    for was, now in zip(at_threshold, after.electrode, strict=True):
        assert now.comfortable_ua == now.threshold_ua == was.threshold_ua
        assert now.cap_ua < was.cap_ua


def test_a_calibration_of_which_nothing_was_felt_is_refused_before_arming(rig: CommandRig) -> None:
    made = load_calibration(resources.find("calibrations", BASELINE))
    unfelt = tuple(replace(one, felt=False) for one in made.electrode)
    path = rig.folder / "NF.toml"
    path.write_text(to_toml(replace(made, electrode=unfelt)))
    with rig.daemon("--array", "pad-8"):
        assert rig.run("calibration", "import", str(path), "--as", "NF").status == 0
        told = rig.run("calibrate", "fake", "--adaptation", "--baseline", "NF", "--as", "A02")
        assert told.status == 2
        assert "no electrode of NF was felt" in told.err


def test_it_is_added_to_what_there_is_and_it_is_said_where_there_is_none(rig: CommandRig) -> None:
    told = rig.run("calibrate", "P09", "--adaptation", *ON_FAKE)
    assert told.status == 1
    assert "no calibration 'P09'" in told.err
    assert "--adaptation adds what use does to a calibration: calibrate first" in told.err
    others = rig.run("calibrate", "P09", *IN_USE[2:5], "--as", "P09", *ON_FAKE)
    assert others.status == 1
    assert (
        "the baseline has participant fake, this calibration P09: --adaptation adds" in others.err
    )


@pytest.mark.parametrize(
    ("options", "why"),
    [
        (("--max-current-ua", "2000"), "uses the caps of the calibration: omit --max-current-ua"),
        (("--fit",), "one of the two"),
        (("--restart",), "omit --restart"),
        (("--method", "limits"), "asks for no threshold"),
        (("--leave-out", "3"), "asks for no threshold"),
        (("--ask-sensation",), "adds what use does to a calibration and nothing else"),
        (("--electrodes", "3,4"), "--electrodes goes with --fit"),
        (("--use-s", "39"), "is not from 40 to 3600 s"),
    ],
)
def test_options_that_it_would_not_use_are_refused(
    rig: CommandRig, options: tuple[str, ...], why: str
) -> None:
    told = rig.run(*IN_USE, *ON_FAKE, *options)
    assert told.status == 2
    assert why in told.err


def test_the_time_in_use_goes_with_it(rig: CommandRig) -> None:
    told = rig.run("calibrate", "P01", "--max-current-ua", "2000", "--use-s", "300")
    assert told.status == 2
    assert "--use-s goes with --adaptation" in told.err
