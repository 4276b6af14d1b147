"""`make mutants` itself: which mistakes it makes, what counts as found, and what it remembers."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from mutants import fork
from mutants.account import Account
from mutants.judging import Baseline, Outcome
from mutants.mistakes import Mutated

pytestmark = pytest.mark.slow

TESTS = Path(__file__).parent
MODULE = "daemon/made.py"

#: Each line has a mistake that its tests below find in another way, or do not.
SOURCE = '''\
"""Made for these tests."""

import functools
import math

MOST = 10


def bounded(asked: int, most: int = MOST) -> int:
    """Not above the most."""
    if asked > most:
        raise ValueError(f"{asked} is above {most}: ask for less")
    return asked


def steps(count: int) -> int:
    done = 0
    while done < count:
        done += 1
    return done


@functools.cache
def area(radius: int) -> float:
    return math.pi * radius * radius


class Unasked:
    def never(self) -> int:
        return 1 + 2
'''
TEST = """\
import pytest
from hypothesis import given, settings, strategies as st

from made import Unasked, area, bounded, steps

UNIT = area(1)
SEEN = []


def test_what_is_asked_for_is_bounded():
    assert bounded(9) == 9
    with pytest.raises(ValueError):
        bounded(11)


@pytest.mark.parametrize("count", [0, 3])
def test_it_takes_so_many_steps(count):
    assert steps(count) == count


def test_a_circle_of_one_has_the_area_pi():
    assert 3.14 < UNIT < 3.15


@settings(max_examples=1000)
@given(st.integers(1, 10))
def test_few_examples_are_drawn(count):
    SEEN.append(count)
    assert steps(count) == count


def test_that_they_were_few():
    assert len(SEEN) <= 20


def test_never_is_never_asked_for():
    assert Unasked()
