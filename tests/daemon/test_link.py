"""The channel between gateway and engine: whole datagrams, never blocking, drops counted."""

from __future__ import annotations

import itertools
import socket
from collections.abc import Iterator
from pathlib import Path

import msgspec
import pytest

from etd.protocol.errors import AlreadyRunning, Undecodable
from etd.protocol.frame import Frame
from etd.protocol.link import (
    ALIVE_NS,
    MAX_DATAGRAM_BYTES,
    SILENCE_NS,
    Alive,
    Answer,
    Channel,
    KeepLease,
    Listener,
    NewFrame,
    SayFelt,
    StopNow,
    ToEngine,
    ToGateway,
    connect,
    socket_paths,
    wait_for_any,
)

Pair = tuple[Channel[ToEngine], Channel[ToGateway]]


Ends = tuple[socket.socket, socket.socket]


@pytest.fixture
def ends() -> Ends:
    """Of one connection, the engine's and the gateway's."""
    return socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)


@pytest.fixture
def pair(ends: Ends) -> Iterator[Pair]:
    engine: Channel[ToEngine] = Channel(ends[0], ToEngine)
    gateway: Channel[ToGateway] = Channel(ends[1], ToGateway)
    yield engine, gateway
    engine.close()
    gateway.close()


def test_the_gateway_speaks_several_times_before_it_counts_as_silent() -> None:
    assert SILENCE_NS == 250_000_000
    assert SILENCE_NS >= 4 * ALIVE_NS


def test_messages_arrive_whole_and_in_order(pair: Pair) -> None:
    engine, gateway = pair
    sent = [Alive(), KeepLease(ref=3, lease="a"), Alive(ref=9)]
    assert all(gateway.send(command) for command in sent)
    assert [engine.receive() for _ in sent] == sent
    assert engine.receive() is None


def test_an_answer_comes_back_as_it_was(pair: Pair) -> None:
    engine, gateway = pair
    answer = Answer(ref=3, error="too_fast", reason="so", electrode=4, achievable_hz=12.5)
    assert engine.send(answer)
    assert gateway.receive() == answer


def test_the_largest_frame_fits() -> None:
    ends = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    frames: Channel[NewFrame] = Channel(ends[0], NewFrame)
    gateway: Channel[ToGateway] = Channel(ends[1], ToGateway)
    others = tuple(
        tuple(electrode for electrode in range(256) if electrode != each) for each in range(256)
    )
    frame = Frame(
        lease="x" * 64,
        seq=2**63 - 1,
        current_ua=(10_000,) * 256,
        width_us=(200,) * 256,
        polarity=("biphasic_cathodic_first",) * 256,
        rate_hz=(199.9,) * 256,
        returns=others,
    )
    message = NewFrame(ref=2**31, frame=frame)
    assert len(msgspec.msgpack.encode(message)) <= MAX_DATAGRAM_BYTES
    assert gateway.send(message)
    assert frames.receive() == message
    frames.close()
    gateway.close()


def test_a_queue_that_is_full_drops_and_counts_and_never_blocks(pair: Pair) -> None:
    engine, gateway = pair
    taken = 0
    while gateway.send(KeepLease(ref=taken, lease="a")):
        taken += 1
    assert gateway.dropped == 1
    assert gateway.is_open
    assert not gateway.send(Alive())
    assert gateway.dropped == 2
    for expected in range(taken):
        received = engine.receive()
        assert isinstance(received, KeepLease)
        assert received.ref == expected
    assert engine.receive() is None
    assert gateway.send(Alive())


def test_a_message_that_is_too_large_is_dropped_and_the_channel_lives(pair: Pair) -> None:
    engine, gateway = pair
    assert not gateway.send(KeepLease(lease="x" * 4_000_000))
    assert (gateway.dropped, gateway.is_open) == (1, True)
    assert gateway.send(Alive())
    assert engine.receive() == Alive()


def test_an_end_that_is_closed_is_noticed_by_both_ways(pair: Pair) -> None:
    engine, gateway = pair
    gateway.send(Alive())
    gateway.close()
    gateway.close()
    assert engine.receive() == Alive()
    assert engine.is_open
    assert engine.receive() is None
    assert not engine.is_open
    assert not engine.send(Answer(ref=1))
    assert not gateway.send(Alive())
    assert gateway.receive() is None


def test_sending_to_an_end_that_is_gone_closes(pair: Pair) -> None:
    engine, gateway = pair
    gateway.close()
    assert not engine.send(Answer(ref=1))
    assert not engine.is_open


