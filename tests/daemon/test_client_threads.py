"""Displays in threads of their own."""

from __future__ import annotations

import subprocess
import sys

import pytest

#: Two threads are the first to decode a reply; switches without end make them meet.
FIRST_REPLIES = """
import sys, threading
sys.setswitchinterval(1e-6)
from etd.client.session import Session
reply = b'{"ok":true,"now_ns":1,"id":1,"status":{"state":"SAFE","now_ns":1,"engine":"gone"}}'
def settle(barrier):
    session = Session("me", max_current_ua=1000, width_us=100)
    ask = next(session.status())
    barrier.wait()
    session.settle(ask, reply)
barrier = threading.Barrier(8)
threads = [threading.Thread(target=settle, args=(barrier,)) for _ in range(8)]
for thread in threads: thread.start()
for thread in threads: thread.join()
"""


@pytest.mark.parametrize("_attempt", range(5))
def test_two_that_are_the_first_to_be_answered_do_not_crash(_attempt: int) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", FIRST_REPLIES], capture_output=True, text=True, check=False
    )
    assert (ran.returncode, ran.stderr) == (0, "")