"""
#: What none of them finds: a bound that is met, a circle that is not of one, and what no test
#: comes by.
AREA = "area | return math.pi * radius * radius |"
UNSEEN = {
    f"{AREA} math.pi * radius -> math.pi / radius",
    f"{AREA} math.pi * radius * radius -> math.pi * radius / radius",
    "bounded | if asked > most: | asked > most -> asked >= most",
    "Unasked.never | return 1 + 2 | 1 + 2 -> None",
    "Unasked.never | return 1 + 2 | 1 + 2 -> 1 - 2",
    "Unasked.never | return 1 + 2 | 1 -> 2",
    "Unasked.never | return 1 + 2 | 2 -> 3",
}


class Tree:
    """A small project, and the tool run on it as `make mutants` runs it."""

    def __init__(self, root: Path) -> None:
        self.root = root
        self.folder = root / "tests" / "mutants"
        self.folder.mkdir(parents=True)
        (root / "daemon").mkdir()
        (root / "pyproject.toml").write_text("[tool.pytest.ini_options]\n")
        (root / MODULE).write_text(SOURCE)
        (root / "tests" / "test_made.py").write_text(TEST)
        (self.folder / "modules.toml").write_text(f'"{MODULE}" = ["tests/test_made.py"]\n')

    def run(self, *arguments: str) -> tuple[int, list[dict[str, Any]]]:
        code = (
            "import sys; from pathlib import Path; from mutants.run import main;"
            " sys.exit(main(sys.argv[2:], Path(sys.argv[1])))"
        )
        told = subprocess.run(
            [sys.executable, "-c", code, str(self.root), "--json", *arguments],
            env={**os.environ, "PYTHONPATH": str(TESTS)},
            capture_output=True,
            text=True,
            check=False,
        )
        assert told.stdout, told.stderr
        return told.returncode, json.loads(told.stdout)

    def explain(self, *names: str) -> None:
        lines = [f"{json.dumps(name)} = 'It is so.'" for name in names]
        text = "\n".join([f'["{MODULE}"]', *lines])
        (self.folder / "survivors.toml").write_text(text)

    @property
    def outcomes(self) -> Path:
        (path,) = (self.root / "build" / "mutants").glob("*.jsonl")
        return path


@pytest.fixture
def tree(tmp_path: Path) -> Tree:
    return Tree(tmp_path)


def test_what_no_test_finds_is_told_and_what_is_found_is_by_which_test(tree: Tree) -> None:
    status, (verdict,) = tree.run()
    assert (status, set(verdict["unexplained"])) == (1, UNSEEN)
    assert verdict["gaps"] == ["line 30"]
    told = [json.loads(line) for line in tree.outcomes.read_text().splitlines()[1:]]
    how = {one["name"]: (one["how"], one["by"]) for one in told}
    assert how["steps | done += 1 | done += 1 -> pass"][0] == "time"
    assert how["bounded | if asked > most: | asked > most -> False"] == (
        "found",
        "tests/test_made.py::test_what_is_asked_for_is_bounded",
    )
    # What was computed while the tests were loaded is computed with the mistake.
    assert how[f"{AREA} math.pi * radius * radius -> None"][0] == "found"
    assert how["module | MOST = 10 | 10 -> 11"][0] == "found"
    assert how["Unasked.never | return 1 + 2 | 1 -> 2"] == ("not reached", "")


def test_explanations_and_survivors_are_the_same_or_it_fails(tree: Tree) -> None:
    _, (verdict,) = tree.run()
    (tree.root / MODULE).write_text(SOURCE.partition("class Unasked")[0])
    test = tree.root / "tests" / "test_made.py"
    test.write_text(TEST.partition("def test_never")[0].replace("Unasked, ", ""))
    unseen = [one for one in verdict["unexplained"] if not one.startswith("Unasked")]
    tree.explain(*unseen, "bounded | gone | 1 -> 2")
    status, (verdict,) = tree.run()
    assert (status, verdict["unexplained"]) == (1, [])
    assert verdict["needless"] == ["bounded | gone | 1 -> 2"]
    tree.explain(*unseen)
    assert tree.run()[0] == 0
    assert tree.run("--changed") == (0, [])
    # A branch that no test takes makes it fail as well; the digest is that of other sources.
    test.write_text(test.read_text() + "\n")
    status, (verdict,) = tree.run("--changed", "--coverage")
    assert (status, verdict["gaps"], verdict["is_whole"]) == (0, [], True)
    status, (verdict,) = tree.run("--coverage")
    assert (status, verdict["is_whole"]) == (0, False)


def test_a_run_goes_on_where_it_was_cut_and_a_failing_test_is_no_judge(tree: Tree) -> None:
    _, (verdict,) = tree.run()
    whole = tree.outcomes.read_text().splitlines(keepends=True)
    forged = next(line for line in whole if '"found"' in line).replace('"found"', '"survived"')
    tree.outcomes.write_text("".join([whole[0], forged, whole[1][:20]]))
    status, (again,) = tree.run()
    # The one that was there already was believed, and the one that was cut was tried again.
    assert sum(again["how"].values()) == verdict["mutants"]
    assert len(again["unexplained"]) == len(verdict["unexplained"]) + 1
    # Of some of them nothing follows for the module.
    status, (some,) = tree.run("made", "--only", "steps |")
    assert (status, some["unexplained"], some["gaps"]) == (1, [], ["line 30"])
    assert 0 < some["mutants"] < verdict["mutants"]
    assert "made" not in (tree.folder / "digests.toml").read_text().replace("`make", "")
    (tree.root / "tests" / "test_made.py").write_text(TEST.replace("== 9", "== 8"))
    status, (verdict,) = tree.run()
    assert status == 2
    assert "test_what_is_asked_for_is_bounded" in verdict["unfit"]


# --- mistakes ------------------------------------------------------------------------------------


def became(source: str) -> set[str]:
    """What a source's mistakes are, without where they are."""
    return {one.name.rpartition(" | ")[2] for one in Mutated(source, "made.py").mutants}


@pytest.mark.parametrize(
    ("line", "mistakes"),
    [
        ("a = b < 0", {"b < 0 -> b <= 0", "0 -> 1", "a = b < 0 -> pass"}),
        ("return not b", {"not b -> b", "not b -> None"}),
        ("return True", {"True -> False"}),
        (
            "return b and c",
            {"b and c -> b or c", "b and c -> b", "b and c -> c", "b and c -> None"},
        ),
        ("return min(b, c)", {"min -> max", "min(b, c) -> None"}),
        ("return -b // c", {"-b // c -> -b / c", "-b -> b", "-b // c -> None"}),
        ("b += c", {"b += c -> b -= c", "b += c -> pass"}),
        ("b.c(d)", {"b.c(d) -> pass"}),
        ("raise Refused('no_lease', 'there is none')", None),
        ("if b: c()", {"b -> True", "b -> False", "c() -> pass"}),
        ("while b: break", {"b -> False", "break -> continue"}),
        ("return f'{b + 1} is too much'", None),
    ],
)
def test_the_mistakes_of_a_line(line: str, mistakes: set[str] | None) -> None:
    found = became(f"def made(a, b, c):\n    a = 0\n    {line}\n") - {"0 -> 1", "a = 0 -> pass"}
    if line.startswith("raise"):
        mistakes = {f"{line} -> pass", "'no_lease' -> 'no_lease-other'"}
    elif line.startswith("return f"):
        mistakes = {"b + 1 -> b - 1", "1 -> 2", "f'{b + 1} is too much' -> None"}
    assert mistakes is not None
    assert found == mistakes - {"0 -> 1"}


