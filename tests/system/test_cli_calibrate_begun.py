"""What `etd calibrate` says of what is kept: only where something may have been asked."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from command_rig import CommandRig, command_rig
from etd import Display
from terminal_rig import AtTerminal

pytestmark = pytest.mark.slow

LIMIT = ("--max-current-ua", "2000")
OF_FAKE = ("calibrate", "fake", "--baseline", "fake-fingertip-pad-8", "--as", "A01")
CASES = {
    "plain": ("calibrate", "P01", *LIMIT),
    "fit": (*OF_FAKE, *LIMIT, "--fit"),
    "adaptation": (*OF_FAKE, "--adaptation"),
}
KEPT = ("the same command", "has a result yet", "states that are over", "is kept")


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


def ended(rig: CommandRig, *asked: str, key: bytes = b"") -> str:
    """What it said. A key is pressed while the operator is waited for."""
    at = AtTerminal(rig, *asked)
    try:
        if key:
            at.command.line_with("waiting for the operator")
            at.press(key)
        said = at.command.ended()
    finally:
        at.close()
    assert said.status == 1, said.err
    return said.err


@pytest.mark.parametrize("how", ["wait", "arm"])
@pytest.mark.parametrize("kind", list(CASES))
def test_a_refusal_before_it_began_stands_alone(rig: CommandRig, kind: str, how: str) -> None:
    asked = CASES[kind] if how == "wait" else (*CASES[kind], "--arm")
    with rig.daemon("--array", "pad-8"):
        address = f"ipc://{rig.folder}/run/etd/main/control.sock"
        with Display(address=address, client="hold", max_current_ua=2000, width_us=100) as other:
            other.arm()
            with other.kept():
                held = ended(rig, *asked)
            other.stop()
        halted = ended(rig, *asked)
    assert "the lease is held by 'hold'" in held
    assert "halted by stop" in halted
    for said in (held, halted):
        (line,) = said.splitlines()
        assert not any(sentence in line for sentence in KEPT)


@pytest.mark.parametrize(
    ("key", "said"), [(b"q", "paused"), (b" ", "stopped: the daemon is halted, until `etd clear`")]
)
@pytest.mark.parametrize("kind", list(CASES))
def test_nor_is_it_said_where_a_key_ended_it_while_the_operator_was_waited_for(
    rig: CommandRig, kind: str, key: bytes, said: str
) -> None:
    with rig.daemon("--array", "pad-8"):
        told = ended(rig, *CASES[kind], key=key)
    assert told.splitlines()[-1] == f"etd: {said}"
