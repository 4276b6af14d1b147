"""The blocks of the pages that a newcomer types from: as they stand there, in their order, beside
a fake daemon.
"""

from __future__ import annotations

import re
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from code_blocks import Block, Command, blocks_of, looks_as_shown
from command_rig import WITHIN_S, CommandRig, command_rig
from etd.cli import VERBS

pytestmark = pytest.mark.slow

CLONE = Path(__file__).parents[2]
DOCS = CLONE / "docs"
README = CLONE / "README.md"
TUTORIAL = DOCS / "tutorial.md"
#: What its commands draw.
FINGERTIP = DOCS / "plots" / "tutorial-calibration.svg"
PAGES = (TUTORIAL, README, DOCS / "client.md", DOCS / "install.md")
#: The tests' own daemon stands for it, one for each page.
DAEMON = "etd run --board fake"
#: No lease lapses because the machine is busy.
PATIENT = ("--timeout-factor", "10")
#: What a program says that is not saved: when its first pulse was fired.
FELT = "2026-11-23 08:27:08.098411+00:00 as asked\n"


class Reader:
    """Types what the pages say, in a folder of its own."""

    def __init__(self, rig: CommandRig, daemon_said: str) -> None:
        self._daemon_said = daemon_said
        self.folder = rig.folder / "first-hour"
        self.folder.mkdir()
        path = f"{Path(sys.executable).parent}:{rig.environment['PATH']}"
        self._environment = {**rig.environment, "PATH": path, "TZ": "UTC"}

    def types(self, block: Block) -> None:
        if block.language != "python":
            for command in block.commands:
                self._enters(block.at, command)
        elif block.name is not None:
            (self.folder / block.name).write_text(block.text, encoding="utf-8")
        else:
            status, said = self._runs([sys.executable, "-c", block.text])
            assert (status, looks_as_shown(said, FELT)) == (0, True), f"{block.at} said\n{said}"

    def _enters(self, at: str, command: Command) -> None:
        if command.line == DAEMON:
            status, said = 0, self._daemon_said
        else:
            status, said = self._runs(["sh", "-c", command.line])
        if command.shown is None:
            assert (status, said) == (0, ""), f"{at}: `{command.line}` said\n{said}"
        else:
            is_alike = looks_as_shown(said, command.shown)
            assert is_alike, f"{at}: `{command.line}` said\n{said}and not\n{command.shown}"

    def _runs(self, words: list[str]) -> tuple[int, str]:
        ran = subprocess.run(
            words,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            stdin=subprocess.DEVNULL,
            text=True,
            env=self._environment,
            cwd=self.folder,
            timeout=WITHIN_S,
            check=False,
        )
        return ran.returncode, ran.stdout


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_block_runs_and_prints_what_its_page_shows(page: Path) -> None:
    # A daemon for each page: pulses of one polarity that another page's programs fired a moment
    # ago, faster than any reader types, would still count against these.
    with command_rig() as rig:
        daemon = rig.start("run", "--board", "fake", *PATIENT)
        reader = Reader(rig, daemon.line())
        for block in blocks_of(page):
            if block.not_run is None:
                reader.types(block)
        daemon.signal(signal.SIGTERM)
        assert daemon.ended().status == 0
        if page == TUTORIAL:
            drawn = (reader.folder / "fingertip.svg").read_bytes()
            assert drawn == FINGERTIP.read_bytes(), "draw it anew, as docs/tutorial.md says"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: page.name)
def test_every_block_is_run_or_says_why_not(page: Path) -> None:
    blocks = list(blocks_of(page))
    assert blocks
    run = [block for block in blocks if block.not_run is None]
    unknown = [block.at for block in run if block.language not in ("python", "sh", "console")]
    assert unknown == [], "a language that is run, or <!-- not run: why --> in the line before"
    typed = " ".join(
        command.line for block in run if block.language != "python" for command in block.commands
    )
    named = {block.name for block in run if block.language == "python"} - {None}
    assert [name for name in sorted(map(str, named)) if f"python {name}" not in typed] == []


def test_the_pictures_of_the_tutorial_are_there() -> None:
    pictures = re.findall(r"!\[.*\]\((.*)\)", TUTORIAL.read_text("utf-8"))
    assert len(pictures) == 2
    assert [picture for picture in pictures if not (DOCS / picture).is_file()] == []


def test_the_list_of_verbs_names_them_all() -> None:
    listed = next(block for block in blocks_of(README) if block.text.startswith("etd run "))
    # Of a line of two columns each may have several verbs: "etd arm, disarm".
    columns = re.findall(r"etd ([a-z]+(?:, [a-z]+)*)(?=  |$)", listed.text, re.MULTILINE)
    assert sorted(", ".join(columns).split(", ")) == sorted(VERBS)


SHOWN = "drew  a.svg: 10 frames, 0.875 s\n...\nlast: 3 uA, as asked\n"


@pytest.mark.parametrize(
    ("said", "is_alike"),
    [
        ("drew  a.svg: 9 frames, 12 s\nlast: 31 uA, as asked\n", True),
        ("drew a.svg: 9 frames, 12 s\none\ntwo\n  last:   -3.5 uA, as asked\n", True),
        ("drew a.svg: 9 frames, 12 s\nlast: 3 uA, 4 of about 30 pulses were fired\n", True),
        ("drew a.svg: no frames, 12 s\nlast: 31 uA, as asked\n", False),
        ("drew a.svg: 9 frames, 12 s\nlast: 31 uA, not as it was\n", False),
        ("drew a.svg: 9 frames, 12 s\n", False),
        ("", False),
    ],
)
def test_an_output_is_compared_by_its_words(said: str, is_alike: bool) -> None:
    assert looks_as_shown(said, SHOWN) is is_alike


@pytest.mark.parametrize("page", ["```python\nx = 1\n", "```python\nx\n```\n   ```\n"])
def test_a_fence_that_is_not_closed_is_told(tmp_path: Path, page: str) -> None:
    (tmp_path / "page.md").write_text(page)
    with pytest.raises(AssertionError, match="fences"):
        list(blocks_of(tmp_path / "page.md"))