def test_words_annotations_and_what_only_type_checkers_read_are_left_as_they_are() -> None:
    source = '''
"""Words: 1 < 2."""
from typing import TYPE_CHECKING
if TYPE_CHECKING:
    import os
__slots__ = ("one", "two")
def made(a: "int | 1") -> "int | 2":
    """Words."""
'''
    assert became(source) == set()


def test_a_name_outlives_an_edit_elsewhere_and_two_of_the_same_are_counted() -> None:
    source = "def made(a):\n    a(1)\n    a(1)\n"
    names = [one.name for one in Mutated(source, "made.py").mutants]
    assert names == [
        *("made | a(1) | a(1) -> pass", "made | a(1) | 1 -> 2"),
        *("made | a(1) | a(1) -> pass #2", "made | a(1) | 1 -> 2 #2"),
    ]
    after = Mutated(f"import os\n\n\ndef other():\n    pass\n\n\n{source}", "made.py").mutants
    assert [one.name for one in after] == names


def test_each_mistake_is_made_alone() -> None:
    mutated = Mutated("ONE = 1\nTWO = 2\n", "made.py")
    made = []
    for mutant in [*mutated.mutants, None]:
        found: dict[str, int] = {}
        exec(mutated.compiled(mutant), found)
        made.append((found["ONE"], found["TWO"]))
    assert made == [(2, 2), (1, 3), (1, 2)]


# --- forks ---------------------------------------------------------------------------------------


def test_a_fork_that_waits_for_itself_or_takes_all_memory_is_ended() -> None:
    def wait() -> int:
        signal.pause()
        return 0

    def take() -> int:
        return len(bytearray(1 << 40))

    assert fork.ending(wait, looks=1) == fork.STALLED
    assert fork.ending(take) == fork.BROKEN


def test_a_fork_tells_as_it_goes_and_one_that_breaks_down_is_an_error(tmp_path: Path) -> None:
    def work(tell: fork.Tell) -> None:
        tell({"one": 1})
        raise KeyError("broken")

    told = fork.telling(work, tmp_path / "log")
    assert next(told) == {"one": 1}
    with pytest.raises(RuntimeError, match="status 1"):
        next(told)
    assert "broken" in (tmp_path / "log").read_text()


# --- what is remembered --------------------------------------------------------------------------


def test_a_digest_is_of_the_module_its_tests_their_rigs_and_the_names_explained(tree: Tree) -> None:
    rig = tree.root / "tests" / "made_rig.py"
    rig.write_text("")
    test = tree.root / "tests" / "test_made.py"
    test.write_text("import made_rig\n")
    seen = set()
    for path in (rig, test, tree.root / MODULE, tree.root / "README"):
        seen.add(Account(tree.root, tree.root).digest(MODULE))
        path.write_text(path.read_text() + "\n" if path.exists() else "")
    tree.explain("one")
    seen.add(Account(tree.root, tree.root).digest(MODULE))
    assert len(seen) == 5


def test_an_explanation_of_a_module_that_is_not_judged_is_refused(tree: Tree) -> None:
    (tree.folder / "survivors.toml").write_text('["other.py"]\n"a" = "b"\n')
    with pytest.raises(ValueError, match=r"other\.py"):
        Account(tree.root, tree.root)


def test_what_is_kept_is_read_again(tree: Tree) -> None:
    account = Account(tree.root, tree.root)
    baseline = Baseline({"a": 0.5}, {3: ["a"]}, frozenset({1, 2}), ["line 4"])
    outcome = Outcome("one", "found", "a")
    account.keep_baseline(MODULE, baseline)
    account.keep(MODULE, outcome)
    assert Account(tree.root, tree.root).kept(MODULE) == (baseline, [outcome])
