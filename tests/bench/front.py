"""What a frame costs the processor before the engine plans it: client, sockets, gateway, link.

Owns: the measuring, with the shipped client and gateway in one process, and the engine's end of the
link. Must not know: the engine, what the figures are used for.

Each part is a thread's own time of the processor, so that nothing that waits counts. ZeroMQ's
threads are measured together: what the process has had beside the calling thread.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import process_time_ns, thread_time_ns  # noqa: TID251 (processor time, no clock)

import msgspec
import zmq

from bench.modelled import CURRENT_UA, ELECTRODES, WIDTH_US
from etd.client.options import frame_fields
from etd.client.session import Session
from etd.protocol.link import wait_for_any
from gateway_rig import GatewayRig, RunningClock
from scripted_engine import engine_hello

PARTS = ("client", "sockets", "gateway", "link")
#: What each takes on a PC, in us, as a model charges it; by `make bench`. A machine's slowness
#: multiplies it. Hardly anything of it depends on how many electrodes are in use. Of the gateway's
#: step, which takes 60 to 70, a frame has been passed on after 48.
CHARGED_US = {"client": 17.0, "sockets": 28.0, "gateway": 60.0, "link": 8.0}
_WARM_UP = 30
_RATE_HZ = 10.0


@dataclass(frozen=True)
class Front:
    """A frame with another current for each of so many electrodes; each part in us."""

    electrodes: int
    #: By frame, in the order of `PARTS`.
    frames: tuple[tuple[float, ...], ...]

    def part_us(self, part: str, fraction: float) -> float:
        place = PARTS.index(part)
        return at(fraction, [frame[place] for frame in self.frames])


def at(fraction: float, values: list[float]) -> float:
    """The value that this part of them does not exceed."""
    return sorted(values)[round(fraction * (len(values) - 1))]


def currents(electrodes: int, number: int) -> tuple[int, ...]:
    """For each of the first electrodes another one than in the frame before."""
    active = (CURRENT_UA - 100 + (number + 7 * place) % 100 for place in range(electrodes))
    return (*active, *(0,) * (ELECTRODES - electrodes))


def measure(electrodes: int, frames: int) -> Front:
    """Streamed frames, one at a time."""
    hello = engine_hello()
    array = msgspec.structs.replace(
        hello.array, electrodes=ELECTRODES, x_mm=(0.0,) * ELECTRODES, y_mm=(0.0,) * ELECTRODES
    )
    facts = msgspec.structs.replace(hello, array=array)
    with GatewayRig(facts, RunningClock()) as rig:
        session = Session("bench", max_current_ua=1_000, width_us=WIDTH_US)
        session.lease = rig.open()
        socket = rig.socket(zmq.PUSH, "frames.sock")
        taken = [
            _one(rig, session, socket, currents(electrodes, number))
            for number in range(_WARM_UP + frames)
        ]
    return Front(electrodes, tuple(taken[_WARM_UP:]))


def _one(
    rig: GatewayRig,
    session: Session,
    socket: zmq.Socket[bytes],
    current_ua: tuple[int, ...],
) -> tuple[float, ...]:
    others_ns, begun_ns = _others_ns(), thread_time_ns()
    fields = frame_fields("current_ua", current_ua, {"width_us": WIDTH_US, "rate_hz": _RATE_HZ})
    socket.send(session.streamed(fields))
    stepped_ns = given_ns = thread_time_ns()
    frames = rig.engine.frames_end
    while not wait_for_any([frames], 0.0):
        stepped_ns = thread_time_ns()
        rig.gateway.step()
    # All of the step, although some of it comes after the frame was passed on.
    gateway_ns = thread_time_ns() - stepped_ns
    sockets_ns = _others_ns() - others_ns
    reading_ns = thread_time_ns()
    assert frames.receive() is not None
    link_ns = thread_time_ns() - reading_ns
    return tuple(
        taken_ns / 1e3 for taken_ns in (given_ns - begun_ns, sockets_ns, gateway_ns, link_ns)
    )


def _others_ns() -> int:
    """What the process has had beside this thread."""
    return process_time_ns() - thread_time_ns()
