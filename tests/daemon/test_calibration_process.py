"""The process that reads calibrations: real ones, and what is in the place of a file.

Owns: that only a file which the gateway's user could not have written is taken, that a bad one
costs a refusal and nothing else, and that nothing here waits. Most need root, who alone can give a
file away.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TypeVar

import msgspec
import pytest

from etd.client import clock
from etd.files import calibration_reading
from etd.files.calibration import load_calibration, to_toml
from etd.files.calibration_folder import MOST_FILE_BYTES
from etd.files.calibration_process import CalibrationProcess
from etd.files.resources import find
from etd.protocol.calibration import Calibration
from etd.protocol.errors import Refused
from etd.protocol.peer import Peer

pytestmark = pytest.mark.slow

SHIPPED = find("calibrations", "fake-fingertip").parent
CALIBRATION = load_calibration(find("calibrations", "fake-fingertip"))
#: The gateway's user and groups, as those of a service.
GATEWAY = Peer(65_531, (65_531, 65_532))
OPERATOR, OPERATORS = 65_533, 65_534
ME = Peer(os.geteuid(), (os.getegid(),))
#: None of the calls may take longer: a poll of the engine is due each millisecond while nothing
#: is fired, and a stall is 50 ms. A busy machine is slower.
MOST_CALL_S = 0.25
WITHIN_S = 60.0
T = TypeVar("T")
needs_root = pytest.mark.skipif(os.geteuid() != 0, reason="only root can give a file away")


@pytest.fixture
def folder() -> Iterator[Path]:
    """Laid out as the service's: root's, written by the operators."""
    with tempfile.TemporaryDirectory(prefix="etd-") as made:
        path = Path(made) / "calibrations" / "main"
        path.mkdir(parents=True)
        if os.geteuid() == 0:
            os.chown(path, 0, OPERATORS)
            path.chmod(0o2775)
        put(path)
        yield path


def put(folder: Path, name: str = "p01") -> Path:
    path = folder / f"{name}.toml"
    path.write_text(to_toml(CALIBRATION))
    path.chmod(0o644)
    if os.geteuid() == 0:
        os.chown(path, OPERATOR, OPERATORS)
    return path


def read(
    folder: Path,
    gateway: Peer | None = GATEWAY,
    *names: str,
    shipped: Path | None = None,
    module: str = "etd.files.calibration_reading",
) -> tuple[Calibration, ...]:
    """As the engine's loop has it. Raises: Refused."""
    reader = CalibrationProcess(folder, shipped, None, module)
    try:
        timed(lambda: reader.begin(names or ("p01",), gateway))
        until_ns = clock.now_ns() + int(WITHIN_S * 1e9)
        while (found := timed(reader.result)) is None:
            assert clock.now_ns() < until_ns
            clock.sleep_s(0.001)
        return found
    finally:
        reader.end()


def timed(call: Callable[[], T]) -> T:
    begun_ns = clock.now_ns()
    try:
        return call()
    finally:
        assert clock.now_ns() - begun_ns < MOST_CALL_S * 1e9


def refused(folder: Path, gateway: Peer | None = GATEWAY, *names: str) -> str:
    with pytest.raises(Refused) as told:
        read(folder, gateway, *names)
    assert told.value.code == "bad_calibration"
    return told.value.reason


@needs_root
def test_what_an_operator_has_stored_is_read_in_the_order_of_the_names(folder: Path) -> None:
    put(folder, "p02")
    assert read(folder, GATEWAY, "p02", "p01") == (CALIBRATION, CALIBRATION)


@pytest.mark.parametrize("asker", [ME, None], ids=["the engine", "the gateway, to show it"])
@pytest.mark.parametrize(("mode", "who"), [(0o666, "everybody"), (0o664, "the group 65534")])
@needs_root
def test_where_all_is_one_users_a_file_that_others_could_write_is_not_read(
    folder: Path, mode: int, who: str, asker: Peer | None
) -> None:
    folder.chmod(0o750)
    os.chown(folder, 0, 0)
    path = folder / "p01.toml"
    os.chown(path, 0, OPERATORS)
    path.chmod(mode)
    assert f"{who} may write it" in refused(folder, asker)
    path.chmod(0o644)
    assert read(folder, asker) == (CALIBRATION,)
    os.chown(path, OPERATOR, 0)
    assert f"belongs to user {OPERATOR}" in refused(folder, asker)


