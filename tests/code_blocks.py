"""The fenced blocks of a Markdown page: what each is for, and whether an output looks as shown.

Owns: the marks that a page puts before a block, and the rules of comparing. Must not know: how a
block is run.

A block is `python`, `sh` (commands), `console` (commands after `$ `, each with what it prints), or
it is not run, and says why in the line before it: `<!-- not run: ... -->`. `<!-- runs as: ... -->`
names a command that stands for the block's only one. A python block whose first line is
`# name.py` is saved under that name, for a later command.

An output is compared with what the page shows: words as they are, numbers by being numbers, a line
`...` for any lines. What a fake board loses on a busy machine, and says, may be said.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

_FENCED = re.compile(
    r"^(?: *<!-- (?P<mark>not run|runs as): (?P<told>[^\n]+) -->\n)?"
    r"(?P<indent> *)```(?P<language>\w*)\n(?P<text>.*?)^(?P=indent)```$",
    re.MULTILINE | re.DOTALL,
)
_FENCE = re.compile(r"^ *```", re.MULTILINE)
_NAME = re.compile(r"# (\w+\.py)\n")
#: Addresses, numbers, and the spaces that align them.
_VARIES = (r"ipc://\S+", r"-?\d+(?:\.\d+)?", " +")
_VARYING = re.compile("|".join(f"({one})" for one in _VARIES))
#: In a pattern, and what a busy machine may say instead.
_BUSY = (
    (" +frames +and +", r" +frames(?: \(\d+ too late to be shown\))? +and +"),
    (r"as +asked\n", r"(?:as asked|.* of about \d+ pulses were fired.*)\n"),
)


@dataclass(frozen=True, slots=True)
class Command:
    """A command, and what the page shows below it; None: nothing is shown."""

    line: str
    shown: str | None


@dataclass(frozen=True, slots=True)
class Block:
    """`at`: file and line, for messages. `not_run`: why; `name`: of a program that is saved."""

    at: str
    language: str
    text: str
    not_run: str | None
    runs_as: str | None

    @property
    def name(self) -> str | None:
        found = _NAME.match(self.text)
        return None if found is None else found[1]

    @property
    def commands(self) -> tuple[Command, ...]:
        """Of `sh` and `console`. Without an output below it a command has to succeed."""
        if self.language == "sh":
            given = [Command(line, None) for line in self.text.splitlines()]
        else:
            parts = re.split(r"^\$ ", self.text, flags=re.MULTILINE)
            assert not parts[0], f"{self.at}: it begins with {parts[0]!r}, and not with a command"
            given = [Command(*_split(part)) for part in parts[1:]]
        if self.runs_as is None:
            return tuple(given)
        assert len(given) == 1, f"{self.at}: `runs as` stands for one command, not for {given}"
        return (Command(self.runs_as, given[0].shown),)


def _split(part: str) -> tuple[str, str | None]:
    line, _, shown = part.partition("\n")
    return line, shown or None


def blocks_of(page: Path) -> Iterator[Block]:
    """In the order of the page; fails if a fence is not understood."""
    text = page.read_text(encoding="utf-8")
    found = list(_FENCED.finditer(text))
    fences = len(_FENCE.findall(text))
    assert 2 * len(found) == fences, f"{page.name}: {fences} fences make no {len(found)} blocks"
    for one in found:
        told = {one["mark"]: one["told"]}
        line = text.count("\n", 0, one.start("language")) + 1
        yield Block(
            f"{page.name}:{line}",
            one["language"],
            re.sub(f"^{one['indent']}", "", one["text"], flags=re.MULTILINE),
            told.get("not run"),
            told.get("runs as"),
        )


def looks_as_shown(said: str, shown: str) -> bool:
    """Whether an output is what a page shows of it."""
    pattern = "".join(map(_line, shown.splitlines()))
    return re.fullmatch(pattern, _stripped(said)) is not None


def _stripped(said: str) -> str:
    return "".join(f"{line.strip()}\n" for line in said.splitlines())


def _line(shown: str) -> str:
    if shown == "...":
        return r"(?:.*\n)*?"
    line, pattern, at = shown.strip(), "", 0
    for part in _VARYING.finditer(line):
        assert part.lastindex is not None
        pattern += re.escape(line[at : part.start()]) + _VARIES[part.lastindex - 1]
        at = part.end()
    pattern += re.escape(line[at:]) + r"\n"
    for said, also in _BUSY:
        pattern = pattern.replace(said, also)
    return pattern
