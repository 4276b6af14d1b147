"""A verb's own daemon on a fake board, and how long what its client sends holds there."""

from __future__ import annotations

import pytest

from etd import Display
from etd.cli.private_daemon import private_daemon
from etd.files.configuration import fake_config

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("given", "factor"), [(None, 20), (3, 3)])
def test_its_timeouts_are_as_long_as_was_asked(given: int | None, factor: int) -> None:
    with (
        private_daemon("play", fake_config(array="pad-8"), timeout_factor=given) as address,
        Display(address=address) as display,
    ):
        assert display.status().timeout_factor == factor
