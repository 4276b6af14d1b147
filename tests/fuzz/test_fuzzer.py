"""The fuzzer itself: what it finds, keeps and says, and for which decoders it was last clean."""

from __future__ import annotations

import resource
import sys
from pathlib import Path

import pytest

from fuzz import run, stored
from fuzz.choices import Choices
from fuzz.minimised import minimise
from fuzz.mutation import Mutator, words
from fuzz.target import OverBound, Target, play
from fuzz.targets import TARGETS

BROKEN = """
from fuzz.target import Target

def broken(data):
    if b"level" in data and len(data) % 2:
        raise KeyError("no such level")

TARGETS = (Target("broken", "a decoder with a fault", broken, lambda: [b"a level"], ("Makefile",)),)
"""


def target(made: object = None, **fields: object) -> Target:
    given = {
        "name": "made",
        "about": "",
        "play": lambda _: None,
        "seeds": lambda: [b""],
        "decoders": ("Makefile",),
        **fields,
    }
    return Target(**given)  # type: ignore[arg-type]


def test_names_are_unique_and_each_decoder_is_there() -> None:
    assert len({one.name for one in TARGETS}) == len(TARGETS)
    for one in TARGETS:
        assert len(stored.digest(one)) == 16
        assert list(one.seeds())
        assert max(map(len, one.seeds())) <= one.most_bytes


def test_a_folder_of_kept_inputs_is_a_targets() -> None:
    names = {path.name for path in stored.KEPT.iterdir()}
    assert names <= {one.name for one in TARGETS}


def test_a_fault_is_found_kept_with_its_reason_and_can_be_played_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "broken_target.py").write_text(BROKEN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (broken,) = __import__("broken_target").TARGETS
    folder = tmp_path / "kept"

    outcome = run.fuzz(broken, 20, folder, seed=1, is_guided=False)

    (found,) = outcome.findings
    assert b"level" in found.read_bytes()
    with pytest.raises(KeyError, match="no such level"):
        play(broken, found.read_bytes())
    run.show([outcome])
    said = capsys.readouterr().out
    assert "no such level" in said
    assert f"broken --play {found}" in said
    (told,) = run.figures([outcome], is_guided=False)["targets"]
    assert (told["target"], told["findings"]) == ("broken", [str(found)])
    assert told["inputs"] == outcome.executions
    assert run.fuzz(broken, 20, folder, seed=1, is_guided=False).findings == [found]


def test_what_takes_too_long_or_too_much_is_a_finding() -> None:
    def slow(_: bytes) -> None:
        sum(range(3_000_000))

    # More than this process has ever had at once, whatever else it has played.
    pages = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 4 + 50_000

    def large(_: bytes) -> None:
        bytearray(pages * 4096)[::4096] = b"x" * pages

    with pytest.raises(OverBound, match=r"at most 0\.001 s"):
        play(target(play=slow, most_s=0.001), b"")
    with pytest.raises(OverBound, match="kB for 1 bytes"):
        play(target(play=large, most_s=60.0), b"x")


def test_time_is_shared_by_what_each_needs() -> None:
    shares = run.shares_s([target(name="a"), target(name="b", shares=3)], 400)
    assert shares == {"a": 100, "b": 300}
    assert sum(run.shares_s(TARGETS, 600).values()) >= 600


def test_what_has_changed_gets_a_minute_each_and_ten_together() -> None:
    same, other, large = target(name="a"), target(name="b"), target(name="c", shares=18)
    every = [same, other, large]
    assert run.planned_s(every, [], 60) == {"a": 3, "b": 3, "c": 54}
    assert run.planned_s(every, [other], 60) == {"a": 3, "b": 600, "c": 54}
    assert run.planned_s(every, [other, large], 60) == {"a": 3, "b": 60, "c": 569}
    assert run.planned_s(every, [other], 40_000)["b"] == 2_000, "never less than its share"
    for changed in ([one] for one in TARGETS), (TARGETS,):
        for few in changed:
            assert run.is_enough(run.planned_s(TARGETS, few, 60), few)


def test_what_was_fuzzed_for_less_is_not_known_to_be_clean() -> None:
    one, other = target(name="a"), target(name="b")
    assert run.is_enough({"a": 60, "b": 540}, [one, other])
    assert not run.is_enough({"a": 59, "b": 600}, [one, other])
    assert not run.is_enough({"a": 60, "b": 539}, [one, other])
    assert not run.is_enough({"a": 599, "b": 600}, [one])


def test_a_changed_decoder_is_known_until_it_was_fuzzed(tmp_path: Path) -> None:
    note, one, other = tmp_path / "fuzzed.txt", target(name="a"), target(name="b")
    assert stored.changed([one, other], note) == [one, other]
    stored.note_fuzzed([one], note)
    assert stored.changed([one, other], note) == [other]
    stored.note_fuzzed([other], note)
    assert stored.changed([one, other], note) == []
    elsewhere = target(name="a", decoders=("LICENSE",))
    assert stored.changed([elsewhere], note) == [elsewhere]


def test_a_decoder_that_is_no_file_is_told() -> None:
    with pytest.raises(FileNotFoundError, match="names no file"):
        stored.digest(target(decoders=("daemon/etd/nowhere.py",)))


def test_the_same_seed_makes_the_same_inputs() -> None:
    seeds = [b'{"op": "stop"}', b"electrode = [\n]"]
    first, second, other = (Mutator(seeds, 64, seed) for seed in (1, 1, 2))
    made = [first.next() for _ in range(50)]
    assert made == [second.next() for _ in range(50)]
    assert made != [other.next() for _ in range(50)]
    assert max(map(len, made)) <= 64
    assert {b"stop", b"electrode"} <= set(words(seeds))


def test_choices_are_those_of_the_bytes_and_the_first_where_none_are_left() -> None:
    choices = Choices(b"\x05\x01\x02\xff")
    assert choices.number(10, 12) == 12
    assert choices.number(0, 999) == 0x201
    assert choices.pick("abc") == "a"
    assert choices.is_over
    assert (choices.number(7, 9), choices.is_so(), choices.piece()) == (7, False, b"")


MERGES = """
import shutil, sys
from pathlib import Path
program, how, smaller, corpus = sys.argv[sys.argv.index("--merge") + 1 :]
assert how == "-merge=1" and Path(program).exists()
shutil.copy(min(Path(corpus).iterdir()), smaller)
sys.exit({status})
"""


@pytest.mark.parametrize(("status", "left"), [(0, {"a"}), (1, {"a", "b"})])
def test_a_corpus_is_replaced_by_a_smaller_one_if_that_was_made(
    tmp_path: Path, status: int, left: set[str]
) -> None:
    worker = tmp_path / "worker.py"
    worker.write_text(MERGES.format(status=status))
    stored.written(tmp_path / "corpus" / "made", [])
    for name in ("a", "b"):
        (tmp_path / "corpus" / "made" / name).write_text(name)

    command = [sys.executable, str(worker)]
    is_smaller = minimise("made", tmp_path, command, tmp_path / "made.log")

    assert is_smaller == (status == 0)
    assert {path.name for path in (tmp_path / "corpus" / "made").iterdir()} == left


def test_a_guided_worker_keeps_a_finding_too(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pytest.importorskip("atheris", reason="there is no wheel for every machine")
    (tmp_path / "broken_too.py").write_text(BROKEN)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    (broken,) = __import__("broken_too").TARGETS

    outcome = run.fuzz(broken, 60, tmp_path / "kept", seed=1, is_guided=True)

    (found,) = outcome.findings
    with pytest.raises(KeyError, match="no such level"):
        play(broken, found.read_bytes())
