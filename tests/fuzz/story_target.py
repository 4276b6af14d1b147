"""Target: bytes to what two clients and the world do to a whole daemon.

Owns: how bytes choose the verbs of `two_clients.py`, which also judges. Must not know: what must
hold.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

from engine_scenes import opened_to
from etd_hal.fake import faults
from fuzz.choices import Choices
from fuzz.target import Target
from two_clients import ELECTRODES, OF_LEASE, TwoClients

_MOST_ACTS = 30
_MOST_NS = 4_000_000_000
_LINES: Any = ("emergency_stop", "wearer_stop")
_WAITS_MS = (1, 10, 50, 300, 700, 1_200)
_FAULTS = (
    faults.SpiError(at_transfer=0),
    faults.SpiShort(),
    faults.RailOff(0.5),
    faults.AdcStuck(4095),
    faults.MisoStuck(1),
)


def _open(daemon: TwoClients, choices: Choices) -> None:
    limits = {"max_current_ua": choices.pick((1_000, 300)), "width_us": choices.pick((100, 50))}
    daemon.ask(choices.number(0, 1), "open", client="fuzz", limits=limits)


def _ask(daemon: TwoClients, choices: Choices) -> None:
    ops = ("arm", "clear", "status", "hello", *OF_LEASE)
    daemon.ask(choices.number(0, 1), choices.pick(ops))


def _account(daemon: TwoClients, choices: Choices) -> None:
    who = choices.number(0, 1)
    lease = daemon.clients[choices.number(0, 1)].lease
    daemon.ask(who, "account", lease=lease, seq=choices.number(0, 5))


def _frame(daemon: TwoClients, choices: Choices) -> None:
    fields = {
        "current_ua": [choices.pick((0, 400, 3_000)) for _ in range(ELECTRODES)],
        "width_us": choices.number(20, 200),
        "rate_hz": choices.number(1, 120),
        "polarity": choices.pick(("anodic", "cathodic", "biphasic")),
        "ttl_ms": choices.number(1, 1_000),
        "allow_slower": True,
        "account": choices.is_so(),
    }
    who, of = choices.number(0, 1), choices.number(0, 1)
    daemon.frame(who, of, choices.is_so(), fields)


_ACTS: tuple[Callable[[TwoClients, Choices], None], ...] = (
    lambda daemon, choices: daemon.run(choices.pick(_WAITS_MS)),
    _frame,
    _open,
    _ask,
    _account,
    lambda daemon, choices: daemon.stop(choices.number(0, 1)),
    lambda daemon, choices: daemon.press(choices.pick(_LINES)),
    lambda daemon, choices: daemon.release(choices.pick(_LINES)),
    lambda daemon, choices: daemon.stall(choices.number(0, 1_500)),
    lambda daemon, choices: daemon.put_in(choices.pick(_FAULTS)),
    lambda daemon, _: daemon.mend(),
    lambda daemon, choices: daemon.come_again(choices.number(0, 1)),
    lambda daemon, _: daemon.gateway_again(),
    lambda daemon, _: opened_to(daemon.rig, 3_000),
    lambda daemon, choices: daemon.ask(choices.number(0, 1), "felt", answer="too_strong"),
)


def _play(data: bytes) -> None:
    choices, daemon = Choices(data), TwoClients()
    end_ns = daemon.rig.clock.now_ns() + _MOST_NS
    try:
        for _ in range(_MOST_ACTS):
            if choices.is_over or daemon.rig.clock.now_ns() > end_ns:
                break
            choices.pick(_ACTS)(daemon, choices)
    except BaseException:
        daemon.close()
        raise
    daemon.end()


#: The first client opens a lease, the wearer tries the stop, and it is armed.
_ARMED = bytes([2, 0, 0, 0, 6, 1, 7, 1, 3, 0, 0, 0, 4, 13])
_LIT = bytes([1, 0, 2, 0, 0, 1, 0, 0, 0, 80, 59, 0, 243, 1, 1])


def _seeds() -> Iterator[bytes]:
    mine, others, streamed = bytes([0, 0, 0]), bytes([1, 0, 0]), bytes([0, 0, 1])
    wait = bytes([0, 2])
    for after in (
        wait * 3,
        bytes([5, 1, 3, 0, 1, 3, 1, 0]),
        bytes([6, 0, 7, 0, 3, 0, 1]),
        bytes([8, 200, 1]) + wait,
        bytes([4, 0, 0, 1, 0, 4]),
        bytes([11, 0, 3, 0, 4]),
        bytes([12, 2, 1, 0, 0]),
        bytes([14, 1]) + wait,
        *(bytes([9, fault, 0, 3, 10]) for fault in range(len(_FAULTS))),
    ):
        yield _ARMED + _LIT + mine + wait + _LIT + streamed + _LIT + others + after


TARGETS = (
    Target(
        "stories",
        "two clients, stop lines, faults and stalls at a whole daemon",
        _play,
        _seeds,
        ("daemon/etd/gateway/lease.py", "daemon/etd/safety/lease.py", "daemon/etd/safety/state.py"),
        most_bytes=512,
        most_s=60.0,
        shares=3,
        guiding=("etd.engine.commands", "etd.engine.supervisor", "etd.gateway", "etd.safety.state"),
    ),
)
