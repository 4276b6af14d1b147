"""`etd calibrate --adaptation` as a process: what it is added to, what is kept, and how it ends."""

from __future__ import annotations

import signal
from collections.abc import Iterator

import pytest

from command_rig import CommandRig, command_rig
from etd.calibrate.adaptation import QUESTIONS
from etd.files import resources
from etd.files.calibration import load_calibration

pytestmark = pytest.mark.slow

BASELINE = "fake-fingertip-pad-8"
IN_USE = ("calibrate", "fake", "--adaptation", "--baseline", BASELINE, "--as", "A01")
ON_FAKE = ("--board", "fake", "--array", "pad-8", "--answers", "simulated")


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def test_what_use_does_is_added_to_a_calibration(rig: CommandRig) -> None:
    """In the least time that there is, so that it is told why it does not count."""
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
    at = rig.start(*IN_USE, *ON_FAKE, "--trials", str(trials))
    while not (trials.exists() and len(trials.read_text().splitlines()) > 2):
        assert at.process.poll() is None
        rig.run("status")
    at.process.send_signal(signal.SIGINT)
    said = at.ended()
    assert said.status == 130, said.err
    assert "nothing of it is kept: the same command begins again, after a rest" in said.err


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