@pytest.mark.parametrize("asker", [ME, None], ids=["the engine", "the gateway, to show it"])
def test_where_all_is_one_users_its_own_files_are_read(folder: Path, asker: Peer | None) -> None:
    folder.chmod(0o750)
    if os.geteuid() == 0:
        os.chown(folder, 0, 0)
        os.chown(folder / "p01.toml", 0, 0)
    assert read(folder, asker) == (CALIBRATION,)
    folder.chmod(0o777)
    assert "everybody may write into this folder" in refused(folder, asker)


def test_shipped_ones_are_beneath_and_only_where_they_may_be_named(folder: Path) -> None:
    name = "fake-fingertip"
    nowhere = folder / "nowhere"
    assert read(nowhere, GATEWAY, name, shipped=SHIPPED) == (CALIBRATION,)
    with pytest.raises(Refused, match="No such file") as told:
        read(folder, ME if os.geteuid() else GATEWAY, name)
    assert told.value.code == "not_found"


# --- whose it is ------------------------------------------------------------------------------


def for_its_group(path: Path) -> None:
    os.chown(path, 0, 65_532)
    path.chmod(0o664)


@needs_root
@pytest.mark.parametrize(
    ("spoil", "said"),
    [
        (lambda path: os.chown(path, GATEWAY.uid, 0), "it belongs to user 65531"),
        (lambda path: path.chmod(0o646), "everybody may write it"),
        (lambda path: for_its_group(path), "the group 65532 may write"),
        (lambda path: os.chown(path.parent, GATEWAY.uid, 0), "it belongs to user 65531"),
        (lambda path: os.chown(path.parent, 0, 65_532), "the group 65532 may write it"),
        (lambda path: path.parent.chmod(0o777), "everybody may write it"),
        (lambda path: os.chown(path.parent.parent, GATEWAY.uid, 0), "it belongs to user 65531"),
        (lambda path: path.parent.parent.chmod(0o777), "everybody may write it"),
    ],
)
def test_what_the_gateway_could_have_written_is_refused(
    folder: Path, spoil: Callable[[Path], object], said: str
) -> None:
    spoil(folder / "p01.toml")
    assert f"the gateway could have written this: {said}" in refused(folder)


@needs_root
@pytest.mark.parametrize("kind", ["link", "hard link", "pipe", "folder", "link above"])
def test_what_is_no_file_of_its_own_is_refused(folder: Path, kind: str) -> None:
    path, elsewhere = folder / "p01.toml", put(folder.parent, "elsewhere")
    if kind == "link above":
        folder.rename(folder.parent / "moved")
        folder.symlink_to("moved")
    else:
        path.unlink()
    if kind == "link":
        path.symlink_to(elsewhere)
    elif kind == "hard link":
        path.hardlink_to(elsewhere)
    elif kind == "pipe":
        os.mkfifo(path)
    elif kind == "folder":
        path.mkdir()
    assert "in the place of a" in refused(folder)


# --- what it says -----------------------------------------------------------------------------


@needs_root
@pytest.mark.parametrize("size", [0, MOST_FILE_BYTES + 1, 1 << 40])
def test_one_without_content_or_with_too_much_is_refused_unread(folder: Path, size: int) -> None:
    os.truncate(folder / "p01.toml", size)
    assert "it is empty, or too large" in refused(folder)


@needs_root
@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("x = " + "[" * 5_000, "nested too deep"),
        (".".join("a" * 50_000) + " = 1", "nested too deep"),
        ("cap_ua = " + "9" * 5_000, "more than 64 bits"),
        ("\x00\xff", "cannot be read"),
        ("\x00", "not TOML"),
        ("participant = 'P01'", "body_site"),
    ],
)
def test_what_is_no_calibration_is_a_sentence(folder: Path, text: str, said: str) -> None:
    (folder / "p01.toml").write_text(text, encoding="latin-1")
    assert said in refused(folder)


@needs_root
def test_one_that_changes_is_taken_as_it_was_or_as_it_is(folder: Path) -> None:
    """Replaced while it is opened and read, again and again: never a mixture."""
    path = folder / "p01.toml"
    other = msgspec.structs.replace(CALIBRATION, participant="P02")
    reader = CalibrationProcess(folder, None, None)
    for number in range(4):
        reader.begin(("p01",), GATEWAY)
        while (found := reader.result()) is None:
            new = folder / ".new"
            new.write_text(to_toml((CALIBRATION, other)[number % 2]))
            new.chmod(0o644)
            os.chown(new, OPERATOR, OPERATORS)
            new.rename(path)
        assert found in ((CALIBRATION,), (other,))
    reader.end()


# --- what its process does --------------------------------------------------------------------

