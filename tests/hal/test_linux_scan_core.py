"""What the kernel says of a core: read back from its files, and never guessed."""

from __future__ import annotations

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from itertools import product
from pathlib import Path

import pytest

from etd_hal.bench import UNKNOWN_CORE, ScanCore
from etd_hal.linux.scan_core import scan_core

RUNTIME = "proc/sys/kernel/sched_rt_runtime_us"
RELEASE = "proc/sys/kernel/osrelease"
ISOLATED = "sys/devices/system/cpu/isolated"


def bound(ask: Callable[[], ScanCore]) -> tuple[int, ScanCore]:
    """Asked by a thread that may run on one core only, as the real kernel has it."""
    core = max(os.sched_getaffinity(0))

    def asked() -> ScanCore:
        os.sched_setaffinity(0, {core})
        return ask()

    with ThreadPoolExecutor(1) as pool:
        return core, pool.submit(asked).result()


def lay_out(root: Path, **files: str | None) -> Path:
    """The files of a kernel that leaves the core alone; `files` by the names above. None: there is
    none.
    """
    core = max(os.sched_getaffinity(0))
    server = f"sys/kernel/debug/sched/fair_server/cpu{core}/runtime"
    found: dict[str, str | None] = {
        RUNTIME: "-1\n",
        RELEASE: "6.12.47+rpt-rpi-v8\n",
        ISOLATED: f"{core}\n",
        server: "0\n",
    }
    places = {"runtime": RUNTIME, "release": RELEASE, "isolated": ISOLATED, "server": server}
    found |= {places[name]: text for name, text in files.items()}
    for place, text in found.items():
        path = root / place
        path.parent.mkdir(parents=True, exist_ok=True)
        if text is not None:
            path.write_text(text)
    return root


def test_a_core_that_is_left_alone(tmp_path: Path) -> None:
    core, found = bound(lambda: scan_core(root=lay_out(tmp_path)))
    assert found == ScanCore(core, is_isolated=True, has_throttle=False, has_fair_server=False)
    assert found.is_left_alone
    assert str(found) == f"core {core}, isolated; real-time throttle off, fair server off"


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("runtime", "950000\n"),
        ("runtime", "0\n"),
        ("runtime", ""),
        ("runtime", None),
        ("server", "50000000\n"),
        ("server", ""),
        ("server", None),
        ("isolated", "\n"),
        ("isolated", "100-200,300\n"),
        ("isolated", "all\n"),
        ("isolated", None),
    ],
)
def test_whatever_is_not_read_back_as_off_is_taken_to_be_on(
    tmp_path: Path, name: str, text: str | None
) -> None:
    _, found = bound(lambda: scan_core(root=lay_out(tmp_path, **{name: text})))
    assert not found.is_left_alone
    if text is None:
        assert None in (found.is_isolated, found.has_throttle, found.has_fair_server)
    assert str(found) != str(bound(lambda: scan_core(root=lay_out(tmp_path / "off")))[1])


@pytest.mark.parametrize(
    ("release", "has"),
    [
        ("5.15.84-v8+", False),
        ("6.6.74+rpt-rpi-v8", False),
        ("6.11.9", False),
        ("6.12.0", None),
        ("6.18.44", None),
        ("7.0-rc1", None),
        ("", None),
        ("unknown", None),
    ],
)
def test_without_debugfs_a_kernel_of_before_6_12_has_no_fair_server_and_of_others_it_is_not_known(
    tmp_path: Path, release: str, has: bool | None
) -> None:
    _, found = bound(lambda: scan_core(root=lay_out(tmp_path, server=None, release=release)))
    assert found.has_fair_server is has


def test_an_old_kernel_that_has_a_fair_server_all_the_same_is_believed(tmp_path: Path) -> None:
    root = lay_out(tmp_path, release="6.6.1", server="50000000")
    assert bound(lambda: scan_core(root=root))[1].has_fair_server is True


def test_the_server_of_sched_ext_counts_as_well(tmp_path: Path) -> None:
    root = lay_out(tmp_path)
    core = max(os.sched_getaffinity(0))
    path = root / f"sys/kernel/debug/sched/ext_server/cpu{core}/runtime"
    path.parent.mkdir(parents=True)
    path.write_text("50000000\n")
    assert bound(lambda: scan_core(root=root))[1].has_fair_server is True
    path.write_text("0\n")
    assert bound(lambda: scan_core(root=root))[1].is_left_alone


@pytest.mark.parametrize(
    ("isolated", "core", "is_in"),
    [("3", 3, True), ("1-3", 2, True), ("1,3-5", 2, False), ("0,2", 2, True), ("30", 3, False)],
)
def test_the_list_of_isolated_cores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, isolated: str, core: int, is_in: bool
) -> None:
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {core})
    assert scan_core(root=_isolated(tmp_path, isolated)).is_isolated is is_in


def _isolated(root: Path, text: str) -> Path:
    path = root / ISOLATED
    path.parent.mkdir(parents=True)
    path.write_text(f"{text}\n")
    return root


def test_a_thread_on_several_cores_or_one_that_is_gone_has_no_core(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    root = lay_out(tmp_path)
    monkeypatch.setattr(os, "sched_getaffinity", lambda _: {2, 3})
    found = scan_core(root=root)
    assert (found.core, found.is_left_alone) == (None, False)
    monkeypatch.undo()
    assert scan_core(thread=2**22 + 1, root=root).core is None


def test_this_kernel_is_read_without_a_fault() -> None:
    assert isinstance(scan_core().has_throttle, bool | None)


def test_only_all_four_together_leave_a_core_alone() -> None:
    known = [
        ScanCore(core, is_isolated, has_throttle, has_server)
        for core, is_isolated, has_throttle, has_server in product(
            (None, 3), (None, True, False), (None, True, False), (None, True, False)
        )
    ]
    alone = [each for each in known if each.is_left_alone]
    assert alone == [ScanCore(3, is_isolated=True, has_throttle=False, has_fair_server=False)]
    assert not UNKNOWN_CORE.is_left_alone
