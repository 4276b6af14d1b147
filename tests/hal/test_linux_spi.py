"""SPI messages as they reach the kernel."""

from __future__ import annotations

import errno
import gc
import weakref

import pytest
from hypothesis import given
from hypothesis import strategies as st

from board_rig import machine_file
from counted_readings import CountedTransfers, ReadingsClock
from etd_hal.board import Board
from etd_hal.errors import BusError
from etd_hal.linux.spi import LinuxSpi
from etd_hal.ports import Message, Transfer
from stepped_board import stepped_board
from wire_kernel import Spidev

PULSE = Message((Transfer(b"\x13\x30", cs_change=True), Transfer(delay_us=10), Transfer(b"\0\0")))


def opened(kernel: Spidev) -> LinuxSpi:
    return LinuxSpi(kernel, "/dev/spidev0.0", 10_400_000, kernel.ioctl)


def test_a_pulse_goes_out_as_one_message_with_its_delays_and_gaps() -> None:
    kernel = Spidev()
    opened(kernel).transfer(PULSE)
    first, delay, last = kernel.messages[0]
    assert kernel.requests == [0x40606B00]
    assert (first.tx, first.cs_change, first.delay_us) == (b"\x13\x30", 1, 0)
    assert (delay.tx, delay.delay_us, delay.has_buffers) == (b"", 10, False)
    assert (last.tx, last.cs_change) == (b"\0\0", 0)


def test_every_transfer_says_8_bits_and_the_boards_speed() -> None:
    kernel = Spidev()
    opened(kernel).transfer(PULSE)
    assert {(sent.bits, sent.speed_hz) for sent in kernel.messages[0]} == {(8, 10_400_000)}


transfers = st.builds(
    Transfer, tx=st.binary(max_size=64), delay_us=st.integers(0, 10), cs_change=st.booleans()
)


@given(st.lists(transfers, max_size=20), st.binary(min_size=1, max_size=4))
def test_what_is_read_comes_back_one_entry_for_each_transfer_with_data(
    before: list[Transfer], last: bytes
) -> None:
    message = Message((*before, Transfer(last)))
    answer = opened(Spidev()).transfer(message)
    sent = [transfer.tx for transfer in message.transfers if transfer.tx]
    assert answer == tuple(bytes(byte ^ 0xFF for byte in tx) for tx in sent)


def test_buffers_stay_where_they_are_while_thousands_of_messages_come_and_go() -> None:
    kernel = Spidev()
    spi = opened(kernel)
    for code in range(3000):
        spi.transfer(Message((Transfer(code.to_bytes(2, "big")),)))
        gc.collect(0)
        assert spi.transfer(PULSE) == (b"\xec\xcf", b"\xff\xff")
    assert all(message[0].tx == b"\x13\x30" for message in kernel.messages[1::2])


def test_a_message_seen_before_goes_out_from_the_same_memory() -> None:
    kernel = Spidev()
    spi = opened(kernel)
    spi.transfer(PULSE)
    elsewhere = [Message((Transfer(bytes(64)),)) for _ in range(8)]
    for other in elsewhere:
        spi.transfer(other)
    spi.transfer(PULSE)
    assert kernel.addresses[0] == kernel.addresses[-1]
    assert len(set(kernel.addresses)) == 9


def test_a_message_that_was_prepared_is_not_read_again_when_it_is_sent() -> None:
    spi, transfers = opened(Spidev()), CountedTransfers(PULSE.transfers)
    message = Message(transfers)
    spi.prepare(message)
    before = transfers.readings
    assert before > 0
    assert spi.transfer(message) == (b"\xec\xcf", b"\xff\xff")
    spi.prepare(message)
    assert transfers.readings == before


def test_between_its_begin_and_its_end_a_message_is_sent_and_nothing_else() -> None:
    """Both are what the ledger, the drift and the stopper go by."""
    stepped, silent = stepped_board(), (Transfer(bytes(2), cs_change=True), Transfer(bytes(2)))
    transfers = CountedTransfers(silent)
    clock = ReadingsClock(transfers)
    board = Board(
        stepped.board,
        machine_file(),
        stepped.backend.codec,
        opened(Spidev()),
        stepped.backend.gpio,
        clock,
    )
    board.guard.spi.transfer(Message(transfers))
    assert board.guard.spi.begun_ns > 0
    assert board.guard.spi.ended_ns == board.guard.spi.begun_ns