HANGS = "def main(*_):\n    while True: pass\n"
EATS = """
from etd.files import calibration_reading as reading
def main(asked, answer, core):
    reading.calibration_of_bytes = lambda *_: bytearray(1 << 30)
    reading.main(asked, answer, core)
"""
EATS_SLOWLY = """
from etd.files import calibration_reading as reading
def main(asked, answer, core):
    reading.calibration_of_bytes = lambda *_: [bytes(size) for size in range(600, 1 << 20)]
    reading.main(asked, answer, core)
"""
TELLS = """
import os
from etd.files import calibration_reading as reading
def main(asked, answer, core):
    fds = [f"/proc/self/fd/{fd}" for fd in os.listdir("/proc/self/fd")]
    targets = {os.readlink(fd) for fd in fds if os.path.lexists(fd)}
    kinds = sorted(target.split(":")[0] for target in targets)
    said = f"{kinds} {sorted(os.environ)} {os.getcwd()}"
    found = reading.Found(error="bad_calibration", reason=said)
    os.write(answer, reading.msgspec.msgpack.encode(found))
    os._exit(0)
"""
FAILS = """
from etd.files import calibration_reading as reading
def main(asked, answer, core):
    reading.calibration_of_bytes = lambda *_: {}["unforeseen"]
    reading.main(asked, answer, core)
"""
FLOODS = (
    "import os\ndef main(asked, answer, core):\n    while True: os.write(answer, bytes(65536))\n"
)
LIES = 'import os\ndef main(asked, answer, core):\n    os.write(answer, b"\\xc1junk")\n'


FEW = """
import msgspec, os
from etd.files.calibration_reading import Found
def main(asked, answer, core):
    os.write(answer, msgspec.msgpack.encode(Found()))
"""


@pytest.fixture
def program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[[str], str]:
    """A module in the place of the one that reads."""

    def made(text: str) -> str:
        (tmp_path / "in_its_place.py").write_text(text)
        monkeypatch.setattr(sys, "path", [str(tmp_path), *sys.path])
        return "in_its_place"

    return made


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (EATS, "a calibration takes too much memory"),
        (EATS_SLOWLY, "a calibration takes too much memory"),
        (LIES, "without an answer"),
        (FLOODS, "without an answer"),
        (FEW, "without an answer"),
        (FAILS, r"without an answer \(status 1\)"),
        ("def main(*_): raise SystemExit(3)", r"without an answer \(status 3\)"),
    ],
)
def test_a_parser_that_eats_memory_lies_floods_or_fails_is_a_refusal(
    folder: Path, program: Callable[[str], str], text: str, said: str
) -> None:
    gateway = GATEWAY if os.geteuid() == 0 else ME
    with pytest.raises(Refused, match=said):
        read(folder, gateway, module=program(text))


def test_one_that_hangs_is_ended_and_the_next_is_not_in_its_way(
    folder: Path, program: Callable[[str], str]
) -> None:
    reader = CalibrationProcess(folder, None, None, program(HANGS))
    reader.begin(("p01",), GATEWAY)
    clock.sleep_s(0.3)
    assert timed(reader.result) is None
    timed(reader.cancel)
    codes = set()
    for _ in range(1_000):
        try:
            timed(lambda: reader.begin(("p01",), GATEWAY))
        except Refused as refusal:
            codes.add(refusal.code)
            clock.sleep_s(0.01)
        else:
            break
    else:
        raise AssertionError("it is never over")
    assert codes <= {"busy"}
    reader.end()


def test_it_has_one_pipe_and_nothing_of_the_engines(
    folder: Path, program: Callable[[str], str]
) -> None:
    module = program(TELLS)
    with (folder / "p01.toml").open("rb") as device:
        os.set_inheritable(device.fileno(), True)
        with pytest.raises(Refused) as told:
            read(folder, ME, module=module)
    assert "['/dev/null', 'pipe'] ['LC_CTYPE'] /" in told.value.reason


def test_the_largest_calibration_fits_into_its_bounds(folder: Path) -> None:
    count = 256
    returns = tuple(tuple(other for other in range(count) if other != own) for own in range(count))
    largest = msgspec.structs.replace(
        CALIBRATION, electrode=CALIBRATION.electrode[:1] * count, returns=returns
    )
    path = put(folder)
    path.write_text(to_toml(largest))
    assert path.stat().st_size < MOST_FILE_BYTES
    assert read(folder, GATEWAY if os.geteuid() == 0 else ME) == (largest,)
    assert calibration_reading.MOST_TOGETHER_BYTES < 192 * 1024
