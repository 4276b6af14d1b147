"""What is published about the protocol is what the daemon does.

Owns: the schema file against the structs, the page against both, and its example, run.
"""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import get_args

import pytest

from etd.protocol.errors import ErrorCode
from etd.protocol.frame import Frame
from etd.protocol.messages import REPLY_OF_OP, TOPICS
from gateway_rig import ServedRig
from protocol_schema import make_schema, schema_text

DOCS = Path(__file__).parents[2] / "docs"
PAGE = (DOCS / "protocol.md").read_text()


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


def test_the_pages_example_runs_as_it_stands(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    found = re.search(r"```python\n(.*?)```", PAGE, re.DOTALL)
    assert found is not None
    monkeypatch.setattr("time.sleep", lambda _: None)
    with ServedRig() as rig:
        script = found[1].replace("ipc:///run/etd/main/control.sock", rig.address)
        names: dict[str, object] = {}
        exec(compile(script + "control.close(linger=0)\n", "protocol.md", "exec"), names)

        assert len(rig.engine.frames) == 40
        assert rig.engine.frames[-1].frame.current_ua == (1000, 0, 0, 0)
    assert "'ok': False" not in capsys.readouterr().out
