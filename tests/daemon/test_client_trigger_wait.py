"""Waiting for the trigger, as an application asks for it: renewals, and what is told in the end."""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import Any

import pytest

from etd import AsyncDisplay, Display
from etd.client.presented import Presented
from etd.protocol.link import Answer, AskAccount, Command, NewFrame
from gateway_rig import ServedRig
from scripted_engine import account, full_answer

pytestmark = pytest.mark.slow

FIRST = [2_000, 0, 0, 0]


@pytest.fixture
def rig() -> Iterator[ServedRig]:
    with ServedRig() as rig:
        yield rig


def display(rig: ServedRig) -> Display:
    made = Display(address=rig.address, max_current_ua=3000, width_us=100, client="me")
    made.arm()
    return made


def frames_of(rig: ServedRig) -> list[Any]:
    """Those that are shown."""
    return [sent.frame for sent in rig.engine.frames if not sent.frame.preview]


def triggering(message: Command | NewFrame) -> Answer:
    """The edge has come when the wait is renewed for the second time."""
    if isinstance(message, AskAccount):
        return Answer(ref=message.ref, account=account(message.seq, trigger_ns=1_000))
    if isinstance(message, NewFrame) and message.frame.renews == 2:
        return Answer(ref=message.ref, rate_hz=60.0, trigger_ns=1_000)
    return full_answer(message)


@pytest.mark.parametrize("how", ["present", "begin", "awaited"])
def test_a_wait_for_the_trigger_is_renewed_until_its_edge_is_told(rig: ServedRig, how: str) -> None:
    rig.engine.answer = triggering
    options: dict[str, Any] = {"on_trigger": True, "ttl_ms": 300, "wait_s": 20.0}

    async def awaited() -> Presented:
        async with AsyncDisplay(address=rig.address, max_current_ua=3000, width_us=100) as d:
            return await d.present_current(FIRST, 0.1, **options)

    if how == "awaited":
        presented = asyncio.run(awaited())
    else:
        with display(rig) as d:
            if how == "present":
                presented = d.present_current(FIRST, 0.1, **options)
            else:
                presented = d.begin_current(FIRST, 0.1, **options).wait(60.0)
    *waiting, silence = frames_of(rig)
    assert [(frame.seq, frame.renews) for frame in waiting] == [(1, None), (2, 1), (3, 2)]
    assert all(frame.on_trigger and frame.lasts_ms == 100 for frame in waiting)
    assert (silence.current_ua, silence.on_trigger) == ((0, 0, 0, 0), False)
    assert (presented.seqs, presented.trigger_ns, presented.latency_ns) == ((2,), 1_000, 1_000)
