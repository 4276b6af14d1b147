"""What the kernel does with a thread that does not sleep, on the core that the thread runs on.

Owns: the files and calls that say so. Must not know: who asks, what follows. `root` is prepended to
every path, for tests.

- `sched_rt_runtime_us` is -1 where real-time threads are not throttled. Since Linux 6.12 most
  kernels have no throttle, whatever the file says. It must be -1 all the same: a kernel with group
  scheduling still has one, and nothing else tells which of both it is.
- Linux 6.12 brought the fair server, one for each core, and later kernels one for sched_ext
  besides. `-1` above does not switch them off: each has a runtime of its own in debugfs, in ns,
  which only root can read unless debugfs is mounted otherwise. Older kernels have none.
"""

from __future__ import annotations

import os
import re
from pathlib import Path

from etd_hal.bench import ScanCore
from etd_hal.linux.machine import ROOT

_RUNTIME = "proc/sys/kernel/sched_rt_runtime_us"
_RELEASE = "proc/sys/kernel/osrelease"
_ISOLATED = "sys/devices/system/cpu/isolated"
_DEBUG = "sys/kernel/debug/sched"
_SERVERS = ("fair_server", "ext_server")
#: The release that brought the fair server.
_FIRST_WITH_SERVER = (6, 12)


def scan_core(thread: int = 0, root: Path = ROOT) -> ScanCore:
    """`thread`: its number; 0 for the calling one. Takes some 50 us on a PC."""
    core = _only_core(thread)
    return ScanCore(
        core=core,
        is_isolated=None if core is None else _is_isolated(core, root),
        has_throttle=_has_throttle(root),
        has_fair_server=None if core is None else _has_fair_server(core, root),
    )


def _only_core(thread: int) -> int | None:
    try:
        cores = os.sched_getaffinity(thread)
    except OSError:
        return None
    return min(cores) if len(cores) == 1 else None


def _is_isolated(core: int, root: Path) -> bool | None:
    """The kernel lists them as in "1,3-5"; the list may be empty."""
    text = _text(root / _ISOLATED)
    if text is None or not re.fullmatch(r"(\d+(-\d+)?(,\d+(-\d+)?)*)?", text):
        return None
    ends = [part.split("-") for part in text.split(",") if part]
    return any(int(each[0]) <= core <= int(each[-1]) for each in ends)


def _has_throttle(root: Path) -> bool | None:
    text = _text(root / _RUNTIME)
    return None if not text else text != "-1"


def _has_fair_server(core: int, root: Path) -> bool | None:
    runtimes = [_text(root / _DEBUG / name / f"cpu{core}" / "runtime") for name in _SERVERS]
    found = [text for text in runtimes if text is not None]
    if any(text != "0" for text in found):
        return True
    if runtimes[0] == "0":
        return False
    release = re.match(r"(\d+)\.(\d+)", _text(root / _RELEASE) or "")
    if release is None or (int(release[1]), int(release[2])) >= _FIRST_WITH_SERVER:
        return None
    return False


def _text(path: Path) -> str | None:
    """None: it is not there, or must not be read."""
    try:
        return path.read_text(encoding="ascii").strip()
    except (OSError, UnicodeDecodeError):
        return None
