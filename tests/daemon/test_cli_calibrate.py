"""One key, one answer; and the picture beside it. The keyboard is a pipe here."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import msgspec
import pytest

from calibrate_scenes import FOUND, ROW
from etd.calibrate import quest_plus
from etd.calibrate.answers import ANSWERS, Answer, Ask, Presentation, Question
from etd.calibrate.progress import Progress
from etd.cli import USED_WRONGLY, main
from etd.cli.calibrate_screen import Screen
from etd.cli.keys import Keyboard, legend
from etd.files import resources
from etd.files.array import load_array
from etd.protocol.calibration import ElectrodeLimits
from etd.protocol.facts import ArrayFacts

pytestmark = pytest.mark.slow

EQUALIZE = ("P1", "--method", "equalize", "--baseline", "fake-fingertip-pad-8")


@pytest.fixture(autouse=True)
def _state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Each test's own: of two commands for one person the second is refused."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))


def never() -> None:
    """The input is not closed here (`test_keys_closed.py`)."""
    raise AssertionError


class Typed:
    """A keyboard's other end."""

    def __init__(self) -> None:
        self.fd, self._end = os.pipe()
        self.asked: list[Question] = []
        self.heard: list[Answer | None] = []
        self.keyboard = Keyboard(self.fd, self.asked.append, self.heard.append, never)

    def press(self, keys: bytes) -> None:
        os.write(self._end, keys)

    def answer(self, ask: Ask = "strength", keys: bytes = b"") -> tuple[Answer, int]:
        """What `keys`, pressed after the question, answer; and how often the lease was kept."""
        kept = 0

        def show(question: Question) -> None:
            self.asked.append(question)
            if keys:
                self.press(keys)

        def keep() -> None:
            nonlocal kept
            kept += 1
            if not keys and kept == 2:
                self.press(b"f")

        keyboard = Keyboard(self.fd, show, self.heard.append, never)
        return keyboard.answer(Question(ask, 3), keep), kept

    def close(self) -> None:
        os.close(self.fd)
        os.close(self._end)


@pytest.fixture
def typed() -> Iterator[Typed]:
    made = Typed()
    yield made
    made.close()


@pytest.mark.parametrize(
    ("ask", "key", "answer"),
    [
        ("strength", b"n", "not_felt"),
        ("strength", b"F", "felt"),
        ("strength", b"c", "comfortable"),
        ("strength", b"t", "too_strong"),
        ("compare", b"w", "weaker"),
        ("compare", b"s", "same"),
        ("compare", b"g", "stronger"),
        ("which", b"1", "first"),
        ("which", b"2", "second"),
        ("which", b"b", "both"),
        ("strength", b" ", "stop"),
        ("compare", b"\x1b", "stop"),
        ("strength", b"q", "pause"),
    ],
)
def test_one_key_is_one_answer(typed: Typed, ask: Ask, key: bytes, answer: Answer) -> None:
    assert typed.answer(ask, key) == (answer, 0)


def test_keys_of_another_question_and_unknown_ones_are_no_answer(typed: Typed) -> None:
    answer, kept = typed.answer("strength", b"wx\xffsf")
    assert answer == "felt"
    assert kept == 4
    assert typed.heard == [None, None, None, None, "felt"]


@pytest.mark.parametrize("key", [b"\x1b[A", b"\x1bOD", b"\x1b[3~", b"\x1b[1;5C", b"\x1b[A\x1b[B"])
def test_an_arrow_is_no_stop_though_it_begins_as_escape_does(typed: Typed, key: bytes) -> None:
    assert typed.answer("strength", key + b"f")[0] == "felt"


@pytest.mark.parametrize(
    "keys", [b"\x1b ", b"\x1bf", b"\x1b[", b"\x1b\x1b", b"\x1b[ ", b"\x1b[1\x1b"]
)
def test_escape_and_whatever_else_is_pressed_is_a_stop(typed: Typed, keys: bytes) -> None:
    assert typed.answer("strength", keys)[0] == "stop"


def test_while_nobody_answers_the_lease_is_kept(typed: Typed) -> None:
    assert typed.answer() == ("felt", 2)


