"""A gateway that was taken over, as another user of the machine, beside a real engine.

Owns: what it gets by naming files of its own, and files that it could have written. It needs root,
for a user of its own.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import msgspec
import pytest

from command_rig import WITHIN_S, CommandRig, command_rig
from etd.client import clock
from etd.files.calibration import load_calibration
from etd.files.calibration_folder import CalibrationFolder
from etd.files.resources import find
from etd.protocol import link
from etd.protocol.calibration_set import digest_of
from etd.protocol.link import Alive, Answer, OpenLease
from etd.protocol.opening import WantedCalibration

NEEDS_ROOT = pytest.mark.skipif(os.geteuid() != 0, reason="only root can be another user")
pytestmark = [pytest.mark.slow, NEEDS_ROOT]

GATEWAY, OPERATOR = 65_531, 65_533
CALIBRATION = load_calibration(find("calibrations", "fake-fingertip-pad-8"))


@pytest.fixture
def rig() -> Iterator[CommandRig]:
    with command_rig() as made:
        yield made


@contextmanager
def engine(rig: CommandRig) -> Iterator[Path]:
    """The engine alone; its runtime folder. The link is open to the gateway's user."""
    folder = rig.folder / "f"
    folder.mkdir()
    for place in (rig.folder, folder):
        place.chmod(0o711)
    command = rig.start(
        *("run", "--part", "engine", "--board", "fake", "--array", "pad-8"),
        *("--folder", str(folder), "--state", str(rig.folder / "state")),
    )
    sockets = link.socket_paths(folder)
    until_ns = clock.now_ns() + int(WITHIN_S * 1e9)
    while not all(path.exists() for path in sockets):
        assert command.process.poll() is None
        assert clock.now_ns() < until_ns
        clock.sleep_s(0.05)
    for path in sockets:
        os.chown(path, 0, GATEWAY)
    yield folder
    command.process.terminate()
    command.ended()


def stored(rig: CommandRig) -> Path:
    """As the service's folder is: an operator's file in a folder of root's."""
    folder = rig.folder / "state" / "calibrations"
    CalibrationFolder(folder, None).put("P01", CALIBRATION)
    path = folder / "P01.toml"
    folder.chmod(0o755)
    path.chmod(0o644)
    os.chown(path, OPERATOR, OPERATOR)
    return path


def opened(folder: Path) -> Answer:
    """The answer to a gateway of that user's, in a process of its own."""
    reading, writing = os.pipe()
    pid = os.fork()
    if not pid:
        try:
            os.close(reading)
            os.setgroups([])
            os.setresgid(GATEWAY, GATEWAY, GATEWAY)
            os.setresuid(GATEWAY, GATEWAY, GATEWAY)
            os.write(writing, msgspec.msgpack.encode(_ask(folder)))
        finally:
            os._exit(0)
    os.close(writing)
    with os.fdopen(reading, "rb") as answer:
        said = answer.read()
    os.waitpid(pid, 0)
    return msgspec.msgpack.decode(said, type=Answer)


def _ask(folder: Path) -> Answer:
    channels = link.connect(folder)
    assert channels is not None
    wanted = (WantedCalibration(name="P01"),)
    channels[0].send(OpenLease(ref=1, lease="x", client="x", calibrations=wanted))
    for _ in range(int(WITHIN_S / 0.02)):
        channels[0].send(Alive())
        clock.sleep_s(0.02)
        while (message := channels[0].receive()) is not None:
            if isinstance(message, Answer):
                return message
    raise AssertionError("no answer")


def test_it_opens_what_an_operator_has_stored_and_is_told_its_digest(rig: CommandRig) -> None:
    with engine(rig) as folder:
        stored(rig)
        answer = opened(folder)
    assert (answer.error, answer.reason) == (None, "")
    assert [taken.digest for taken in answer.calibrations] == [digest_of(CALIBRATION)]


@pytest.mark.parametrize(
    "of_its_own",
    [
        lambda path: os.chown(path, GATEWAY, GATEWAY),
        lambda path: os.chown(path.parent, GATEWAY, GATEWAY),
        lambda path: path.parent.chmod(0o777),
        lambda path: path.chmod(0o666),
    ],
)
def test_it_opens_nothing_that_it_could_have_written(
    rig: CommandRig, of_its_own: Callable[[Path], None]
) -> None:
    with engine(rig) as folder:
        of_its_own(stored(rig))
        answer = opened(folder)
    assert answer.error == "bad_calibration"
    assert "the gateway could have written this" in answer.reason
