"""Stops that are poured: one of each user is on its way, and each is answered.

Owns: what reaches the engine of a flood of stops, and what other users notice of it.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest

from etd.gateway.engine_link import EngineLink
from etd.gateway.inbound import InboundMessage
from etd.gateway.pending import PendingRequests
from etd.gateway.stops import MOST_TOGETHER, Stops
from etd.protocol.errors import Refused
from etd.protocol.link import Answer, StopNow
from etd.protocol.messages import Stop
from gateway_rig import GatewayRig
from raw_client import connected, hello, part, poured
from scripted_engine import ScriptedEngine

pytestmark = pytest.mark.slow

POURING, OTHER = 1_234, 0


class Poured:
    """Stops of several users at a real link, whose engine answers when it is told to."""

    def __init__(self, folder: Path) -> None:
        self.engine = ScriptedEngine(folder)
        self.link = EngineLink(folder, Counter())
        self.pending = PendingRequests()
        self.stops = Stops(self.link, self.pending)
        while not self.link.is_there:
            self.link.try_connect()
            self.engine.step()
            list(self.link.receive())

    def ask(self, uid: int, number: int = 0) -> None:
        self.stops.ask(Stop(id=number), InboundMessage(1, (), uid, b""), 0)

    def sent(self) -> list[StopNow]:
        """What the engine has heard by now."""
        self.engine.step()
        return [command for command in self.engine.heard if isinstance(command, StopNow)]

    def answer(self, ref: int) -> list[object]:
        """Of the engine; the ids of those that it answers."""
        answered = self.pending.take(ref)
        assert answered is not None
        self.stops.answered(ref)
        return [id_of_it for _, id_of_it in answered.all_of_them]


@pytest.fixture
def poured_stops(tmp_path: Path) -> Iterator[Poured]:
    made = Poured(tmp_path)
    yield made
    made.link.hang_up()
    made.engine.close()


def test_of_a_user_one_is_on_its_way_and_the_next_answers_all_that_came_meanwhile(
    poured_stops: Poured,
) -> None:
    for number in range(100):
        poured_stops.ask(POURING, number)
    (first,) = poured_stops.sent()
    assert poured_stops.answer(first.ref) == [0]
    first, second = poured_stops.sent()
    poured_stops.ask(POURING, 100)
    assert poured_stops.answer(second.ref) == list(range(1, 100))
    *_, third = poured_stops.sent()
    assert poured_stops.answer(third.ref) == [100]
    assert len(poured_stops.sent()) == 3
    poured_stops.ask(POURING, 101)
    assert len(poured_stops.sent()) == 4, "nothing is left behind"


def test_the_stop_of_another_user_is_sent_at_once(poured_stops: Poured) -> None:
    for number in range(MOST_TOGETHER + 2):
        poured_stops.ask(POURING, number)
    with pytest.raises(Refused, match="a stop is on its way") as refused:
        poured_stops.ask(POURING)
    assert refused.value.code == "busy"
    poured_stops.ask(OTHER, 7)
    first, others = poured_stops.sent()
    assert others.client == "user 0"
    assert poured_stops.answer(others.ref) == [7]
    assert poured_stops.answer(first.ref) == [0]


def test_after_an_engine_that_never_answered_the_next_stop_is_sent(poured_stops: Poured) -> None:
    for number in range(3):
        poured_stops.ask(POURING, number)
    gone = poured_stops.pending.take_all()
    assert [id_of_it for one in gone for _, id_of_it in one.all_of_them] == [0, 1, 2]
    poured_stops.ask(POURING, 3)
    assert len(poured_stops.sent()) == 2


def test_what_waits_for_the_next_one_is_sent_though_the_one_before_was_given_up(
    poured_stops: Poured,
) -> None:
    for number in range(3):
        poured_stops.ask(POURING, number)
    (first,) = poured_stops.sent()
    poured_stops.pending.take(first.ref)
    poured_stops.ask(POURING, 3)
    _, following = poured_stops.sent()
    assert poured_stops.answer(following.ref) == [1, 2]
    *_, last = poured_stops.sent()
    assert poured_stops.answer(last.ref) == [3]


def test_each_of_a_flood_is_answered_and_the_link_stands() -> None:
    with GatewayRig() as rig, closing(connected(rig.folder / "control.sock")) as flooder:
        poured(flooder, hello("DEALER"))
        rig.step(3)
        asked = 200
        for number in range(asked):
            poured(flooder, part(json.dumps({"op": "stop", "id": number}).encode()))
        read = bytearray()
        for _ in range(400):
            rig.step()
            try:
                read += flooder.recv(1_000_000)
            except BlockingIOError:
                continue
            if read.count(b'"ok":true') == asked:
                break
        assert read.count(b'"ok":true') == asked
        sent = sum(isinstance(command, StopNow) for command in rig.engine.heard)
        assert 2 <= sent < asked
        assert rig.call(op="status")["status"]["engine"] == "there"


def test_what_the_engine_refuses_is_refused_to_all_that_waited(rig: GatewayRig) -> None:
    rig.engine.answer = lambda command: Answer(ref=command.ref, error="halted", reason="it is")
    for number in range(3):
        rig.control.send(json.dumps({"op": "stop", "id": number}).encode())
    assert {rig.reply()["error"] for _ in range(3)} == {"halted"}


@pytest.fixture
def rig() -> Iterator[GatewayRig]:
    with GatewayRig() as made:
        yield made
