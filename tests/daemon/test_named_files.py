"""What a folder may hold that no request can name, and how much a list of it costs."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from etd.files.calibration_folder import MOST_CALIBRATIONS, CalibrationFolder
from etd.files.named_files import names_in, size_of
from etd.gateway.record_store import RecordStore
from etd.protocol.errors import Refused
from gateway_rig import GatewayRig

#: A link, an escape, a line break, half a pair, Latin-1, one that is too long, none at all.
CALLED = [
    b"\xff",
    b"nl\n",
    b"esc\x1b[31m",
    b"a b",
    "\u202eabc".encode(),
    b"x" * 33,
    b"",
    b"..",
    "gr\u00f6\u00dfe".encode("latin-1"),
]


@pytest.fixture
def rig() -> Iterator[GatewayRig]:
    with GatewayRig() as made:
        yield made


def fill(folder: Path, suffix: bytes) -> None:
    """With what is called so; and with a file that is called as it should be."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in (*CALLED, b"P01"):
        Path(os.fsdecode(os.fsencode(folder) + b"/" + name + suffix)).write_bytes(b"")


def test_what_no_request_can_name_is_not_there(tmp_path: Path) -> None:
    fill(tmp_path, b".toml")
    (tmp_path / "P02.tom").write_bytes(b"")
    assert names_in(tmp_path, ".toml") == ["P01"]
    assert names_in(tmp_path / "none", ".toml") == []
    assert CalibrationFolder(tmp_path, None).names(with_shipped=False) == ("P01",)


def test_the_gateway_says_hello_and_lists_records_whatever_files_are_called(
    rig: GatewayRig,
) -> None:
    fill(rig.state_dir / "calibrations", b".toml")
    fill(rig.state_dir / "records", b".jsonl")
    assert rig.call(op="hello")["calibrations"] == ["P01"]
    listed = rig.call(op="record", do="list")
    assert [one["name"] for one in listed["records"]] == ["P01"]


def test_a_link_to_where_the_gateway_may_not_look_is_refused(
    rig: GatewayRig, tmp_path: Path
) -> None:
    """Root may look everywhere. What nobody can follow: a link in a circle, one through a file,
    one to a name that is too long for any folder.
    """
    calibrations, records = rig.state_dir / "calibrations", rig.state_dir / "records"
    (tmp_path / "file").write_bytes(b"")
    for folder, suffix in ((calibrations, ".toml"), (records, ".jsonl")):
        folder.mkdir(parents=True)
        (folder / f"circle{suffix}").symlink_to(folder / f"circle{suffix}")
        (folder / f"through{suffix}").symlink_to(tmp_path / "file" / "x")
        (folder / f"long{suffix}").symlink_to("x" * 300)
        (folder / f"folder{suffix}").mkdir()
    for name in ("circle", "through", "long", "folder"):
        opened = rig.call(op="open", client="x", calibration=name)
        assert not opened["ok"]
        got = rig.call(op="record", do="get", name=name, offset=0)
        assert not got["ok"]
    assert rig.call(op="hello")["ok"]


def test_of_a_folder_with_more_than_are_kept_no_more_is_looked_at(tmp_path: Path) -> None:
    for number in range(4 * MOST_CALIBRATIONS + 50):
        (tmp_path / f"c{number}.toml").write_bytes(b"")
    assert len(CalibrationFolder(tmp_path, None).names(with_shipped=False)) == MOST_CALIBRATIONS
    assert len(names_in(tmp_path, ".toml", 7)) == 7


def test_the_size_of_a_link_is_its_own_and_of_what_is_gone_nothing(tmp_path: Path) -> None:
    (tmp_path / "large").write_bytes(b"x" * 10_000)
    (tmp_path / "link").symlink_to(tmp_path / "large")
    assert size_of(tmp_path / "link") < 1_000
    assert size_of(tmp_path / "none") == 0


def sizes(store: RecordStore) -> dict[str, int]:
    return {one.name: one.bytes for one in store.facts(None)}


@pytest.mark.parametrize("offset", [3, 4, 2**40, 2**63 - 1])
def test_beyond_a_records_end_there_is_nothing_and_that_is_no_failure(
    tmp_path: Path, offset: int
) -> None:
    store = RecordStore(tmp_path)
    store.create("first")
    (tmp_path / "records" / "first.jsonl").write_bytes(b"abc")
    assert store.piece("first", 2) == b"c"
    assert store.piece("first", offset) == b""


def test_a_list_is_of_now_whoever_has_changed_the_folder(tmp_path: Path) -> None:
    """A record that grows, one that is deleted, one that somebody else puts there or takes."""
    store, folder = RecordStore(tmp_path), tmp_path / "records"
    assert sizes(store) == {}
    first = store.create("first")
    assert sizes(store) == {"first": 0}
    (folder / "first.jsonl").write_bytes(b"x" * 100)
    assert sizes(store) == {"first": 100}
    second = store.create("second")
    assert sizes(store) == {"first": 100, "second": 0}
    store.delete("first")
    assert sizes(store) == {"second": 0}
    (folder / "third.jsonl").write_bytes(b"xyz")
    os.utime(folder, ns=(1, 1))
    assert sizes(store) == {"second": 0, "third": 3}
    (folder / "third.jsonl").unlink()
    os.utime(folder, ns=(2, 2))
    assert sizes(store) == {"second": 0}
    with pytest.raises(Refused, match="there is no record 'third'; there are: second"):
        store.piece("third", 0)
    first.close()
    second.close()


def test_what_it_does_itself_within_a_tick_of_the_folders_clock_is_seen(tmp_path: Path) -> None:
    store, folder = RecordStore(tmp_path), tmp_path / "records"
    folder.mkdir()

    def listed() -> dict[str, int]:
        os.utime(folder, ns=(1, 1))
        return sizes(store)

    assert listed() == {}
    store.create("first").close()
    assert listed() == {"first": 0}
    store.delete("first")
    assert listed() == {}


def test_a_folder_that_has_not_changed_is_not_looked_through_again(tmp_path: Path) -> None:
    """What is put there behind its back is not seen: the folder's time is as it was."""
    store, folder = RecordStore(tmp_path), tmp_path / "records"
    folder.mkdir()
    os.utime(folder, ns=(1, 1))
    assert sizes(store) == {}
    (folder / "other.jsonl").write_bytes(b"xyz")
    os.utime(folder, ns=(1, 1))
    assert sizes(store) == {}
