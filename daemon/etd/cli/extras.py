"""What the daemon and its commands need beyond the client, and how to install it.

Owns: the check before anything is begun. Must not know: verbs.
"""

from __future__ import annotations

import importlib
from importlib.util import find_spec

from etd.protocol.errors import LibraryMissing, PackageMissing
from etd_hal.daemon_python import check_python

_GET_LIBLSL = (
    "pylsl comes without it on this machine. On a Raspberry Pi: pip install --no-deps mne-lsl, and"
    " name the file in it in PYLSL_LIB (docs/lsl.md); or run etd lsl --host on another computer"
)


def check_installed(package: str) -> None:
    """Of the extra `daemon`. Raises: PackageMissing, with the line that installs it."""
    if find_spec(package) is None:
        raise PackageMissing(package, "daemon")


def check_lsl() -> None:
    """Raises: PackageMissing; LibraryMissing, since on some machines the package comes without."""
    if find_spec("pylsl") is None:
        raise PackageMissing("pylsl", "lsl")
    try:
        importlib.import_module("pylsl")
    except RuntimeError as error:
        raise LibraryMissing("liblsl", _GET_LIBLSL) from error


def check_fake() -> None:
    """A fake board has a daemon in this Python, and a body that is calculated with numpy.

    Raises: PythonTooOld, PackageMissing.
    """
    check_python("a fake board")
    check_installed("numpy")