@pytest.mark.parametrize("first", ["prepared", "sent"])
def test_a_message_stays_prepared_while_thousands_of_others_come_and_go(first: str) -> None:
    spi, transfers = opened(Spidev()), CountedTransfers(PULSE.transfers)
    message = Message(transfers)
    if first == "prepared":
        spi.prepare(message)
    else:
        spi.transfer(message)
    before = transfers.readings
    others = [Message((Transfer(code.to_bytes(2, "big")),)) for code in range(3000)]
    for other in others:
        spi.transfer(other)
    assert spi.transfer(message) == (b"\xec\xcf", b"\xff\xff")
    assert transfers.readings == before


def test_the_buffers_of_a_message_go_with_it_without_any_collection() -> None:
    """Collection is off while a daemon runs."""
    spi, message = opened(Spidev()), Message(PULSE.transfers)
    spi.transfer(message)
    buffer = weakref.ref(message.made[spi].data)
    assert buffer() is not None
    gc.disable()
    try:
        del message
        assert buffer() is None
    finally:
        gc.enable()


def test_each_port_lays_out_what_another_one_has_prepared() -> None:
    kernel, transfers = Spidev(), CountedTransfers(PULSE.transfers)
    message = Message(transfers)
    opened(Spidev()).prepare(message)
    before = transfers.readings
    assert opened(kernel).transfer(message) == (b"\xec\xcf", b"\xff\xff")
    assert transfers.readings > before


def test_equal_messages_are_told_apart_and_each_is_answered() -> None:
    spi = opened(Spidev())
    message, same = Message((Transfer(b"\x01\x02"),)), Message((Transfer(b"\x01\x02"),))
    assert spi.transfer(message) == spi.transfer(same) == (b"\xfe\xfd",)


def data_transfers(count: int, length: int = 2) -> Message:
    return Message((Transfer(bytes(length)),) * count)


@pytest.mark.parametrize(
    ("message", "kind"),
    [
        (data_transfers(33), "too_long"),
        (data_transfers(17, length=129), "too_long"),
        (Message((Transfer(delay_us=1),) * 512), "invalid"),
        (Message(()), "invalid"),
        (Message((Transfer(b"\0\0", cs_change=True),)), "invalid"),
        (Message((Transfer(delay_us=-1),)), "invalid"),
        (Message((Transfer(delay_us=65_536),)), "invalid"),
    ],
    ids=["33 words", "17 x 256", "512 transfers", "none", "cs kept", "negative", "over 16 bits"],
)
def test_what_the_kernel_would_misread_is_refused_before_it_sees_it(
    message: Message, kind: str
) -> None:
    kernel = Spidev()
    spi = opened(kernel)
    for send in (spi.prepare, spi.transfer):
        with pytest.raises(BusError) as caught:
            send(message)
        assert caught.value.kind == kind
    assert kernel.messages == []


def test_32_words_among_511_transfers_are_taken() -> None:
    kernel = Spidev()
    word = (Transfer(b"\0\0"),)
    opened(kernel).transfer(Message(word * 31 + (Transfer(delay_us=10),) * 479 + word))
    assert len(kernel.messages[0]) == 511


def test_a_short_return_is_an_error_even_if_the_kernel_calls_it_a_success() -> None:
    with pytest.raises(BusError, match="2 of 4 bytes") as caught:
        opened(Spidev(lose_bytes=2)).transfer(PULSE)
    assert caught.value.kind == "short"


@pytest.mark.parametrize(
    ("number", "kind"),
    [
        (errno.EIO, "io"),
        (errno.ETIMEDOUT, "timeout"),
        (errno.ESHUTDOWN, "gone"),
        (errno.EMSGSIZE, "too_long"),
        (errno.EINVAL, "invalid"),
    ],
)
def test_the_kernels_refusals_keep_their_kind_and_name_the_device(number: int, kind: str) -> None:
    with pytest.raises(BusError, match=r"/dev/spidev0\.0") as caught:
        opened(Spidev(fail_errno=number)).transfer(PULSE)
    assert caught.value.kind == kind


def test_closing_closes_the_device() -> None:
    kernel = Spidev()
    spi = opened(kernel)
    spi.close()
    spi.close()
    assert not kernel.is_open
