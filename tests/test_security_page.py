"""SECURITY.md and docs/safety.md say the same of what each party can do, phrase by phrase."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

CLONE = Path(__file__).resolve().parents[1]
SAFETY = (CLONE / "docs" / "safety.md").read_text(encoding="utf-8")
SECURITY = (CLONE / "SECURITY.md").read_text(encoding="utf-8")
#: By party: what it can, and what it cannot.
Parties = dict[str, tuple[list[str], list[str]]]
#: Without these no page says who is feared.
_NAMED = ("a client", "etd-users", "an operator", "the gateway", "the process that parses",
          "the engine", "etd-operators", "root")  # fmt: skip


def section(page: str, title: str) -> str:
    _, _, after = page.partition(f"## {title}\n")
    return after.partition("\n## ")[0]


def phrases(text: str) -> list[str]:
    """Without line breaks, and without where links go."""
    plain = re.sub(r"\]\([^)]*\)", "", " ".join(text.split())).replace("[", "")
    return [phrase.strip() for phrase in plain.split(";")]


def of_safety() -> Parties:
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")]
        for line in section(SAFETY, "Who can do what, at most").splitlines()
        if line.startswith("|")
    ][2:]
    assert len({who for who, _, _ in rows}) == len(rows)
    return {who: (phrases(can), phrases(cannot)) for who, can, cannot in rows}


def of_security() -> Parties:
    text = section(SECURITY, "What each party can do at most")
    found = re.findall(
        r"^- \*\*(.+?)\*\*\n  - can: (.+?)\n  - cannot: (.+?)(?=\n-|\Z)", text, re.M | re.S
    )
    assert len(found) == text.count("\n- **"), "a party without what it can and cannot"
    return {who: (phrases(can), phrases(cannot)) for who, can, cannot in found}


def _begins(long: str, short: str) -> bool:
    """Cut where a reason may begin, and not within what is said."""
    rest = long.removeprefix(short).lstrip()
    return long.startswith(short) and (not rest or rest[0] in ":,(;")


def test_both_pages_have_the_same_parties() -> None:
    assert list(of_security()) == list(of_safety())
    for party in _NAMED:
        assert any(party in who for who in of_safety()), party


@pytest.mark.parametrize("who", of_safety())
def test_what_a_party_can_and_cannot_is_the_same_on_both(who: str) -> None:
    """SECURITY.md has the beginning of each phrase, and leaves out its reasons."""
    for long, short in zip(of_safety()[who], of_security()[who], strict=True):
        assert [b for a, b in zip(long, short, strict=True) if not _begins(a, b)] == []
        assert all(short)
