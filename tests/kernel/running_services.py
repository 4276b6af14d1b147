"""Our services under the guest's systemd, for the checks that need them running.

Owns: the fixtures, loaded by name where systemd is the first process. Must not know: what is
checked.
"""

from __future__ import annotations

from collections.abc import Iterator

import pytest

import kernel_trace
import service_scene as scene
from guest_board import set_parameter


@pytest.fixture(scope="session")
def installed() -> Iterator[None]:
    """Set up, on buses that answer zero by themselves."""
    set_parameter("alone", 1)
    scene.set_up()
    yield
    scene.stop()


@pytest.fixture
def services(installed: None) -> None:
    """Both are there, in SAFE; the trace goes back to where the engine was started."""
    scene.TOLD.unlink(missing_ok=True)
    if not scene.main_pid(scene.ENGINE):
        kernel_trace.begin()
    scene.start()
