"""What the system refuses, the command tells in one sentence: files, folders, standard output.

Owns: the ways in which a folder or a stream is not what it should be.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator

import pytest

from command_rig import WITHIN_S, CommandRig, command_rig

pytestmark = pytest.mark.slow


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


@pytest.fixture(scope="module")
def shared() -> Iterator[CommandRig]:
    """With a daemon that more than one test asks."""
    with command_rig() as made, made.daemon("--array", "pad-8"):
        yield made


def shell(rig: CommandRig, command: str) -> tuple[int, str]:
    """The status and standard error of `etd COMMAND` in a shell."""
    done = subprocess.run(
        ["sh", "-c", f"{sys.executable} -m etd {command}"],
        stderr=subprocess.PIPE,
        text=True,
        env=rig.environment,
        timeout=WITHIN_S,
        check=False,
    )
    return done.returncode, done.stderr


@pytest.mark.parametrize(
    ("verb", "trace", "says"),
    [
        (("demo",), "/dev/full", "No space left on device"),
        (("run", "--board", "fake"), "/nonexistent/x", "/nonexistent/x: No such file or directory"),
        (("demo",), "/", "/: Is a directory"),
    ],
)
def test_a_trace_that_cannot_be_written_is_told(
    rig: CommandRig, verb: tuple[str, ...], trace: str, says: str
) -> None:
    told = rig.run(*verb, "--seconds", "1", "--trace", trace)
    assert told.status == 1
    assert says in told.err
    assert "Traceback" not in told.err


@pytest.mark.parametrize(
    "verb",
    [
        ("run", "--config"),
        ("selftest", "--config"),
        ("safe", "--config"),
        ("run", "--board", "fake", "--array"),
    ],
    ids=" ".join,
)
def test_a_file_that_is_nested_too_deep_is_told(rig: CommandRig, verb: tuple[str, ...]) -> None:
    path = rig.folder / "deep.toml"
    path.write_text("x = " + "[" * 5_000, encoding="utf-8")
    told = rig.run(*verb, str(path))
    assert told.status in (1, 2)
    assert str(path) in told.err
    assert "Traceback" not in told.err


def test_a_runtime_folder_that_cannot_be_made_is_told(rig: CommandRig) -> None:
    rig.environment["XDG_RUNTIME_DIR"] = "/proc/nope"
    told = rig.run("run", "--board", "fake")
    assert told.status == 1
    assert told.err.count("\n") == 1
    assert "cannot be made" in told.err


# Not --help: newer argparse says nothing of help that it could not write.
@pytest.mark.parametrize("buffering", ["", "1"], ids=["buffered", "unbuffered"])
@pytest.mark.parametrize(
    "verb",
    ["check pattern.json", "check --json x", "status --json", "explain thickness --json"],
)
def test_a_full_standard_output_is_told(rig: CommandRig, verb: str, buffering: str) -> None:
    rig.environment["PYTHONUNBUFFERED"] = buffering
    status, told = shell(rig, f"{verb} >/dev/full")
    assert status == 1
    is_full(told)


@pytest.mark.parametrize("verb", ["calibration list", "calibration list --json", "status"])
def test_a_full_standard_output_is_told_where_a_daemon_has_answered(
    shared: CommandRig, verb: str
) -> None:
    status, told = shell(shared, f"{verb} >/dev/full")
    assert status == 1
    is_full(told)


def is_full(told: str) -> None:
    """One line, with what to do about it."""
    assert told.count("\n") == 1
    assert told.startswith("etd: standard output")
    assert "cannot be written (No space left on device)" in told


def test_a_closed_standard_output_does_not_keep_it_from_being_done(shared: CommandRig) -> None:
    status, told = shell(shared, "stop >&-")
    assert shared.run("status", "--json").answer["status"]["state"] == "HALTED"
    assert status == 1
    assert told == "etd: standard output is closed: the answer could not be printed\n"


def test_what_is_opened_next_does_not_become_a_closed_standard_output(rig: CommandRig) -> None:
    trace = rig.folder / "trace.jsonl"
    status, told = shell(rig, f"demo --seconds 0.5 --trace {trace} >&- 2>&- <&-")
    assert (status, told) == (1, "")
    assert [json.loads(line) for line in trace.read_text().splitlines()]


def test_a_reader_that_leaves_is_no_error_to_tell(shared: CommandRig) -> None:
    status, told = shell(shared, "monitor --json --seconds 5 | head -n 1 >/dev/null")
    assert (status, told) == (0, "")