def test_what_is_pressed_before_the_question_is_dropped_but_for_a_stop(typed: Typed) -> None:
    typed.press(b"fff")
    assert typed.answer("strength", b"n") == ("not_felt", 0)
    typed.press(b"ff f")
    assert typed.keyboard.answer(Question("strength", 3), lambda: None) == "stop"
    assert typed.asked[-1].ask == "strength"


def test_a_stop_key_is_heard_while_something_is_presented(typed: Typed) -> None:
    assert not typed.keyboard.wants_stop()
    typed.press(b"n")
    assert not typed.keyboard.wants_stop()
    typed.press(b"n ")
    assert typed.keyboard.wants_stop()


@pytest.mark.parametrize(
    ("keys", "ending"),
    [(b"", None), (b"nft1", None), (b"nqn", "pause"), (b"q ", "stop"), (b"\x1b", "stop")],
)
def test_where_nothing_is_asked_the_keys_that_end_it_are_heard(
    typed: Typed, keys: bytes, ending: Answer | None
) -> None:
    typed.press(keys)
    assert typed.keyboard.asked_to_end() == ending


@pytest.mark.parametrize("ask", list(ANSWERS))
def test_the_legend_names_every_answer_and_the_stop(ask: Ask) -> None:
    said = legend(ask)
    assert all(answer.replace("_", " ") in said for answer in ANSWERS[ask])
    assert "SPACE STOP" in said


def test_the_help_names_every_key(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["calibrate", "--help"])
    said = capsys.readouterr().out
    assert legend("strength") in said
    assert legend("compare") in said
    assert legend("which") in said


def shown(electrode: int, current_ua: int, **more: Any) -> Presentation:
    return Presentation(electrode, current_ua, current_ua - 2, begun_ns=0, **more)


def test_the_picture_shows_what_is_done_and_what_was_presented(
    capsys: pytest.CaptureFixture[str],
) -> None:
    facts = ArrayFacts(
        name="row", electrodes=4, x_mm=(0, 2, 4, 6), y_mm=(0, 0, 0, 0), diameter_mm=1.0
    )
    unfelt = ElectrodeLimits(threshold_ua=777, comfortable_ua=777, cap_ua=777, felt=False)
    progress = Progress(conditions=ROW, found={0: FOUND, 1: unfelt}, presentations=50)
    quiet = Screen(facts, progress, is_quiet=True)
    quiet.begin(2)
    quiet.ask(Question("strength", 2))
    quiet.heard("felt")
    quiet.found()
    told = capsys.readouterr()
    assert told.out == "", "there the answer comes, in JSON"
    assert [line.split(":")[0].split(",")[0] for line in told.err.splitlines()] == [
        "method limits",
        "2 of 4 electrodes",
    ]

    screen = Screen(facts, progress, is_quiet=False)
    for to_do, expected in (
        (2, "2 electrodes to do"),
        (1, "1 electrode to do"),
        (0, "has a result"),
    ):
        screen.begin(to_do)
        assert expected in capsys.readouterr().out
    screen.ask(Question("strength", 2))

    said = capsys.readouterr().out
    assert "# x @ ." in said
    assert "2 of 4 electrodes, 50 presentations" in said
    assert not any(figure in said for figure in ("1111", "2222", "2333", "777"))
    screen.presented(shown(2, 850))
    screen.ask(Question("strength", 2))
    assert capsys.readouterr().out.startswith("electrode 2: 850 uA\nHow strong was it?\n")

    for answer in ("not_felt", None, "pause"):
        screen.heard(answer)
    heard = capsys.readouterr().out
    assert heard == "   not felt; next presentation\n   this key is not one of the answers\n"


