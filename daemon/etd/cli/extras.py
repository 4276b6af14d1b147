"""What the daemon and its commands need beyond the client, and how to install it.

Owns: the check before anything is begun. Must not know: verbs.
"""

from __future__ import annotations

from importlib.util import find_spec

from etd.protocol.errors import PackageMissing


def check_installed(package: str) -> None:
    """Of the extra `daemon`. Raises: PackageMissing, with the line that installs it."""
    if find_spec(package) is None:
        raise PackageMissing(package, "daemon")


def check_fake() -> None:
    """The body behind a fake board is calculated with numpy. Raises: PackageMissing."""
    check_installed("numpy")
