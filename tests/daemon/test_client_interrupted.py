"""A client that is cut off, cancelled or forked in the middle: what goes on, and what it is told.

Owns: disarming beside a presentation, a gateway that dies within a request, interrupts between two
steps, and stops of a child.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import threading
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest
import zmq

from etd import AsyncDisplay, DaemonGone, Display, Refused
from etd.client import clock
from etd.client.drive import drive
from etd.files import resources
from etd.files.calibration import load_calibration
from etd.files.paths import CONTROL
from etd.protocol.link import KeepLease, NewFrame, StopNow
from gateway_rig import ServedRig
from held_reader import HeldReader

pytestmark = pytest.mark.slow

LIMITS: dict[str, Any] = {"max_current_ua": 3000, "width_us": 100}
FIRST = {0: 900}


@pytest.fixture
def rig() -> Iterator[ServedRig]:
    with ServedRig() as made:
        yield made


def display(rig: ServedRig) -> Display:
    return Display(address=rig.address, **LIMITS)


def frames(rig: ServedRig) -> list[NewFrame]:
    """Those that are shown."""
    sent = [heard for heard in rig.engine.heard if isinstance(heard, NewFrame)]
    return [one for one in sent if not one.frame.preview]


def is_silent(sent: NewFrame) -> bool:
    return not any(sent.frame.current_ua or ())


def test_what_goes_on_beside_the_program_ends_when_it_disarms_and_begins_no_more(
    rig: ServedRig,
) -> None:
    with display(rig) as d:
        d.arm()
        underway = d.begin_current(FIRST, seconds=20.0)
        while not frames(rig):
            clock.sleep_s(0.005)
        d.disarm()
        d.arm()
        before = len(frames(rig))
        presented = underway.wait(5.0)
        assert len(frames(rig)) == before
        assert "the program disarmed" in str(presented.why_not)
        d.show_current(FIRST)
        assert not is_silent(frames(rig)[-1])


class Vanishing:
    """A daemon that is gone once it was asked to arm."""

    def __init__(self, folder: Path, hello: dict[str, object]) -> None:
        self._path, self._hello = folder / CONTROL, hello
        self.was_asked_to_arm = False
        self._bound = threading.Event()
        self._thread = threading.Thread(target=self._serve, daemon=True)
        self._thread.start()
        self._bound.wait()

    def _serve(self) -> None:
        with zmq.Context() as context, context.socket(zmq.ROUTER) as socket:
            socket.setsockopt(zmq.LINGER, 0)
            socket.bind(f"ipc://{self._path}")
            self._bound.set()
            while socket.poll(10_000):
                *route, data = socket.recv_multipart()
                asked = json.loads(data)
                if asked["op"] == "arm":
                    self.was_asked_to_arm = True
                    break
                reply = (
                    self._hello
                    if asked["op"] == "hello"
                    else {"lease": "a" * 32, "lease_ms": 1_000}
                )
                said = {**reply, "ok": True, "now_ns": clock.now_ns(), "id": asked["id"]}
                socket.send_multipart([*route, json.dumps(said).encode()])

    def join(self) -> None:
        self._thread.join(10.0)


@pytest.fixture
def vanishing(rig: ServedRig, tmp_path: Path) -> Iterator[Vanishing]:
    raw = rig.socket(zmq.DEALER, CONTROL)
    raw.send(b'{"op": "hello"}')
    hello = json.loads(raw.recv_multipart()[-1])
    made = Vanishing(tmp_path, hello)
    yield made
    made.join()


def test_a_daemon_that_is_gone_while_it_arms_is_told_within_the_time_given(
    vanishing: Vanishing, tmp_path: Path
) -> None:
    """The lease is renewed meanwhile, and those sends have no peer."""
    begun_ns = clock.now_ns()
    with Display(address=f"ipc://{tmp_path / CONTROL}", **LIMITS) as d:
        with pytest.raises(DaemonGone):
            d.arm(timeout_s=1.5)
        assert vanishing.was_asked_to_arm
    assert clock.now_ns() - begun_ns < 8e9


def test_the_same_awaited(vanishing: Vanishing, tmp_path: Path) -> None:
    async def script() -> None:
        async with AsyncDisplay(address=f"ipc://{tmp_path / CONTROL}", **LIMITS) as d:
            with pytest.raises(DaemonGone):
                await asyncio.wait_for(d.arm(timeout_s=1.5), 8.0)
            assert vanishing.was_asked_to_arm

    asyncio.run(script())


def test_a_child_that_has_forked_stops_too(rig: ServedRig) -> None:
    with display(rig) as d:
        child = os.fork()
        if not child:
            try:
                d.stop()
            finally:
                os._exit(0 if sys.exc_info()[0] is None else 1)
        _, status = os.waitpid(child, 0)
        assert status == 0
        assert any(isinstance(heard, StopNow) for heard in rig.engine.heard)
        assert d.status().engine == "there", "the parent's own goes on"


def test_after_close_each_method_says_that_it_was_closed(rig: ServedRig) -> None:
    d = display(rig)
    d.arm()
    underway = d.begin_current(FIRST, seconds=20.0)
    d.close()
    for asked in (lambda: underway.wait(5.0), d.telemetry, d.status):
        with pytest.raises((DaemonGone, Refused)):
            asked()


@pytest.mark.parametrize("opened", [True, False])
def test_what_says_whether_is_no_strength_to_open_to(rig: ServedRig, *, opened: bool) -> None:
    with display(rig) as d:
        for asked in ({"open_to": opened}, {"open_to_ua": opened}):
            with pytest.raises(Refused, match="it says to which strength"):
                d.arm(**asked)
        with pytest.raises(Refused, match="is no electrode"):
            d.show_current({opened: 500})
        with pytest.raises(Refused, match="64 bits"):
            d.show({0: 10**400})
    assert not frames(rig)


def test_a_lease_is_renewed_while_a_calibration_is_read() -> None:
    reader = HeldReader()
    with ServedRig(reader=reader) as rig:
        folder = rig.state_dir / "calibrations"
        folder.mkdir(parents=True)
        shipped = resources.find("calibrations", "fake-fingertip-pad-8")
        (folder / "P01.toml").write_bytes(shipped.read_bytes())
        with display(rig) as d:
            d.arm()
            read = threading.Timer(1.2, lambda: setattr(reader, "found", load_calibration(shipped)))
            read.start()
            assert d.calibration("P01").array == "pad-8"
            read.join()
        assert sum(isinstance(heard, KeepLease) for heard in rig.engine.heard) >= 2


# --- cancelled -----------------------------------------------------------------------------------


def cancelled(rig: ServedRig, how: Callable[[asyncio.Task[Any], AsyncDisplay], Any]) -> None:
    async def script() -> None:
        async with AsyncDisplay(address=rig.address, **LIMITS) as d:
            await d.arm()
            task = d.begin_current(FIRST, 20.0)
            while not frames(rig):
                await asyncio.sleep(0.005)
            await how(task, d)
            with pytest.raises(asyncio.CancelledError):
                await task
            await asyncio.sleep(0.1)
            # The lease's end would silence it as well.
            seen.extend(frames(rig))

    seen: list[NewFrame] = []
    asyncio.run(script())
    rig.cancelled_frames = seen  # type: ignore[attr-defined]


def test_one_that_is_cancelled_twice_ends_silent(rig: ServedRig) -> None:
    async def twice(task: asyncio.Task[Any], _: AsyncDisplay) -> None:
        task.cancel()
        await asyncio.sleep(0)
        task.cancel()

    cancelled(rig, twice)
    assert is_silent(rig.cancelled_frames[-1])  # type: ignore[attr-defined]


def test_one_that_is_cancelled_does_not_silence_what_the_program_has_shown_since(
    rig: ServedRig,
) -> None:
    async def after_another(task: asyncio.Task[Any], d: AsyncDisplay) -> None:
        await d.show_current({1: 500})
        task.cancel()

    cancelled(rig, after_another)
    newest = rig.cancelled_frames[-1]  # type: ignore[attr-defined]
    assert newest.frame.current_ua == (0, 500, 0, 0)


# --- interrupts between two steps ----------------------------------------------------------------


def course(told: list[str]) -> Generator[str, None, str]:
    try:
        yield "one"
        yield "two"
        yield "three"
    except KeyboardInterrupt:
        told.append("interrupted")
        yield "silent"
        raise
    told.append("finished")
    return "done"


@pytest.mark.parametrize("line", range(1, 40))
def test_wherever_an_interrupt_comes_the_course_hears_of_it(line: int) -> None:
    """Of each line of `drive` that is run: in a step, and between two of them."""
    told: list[str] = []
    done: list[str] = []
    lines = 0

    def trace(frame: FrameType, event: str, _: object) -> Any:
        nonlocal lines
        if frame.f_code is not drive.__code__:
            return None
        if event == "line" and done and "silent" not in done:
            lines += 1
            if lines == line:
                raise KeyboardInterrupt
        return trace

    steps, before = course(told), sys.gettrace()
    sys.settrace(trace)
    try:
        drive(steps, done.append)
    except KeyboardInterrupt:
        assert told in (["interrupted"], ["finished"])
        assert done[-1] == ("silent" if told == ["interrupted"] else "three")
    else:
        assert lines < line
    finally:
        sys.settrace(before)