def test_advice_stays_on_a_screen_that_is_redrawn_and_is_printed_once_elsewhere(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    facts = ArrayFacts(
        name="row", electrodes=4, x_mm=(0, 2, 4, 6), y_mm=(0, 0, 0, 0), diameter_mm=1.0
    )
    for is_terminal, is_quiet in ((True, False), (False, False), (True, True)):
        monkeypatch.setattr(sys.stdout, "isatty", lambda it=is_terminal: it)
        screen = Screen(facts, Progress(conditions=ROW), is_quiet=is_quiet)
        screen.advise("Rest for five minutes.")
        before = capsys.readouterr()
        screen.ask(Question("strength", 2))
        screen.ask(Question("strength", 2))
        after = capsys.readouterr()
        is_redrawn = is_terminal and not is_quiet
        assert before.err == ("" if is_redrawn else "Rest for five minutes.\n")
        cleared = after.out.split("\x1b[2J")[1:]
        assert len(cleared) == (2 if is_redrawn else 0)
        assert all("Rest for five minutes." in screen for screen in cleared)
        assert is_redrawn or "Rest" not in after.out + after.err


def test_the_picture_shows_where_something_was_too_strong(
    capsys: pytest.CaptureFixture[str],
) -> None:
    facts = ArrayFacts(
        name="row", electrodes=4, x_mm=(0, 2, 4, 6), y_mm=(0, 0, 0, 0), diameter_mm=1.0
    )
    lowered_ua = {0: 2_340, 1: 777, 2: 888}
    screen = Screen(facts, Progress(conditions=ROW, found={0: FOUND}, lowered_ua=lowered_ua), False)
    screen.ask(Question("compare", 2, 0))
    screen.heard("too_strong")
    screen.ask(Question("which", 2, 0))
    screen.heard("first")
    screen.heard("second")
    said = capsys.readouterr().out
    assert "# ! @ ." in said
    assert "! too strong" in said
    assert not any(figure in said for figure in ("777", "888", "2340"))
    *_, heard, which, asked, keys, first, second = said.splitlines()
    assert heard == "   too strong", "it is asked which one, and nothing is presented"
    assert which == "first electrode 0, second electrode 2"
    assert (asked, keys) == ("Which one was too strong?", legend("which"))
    assert (first, second) == ("   first", "   second; next presentation")


def test_the_screen_says_that_it_is_asked_once_more_about_a_stop(
    capsys: pytest.CaptureFixture[str],
) -> None:
    facts = ArrayFacts(
        name="row", electrodes=4, x_mm=(0, 2, 4, 6), y_mm=(0, 0, 0, 0), diameter_mm=1.0
    )
    screen = Screen(facts, Progress(conditions=ROW), is_quiet=False)
    for question in (Question("stopped", 2), Question("stopped", 2, is_again=True)):
        screen.ask(question)
        screen.heard("felt")
        screen.heard("too_strong")
    _, first, _, felt, hurt, _, again, _, felt_again, hurt_again = (
        capsys.readouterr().out.splitlines()[-10:]
    )
    assert first.startswith("It was stopped at or after this one")
    assert again.startswith("Not too strong. Was it so?")
    assert (felt, hurt) == ("   felt", "   too strong; next presentation")
    assert felt_again == "   felt; next presentation"
    assert hurt_again == "   too strong; next presentation"
    assert max(len(first), len(again)) <= 80


@pytest.mark.parametrize("array", resources.names("arrays"))
@pytest.mark.parametrize("is_blind", [False, True])
def test_the_screen_fits_80_columns(
    array: str, is_blind: bool, capsys: pytest.CaptureFixture[str]
) -> None:
    made = load_array(resources.find("arrays", array))
    facts = ArrayFacts(
        name=array,
        electrodes=made.count,
        x_mm=made.x_mm,
        y_mm=made.y_mm,
        diameter_mm=1.0,
    )
    conditions = msgspec.structs.replace(ROW, array=array, electrodes=made.count)
    progress = Progress(
        conditions=conditions,
        found=dict.fromkeys(range(made.count - 1), FOUND),
        presentations=12_345,
    )
    screen = Screen(facts, progress, is_quiet=False, is_blind=is_blind)
    screen.begin(1)
    last, before = made.count - 1, made.count - 2
    for question in (
        Question("strength", last),
        Question("compare", last, before),
        Question("which", last, before),
    ):
        screen.presented(shown(last, 10_000, reference=before, reference_ua=9_999))
        screen.ask(question)
        for answer in (*ANSWERS[question.ask], None):
            screen.heard(answer)
    screen.found()
    said = capsys.readouterr().out
    assert max(map(len, said.splitlines())) <= 80
    assert (f"first electrode {before}: 9999 uA, second electrode {last}: 10000 uA" in said) == (
        not is_blind
    )
    assert ("uA" in said) == (not is_blind)


def test_the_help_fits_80_columns(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")
    with pytest.raises(SystemExit):
        main(["calibrate", "--help"])
    assert max(map(len, capsys.readouterr().out.splitlines())) <= 80


@pytest.mark.parametrize(
    "given",
    [
        ["P01"],
        ["P01", "--method", "equalize"],
        ["P01", "--method", "equalize", "--baseline", "P01", "--max-current-ua", "2000"],
        ["P01", "--max-current-ua", "2000", "--answers", "simulated"],
        ["P01", "--max-current-ua", "2000", "--array", "pad-8"],
        ["P01", "--max-current-ua", "2000", "--leave-out", "1-3"],
        ["P01", "--max-current-ua", "2000", "--electrodes", "1,2,3,4"],
        ["P01", "--max-current-ua", "2000", "--reference", "1"],
        ["P01", "--max-current-ua", "2000", "--fit", "--reference", "1"],
        ["P01", "--max-current-ua", "2000", "--fit", "--skin-celsius", "30"],
        ["P01", "--max-current-ua", "2000", "--fit", "--ask-sensation"],
    ],
)
def test_what_does_not_go_together_is_used_wrongly(
    given: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", *given])
    assert ended.value.code == USED_WRONGLY
    assert capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (["P 1", "--max-current-ua", "2000"], "the code, or --as: 'P 1'"),
        (["P1", "--as", "../x", "--max-current-ua", "2000"], "the code, or --as: '../x'"),
        (["P1", "--max-current-ua", "20000"], "--max-current-ua: 20000 uA"),
        (["P1", "--max-current-ua", "3001"], "50 to 3000 uA are allowed without a calibration"),
        (["P1", "--max-current-ua", "7"], "--max-current-ua: 7 uA is too low; 50 to 3000 uA are"),
        (["P1", "--max-current-ua", "2000", "--width-us", "500"], "--width-us: it says 500"),
        (["P1", "--max-current-ua", "2000", "--width-us", "0"], "--width-us: it says 0"),
        (["P1", "--max-current-ua", "2000", "--rate-hz", "500"], "--rate-hz: it says 500"),
        (["P1", "--max-current-ua", "2000", "--pulses", "90"], "90 pulses at 60 Hz last 1.50 s"),
        (["P1", "--max-current-ua", "2000", "--out", "/none/P1.toml"], "there is no such folder"),
        (["P1", "--max-current-ua", "2000", "--out", "/"], "/: it exists"),
        (
            ["P1", "--max-current-ua", "2000", "--out", "/proc/P1.toml"],
            "the folder is not writable",
        ),
        (["P1", "--max-current-ua", "2000", "--leave-out", "8"], "--leave-out: there is no elec"),
        (
            ["P1", "--max-current-ua", "2000", "--leave-out", "0,1,2,3,4,5,6,7"],
            "--leave-out: all 8 electrodes of the array are left out",
        ),
        (
            [*EQUALIZE, "--reference", "-1"],
            "--reference: there is no elec",
        ),
        (
            [*EQUALIZE, "--reference", "3", "--leave-out", "1,3"],
            "--leave-out: electrode 3 is the --reference, which is presented in every comparison;"
            " name another --reference, or none",
        ),
        (["P1", "--max-current-ua", "2000", "--returns", "ring:5"], '"all" is possible'),
    ],
)
def test_what_cannot_be_is_told_by_the_name_it_has_on_the_command_line(
    given: list[str], said: str, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["calibrate", *given, "--board", "fake", "--array", "pad-8"])
    assert ended.value.code == USED_WRONGLY
    assert said in capsys.readouterr().err


def test_what_quest_plus_needs_is_made_ready_before_a_daemon_is_asked_for_a_lease(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    """Its import takes longer than a lease lasts unkept."""
    given = ["calibrate", "P1", "--max-current-ua", "2000", "--method", "quest-plus"]
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(quest_plus, "_fresh", cache(quest_plus._fresh.__wrapped__))
    assert main(given) == 3, "there is no daemon"
    assert "is the daemon running?" in capsys.readouterr().err
    assert quest_plus._fresh.cache_info().currsize == 1
    monkeypatch.setitem(sys.modules, "questplus", None)
    assert main(given) == 1
    assert "etd[quest-plus]" in capsys.readouterr().err
