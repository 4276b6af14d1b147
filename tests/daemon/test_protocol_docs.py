"""What is published about the protocol is what the daemon does.

Owns: the schema file against the structs, the page against both, and its examples.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path
from typing import get_args

import msgspec
import pytest

from etd.protocol.errors import ErrorCode
from etd.protocol.frame import Frame
from etd.protocol.messages import REPLY_OF_OP, TOPICS, FrameReply
from etd.protocol.outcome import ClampReason
from gateway_rig import ServedRig
from protocol_schema import make_schema, schema_text

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "protocol.md").read_text()
#: Of the examples: where systemd's daemon is.
ADDRESS = "ipc:///run/etd/main/control.sock"


def test_the_published_schema_is_the_one_the_structs_make() -> None:
    assert (DOCS / "protocol.schema.json").read_text() == schema_text(), (
        "run: python tests/protocol_schema.py > docs/protocol.schema.json"
    )


def test_every_reference_in_the_schema_leads_somewhere() -> None:
    schema = make_schema()
    for name in re.findall(r"#/\$defs/(\w+)", json.dumps(schema)):
        assert name in schema["$defs"]


@pytest.mark.parametrize("word", [*REPLY_OF_OP, *TOPICS, *get_args(ErrorCode)])
def test_the_page_explains_every_op_topic_and_error(word: str) -> None:
    assert re.search(rf"^\| `{word}` \| \S", PAGE, re.MULTILINE)


def test_the_page_explains_every_key_of_a_frame() -> None:
    keys = PAGE[PAGE.index("## Frames") : PAGE.index("## Time")]
    assert [key for key in Frame.__struct_fields__ if f"`{key}`" not in keys] == []


def example(language: str) -> str:
    found = re.search(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    return found[1]


def test_the_pages_example_runs_as_it_stands(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("time.sleep", lambda _: None)
    with ServedRig() as rig:
        script = example("python").replace(ADDRESS, rig.address)
        names: dict[str, object] = {}
        exec(compile(script + "control.close()\n", "protocol.md", "exec"), names)

        assert len(rig.engine.frames) == 40
        assert rig.engine.frames[-1].frame.current_ua == (1000, 0, 0, 0)
    assert capsys.readouterr().out.count("'ok': True") == 40


def test_without_a_daemon_the_example_ends_and_says_which_address_to_give(tmp_path: Path) -> None:
    """A user's daemon has another address than the one on the page."""
    address = f"ipc://{tmp_path}/none.sock"
    script = example("python").replace(ADDRESS, address).replace("5_000", "50")
    ran = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, timeout=60, check=False
    )
    told = f"no daemon answers at {address}: give the address that `etd run` prints\n"
    assert (ran.returncode, ran.stdout, ran.stderr) == (1, "", told)


def test_the_example_in_javascript_says_the_same_of_the_same_address() -> None:
    script = example("javascript")
    assert f'"{ADDRESS}"' in script
    assert "receiveTimeout: 5000, linger: 0" in script
    assert "give the address that etd run prints" in script


def test_the_smallest_frame_and_its_reply_are_what_the_daemon_takes_and_sends() -> None:
    """Every key is of the struct, and the reply has all of them."""
    frames = PAGE[PAGE.index("## Frames") :]
    request, reply = re.findall(r"```json\n(.*?)```", frames, re.DOTALL)[:2]
    sent = json.loads(request)
    assert sent.pop("op") == "frame"
    asked = msgspec.convert(sent, Frame)
    told = msgspec.json.decode(reply, type=FrameReply)
    assert json.loads(msgspec.json.encode(told)) == json.loads(reply)
    assert told.seq == asked.seq
    assert asked.current_ua is not None
    assert told.clamped[0].wanted_ua == asked.current_ua[0]


def test_the_page_explains_every_reason_of_a_clamp() -> None:
    for reason in get_args(ClampReason):
        assert re.search(rf"^\| `{reason}` \| \S", PAGE, re.MULTILINE), reason
