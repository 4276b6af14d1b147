"""`AsyncDisplay` against a real gateway.

Owns: what awaiting adds: stop beside a request under way, and cancelling.
"""

from __future__ import annotations

import asyncio
from collections.abc import Iterator
from typing import Any

import pytest

from etd import AsyncDisplay, DaemonGone, Refused
from etd.protocol.link import Answer, ArmBoard, Command, NewFrame, StopNow
from gateway_rig import ServedRig
from scripted_engine import full_answer


@pytest.fixture
def rig() -> Iterator[ServedRig]:
    with ServedRig() as rig:
        yield rig


def display(rig: ServedRig, **extra: Any) -> AsyncDisplay:
    return AsyncDisplay(address=rig.address, max_current_ua=3000, width_us=100, **extra)


def test_the_same_methods_can_be_awaited(rig: ServedRig) -> None:
    async def script() -> None:
        async with display(rig) as d:
            assert d.electrodes == 4
            await d.arm()
            await d.show([0, 0, 0, 1])
            await d.hold_current([0, 0, 0, 900], seconds=0.1)
            await d.stream([0, 0, 0, 0.5])
            assert (await d.measure()).contact[2] is False
            assert (await d.mark(1)).marked_ns == 42
            assert (await d.status()).engine == "there"
            assert await d.calibrations() == ()
            with pytest.raises(Refused, match="2 values"):
                await d.show([0, 1])

    asyncio.run(script())
    assert rig.engine.frames[0].frame.level == (0, 0, 0, 1)


def test_several_tasks_may_show_at_once(rig: ServedRig) -> None:
    async def script() -> None:
        async with display(rig) as d:
            replies = await asyncio.gather(*(d.show([0] * 4, tag=tag) for tag in range(10)))
            assert sorted(reply.seq for reply in replies) == list(range(1, 11))

    asyncio.run(script())


def test_stop_does_not_wait_for_a_request_under_way(rig: ServedRig) -> None:
    waiting: list[ArmBoard] = []

    def stopped_first(command: Command | NewFrame) -> Answer | None:
        if isinstance(command, ArmBoard):
            waiting.append(command)
            return None
        if isinstance(command, StopNow):
            rig.engine.say(Answer(ref=waiting[0].ref, error="halted", reason="stopped"))
        return full_answer(command)

    async def script() -> None:
        async with display(rig) as d:
            arming = asyncio.create_task(d.arm())
            while not waiting:
                await asyncio.sleep(0)
            await d.stop()
            with pytest.raises(Refused, match="stopped"):
                await arming

    rig.engine.answer = stopped_first
    asyncio.run(script())


def test_a_cancelled_hold_ends_silent(rig: ServedRig) -> None:
    async def script() -> None:
        async with display(rig) as d:
            holding = asyncio.create_task(d.hold([1, 1, 1, 1], seconds=20))
            while not rig.engine.frames:
                await asyncio.sleep(0)
            holding.cancel()
            with pytest.raises(asyncio.CancelledError):
                await holding
            assert rig.engine.frames[-1].frame.level == (0, 0, 0, 0)

    asyncio.run(script())


def test_telemetry_can_be_awaited(rig: ServedRig) -> None:
    async def script() -> None:
        async with display(rig) as d, d.telemetry("refused", timeout_s=60) as reports:
            await d.stream([0, 0])
            async for topic, report in reports:
                assert (topic, report.error) == ("refused", "bad_frame")  # type: ignore[union-attr]
                break

    asyncio.run(script())


def test_a_display_that_cannot_connect_says_so() -> None:
    async def script() -> None:
        with pytest.raises(DaemonGone, match="there is no socket"):
            async with AsyncDisplay(address="ipc:///nowhere/control.sock"):
                pass

    asyncio.run(script())