def test_what_had_come_before_the_other_end_was_gone_is_still_received(pair: Pair) -> None:
    engine, gateway = pair
    for ref in (1, 2):
        gateway.send(StopNow(ref=ref, client="operator"))
    gateway.close()
    assert not engine.send(Answer(ref=1))
    assert not engine.is_open
    for ref in (1, 2):
        assert engine.receive() == StopNow(ref=ref, client="operator")
    assert engine.receive() is None


@pytest.mark.parametrize(
    "nonsense",
    [
        b"\xff\xff",
        b"\x80",
        msgspec.msgpack.encode(Answer(ref=1)),
        b"\x82\xa4type\xa9KeepLease\xa5lease\xa2\xff\xfe",
        b"\x82\xa4type\xa5Alive\xa1x" + b"\x91" * 100_000,
    ],
    ids=["no msgpack", "no tag", "an engine's", "no UTF-8", "deep"],
)
def test_bytes_that_are_no_message_of_the_other_end_are_an_error(
    pair: Pair, ends: Ends, nonsense: bytes
) -> None:
    engine, _ = pair
    ends[1].send(nonsense)
    with pytest.raises(Undecodable):
        engine.receive()


@pytest.mark.parametrize("electrodes", [(-1,), (256,), (), (0,) * 257])
def test_electrodes_that_no_array_has_are_an_error(
    pair: Pair, ends: Ends, electrodes: tuple[int, ...]
) -> None:
    engine, _ = pair
    said = SayFelt(ref=1, answer="too_strong", electrodes=electrodes)
    ends[1].send(msgspec.msgpack.encode(said))
    with pytest.raises(Undecodable):
        engine.receive()


def test_a_gateway_connects_to_both_sockets_of_the_engine(tmp_path: Path) -> None:
    assert connect(tmp_path) is None
    listener = Listener(tmp_path)
    assert listener.accept() is None
    mine = connect(tmp_path)
    theirs = listener.accept()
    assert mine is not None
    assert theirs is not None
    mine[0].send(Alive())
    assert theirs[0].receive() == Alive()
    frame = NewFrame(ref=1, frame=Frame(lease="a", seq=1, current_ua=(1,)))
    mine[1].send(frame)
    assert theirs[1].receive() == frame
    for channel in (*mine, *theirs):
        channel.close()
    listener.close()
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(("is_of_one_user", "mode"), [(True, 0o600), (False, 0o660)])
def test_only_the_gateways_user_reaches_an_engine(
    tmp_path: Path, *, is_of_one_user: bool, mode: int
) -> None:
    listener = Listener(tmp_path, is_of_one_user=is_of_one_user)
    assert [path.stat().st_mode & 0o777 for path in socket_paths(tmp_path)] == [mode, mode]
    listener.close()


def test_a_gateway_does_not_wait_behind_others_at_an_engine_that_takes_none(tmp_path: Path) -> None:
    """It would hear no stop and no signal meanwhile."""
    listener, waiting = Listener(tmp_path), []
    for _ in range(5):
        if (one := connect(tmp_path)) is None:
            break
        waiting.append(one)
    assert 0 < len(waiting) < 5
    with pytest.raises(AlreadyRunning, match=tmp_path.name):
        Listener(tmp_path)
    for channel in itertools.chain.from_iterable(waiting):
        channel.close()
    listener.close()


def test_a_second_engine_of_the_same_name_is_refused(tmp_path: Path) -> None:
    listener = Listener(tmp_path)
    with pytest.raises(AlreadyRunning, match=tmp_path.name):
        Listener(tmp_path)
    listener.close()


def test_a_socket_left_by_a_dead_engine_is_taken_over(tmp_path: Path) -> None:
    for path in socket_paths(tmp_path):
        with socket.socket(socket.AF_UNIX, socket.SOCK_SEQPACKET) as left:
            left.bind(str(path))
    assert len(list(tmp_path.iterdir())) == 2
    listener = Listener(tmp_path)
    mine = connect(tmp_path)
    assert mine is not None
    listener.close()
    for channel in mine:
        channel.close()


@pytest.mark.parametrize("client", ["x\n", "x\x1b[31m", "\u2028"])
def test_a_name_that_forges_what_is_shown_is_no_message(pair: Pair, client: str) -> None:
    engine, gateway = pair
    assert gateway.send(StopNow(client=client))
    with pytest.raises(Undecodable) as told:
        engine.receive()
    assert told.value.reason.isprintable()


def test_a_wait_ends_with_a_message_or_the_end_of_a_channel_and_only_with_these(pair: Pair) -> None:
    engine, gateway = pair
    assert not wait_for_any([engine], 0.0)
    assert not wait_for_any([], 0.001)
    gateway.send(Alive())
    assert wait_for_any([engine], 5.0)
    assert engine.receive() is not None
    assert not wait_for_any([engine], 0.001)
    gateway.close()
    assert wait_for_any([engine], 5.0)
