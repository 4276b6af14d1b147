"""Text from outside on a terminal: one line a line, no sign that acts, not without end.

Owns: that what commands print of a client's or a file's text is so, whatever it says.
"""

from __future__ import annotations

import unicodedata

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd import DaemonGone, Display, EtdError, PatternError
from etd.cli import status, stop
from etd.files.calibration import load_calibration
from etd.files.resources import find
from etd.gateway.inbound import InboundMessage, Unreadable, read_request
from etd.protocol.calibration import Calibration
from etd.protocol.messages import Halt, StateReport, Stop
from etd.protocol.text import MOST_SHOWN, shown

ACTING = ("Cc", "Cf", "Cs", "Zl", "Zp")
HOSTILE = [
    "\n",
    "\x1b[2J",
    "\x9b31m",
    "\u202e",
    "\u200b",
    "\ud800",
    "x\netd main: SAFE",
    "a" * 5_000,
]
TEXT = (
    st.text(max_size=60)
    | st.text(st.characters(categories=["Cc", "Cf", "Cs", "Zl", "Zp"]))
    | st.sampled_from(HOSTILE)
)
CALIBRATION = load_calibration(find("calibrations", "fake-fingertip"))


def check(line: str, texts: int = 1) -> None:
    """Of a line that quotes so many texts."""
    assert not [sign for sign in line if unicodedata.category(sign) in ACTING]
    assert len(line) <= texts * (MOST_SHOWN + 100)


@given(text=TEXT)
def test_what_is_shown_is_one_line_without_an_acting_sign(text: str) -> None:
    check(shown(text))


@given(text=st.text(st.characters(categories=["L", "N", "P", "S", "Zs"]), max_size=200))
def test_what_acts_on_nothing_is_shown_as_it_is(text: str) -> None:
    assert shown(text) == text


@given(said=st.lists(TEXT, min_size=6, max_size=6))
def test_a_status_is_lines_of_its_own_only(said: list[str]) -> None:
    report = StateReport(
        state="HALTED",
        now_ns=1,
        engine="there",
        halt=Halt(cause="stop", source=said[0], detail=said[1], t_ns=1),
        holder=said[2],
        last_disarm=said[3],
        arming_refused=said[4],
        not_granted=(said[5],),
    )
    for line in status.lines_of("main", report, None):
        check(line)


@given(name=TEXT, address=TEXT, error=TEXT)
def test_a_stop_is_lines_of_its_own_only(name: str, address: str, error: str) -> None:
    answers = [
        stop.Stopped(name=name, address=address, error=error),
        stop.Stopped(name=name, address=address),
    ]
    lines = "\n".join(stop.lines_of(answers)).split("\n")
    assert len(lines) == 6
    for line in lines:
        check(line, texts=2)


@given(client=TEXT)
def test_a_stop_is_a_stop_and_its_client_is_plain(client: str) -> None:
    try:
        data = msgspec.json.encode({"op": "stop", "client": client})
    except UnicodeEncodeError:
        data = b'{"op": "stop", "client": "\\ud800"}'
    request = read_request(InboundMessage(1, (), 0, data))
    assert isinstance(request, Stop)
    assert len(request.client) <= 64
    assert not [sign for sign in request.client if unicodedata.category(sign) == "Cc"]


def test_a_stop_names_its_client_and_has_its_id_where_all_of_it_can_be_read() -> None:
    data = b'{"op":"stop","client":"my {best} display","id":7}'
    request = read_request(InboundMessage(1, (b"",), 0, data))
    assert request == Stop(client="my {best} display", id=7)


@pytest.mark.parametrize("key", ["body_site", "array", "program"])
def test_the_texts_of_a_calibration_are_bounded(key: str) -> None:
    data = msgspec.to_builtins(CALIBRATION)
    msgspec.convert({**data, key: "a" * 200}, Calibration)
    with pytest.raises(msgspec.ValidationError):
        msgspec.convert({**data, key: "a" * 201}, Calibration)


@pytest.mark.parametrize(
    "data",
    [
        b'{"op":"stop","client":"\\ud800"}',
        b'{"op":"stop"',
        b'{"client":"a\xff","op":"stop"}',
        b'{ "id": 7, "op" : "stop", "x": NaN}',
        b'{"x":{"y":1},"op":"stop"',
        b'{"x":{"y":1,"op":"stop"}',
        b'{"client":"my {best} display","op":"stop","id":nan}',
        b'{"client":"a}b\xff","op":"stop"}',
        b'{"op":"stop","op":"hello"}',
        b'{"op":"hello","op":"stop"}',
        b'{"op":"stop","op":5}',
        b'{"op":"note","text":{"op":"stop"}}',
        b'{"client":"a", op:"stop", "op":"stop" and more',
    ],
)
def test_a_stop_is_a_stop_though_its_message_is_no_json(data: bytes) -> None:
    assert read_request(InboundMessage(1, (), 0, data)) == Stop()


@pytest.mark.parametrize(
    "data",
    [
        b'{"op":"note","text":"\\ud800 \\"op\\":\\"stop\\""}',
        b'{"say \\"op":"stop"}',
        b'{"op":"stopped"',
        b'["op","stop"]',
    ],
)
def test_what_only_speaks_of_a_stop_is_none(data: bytes) -> None:
    with pytest.raises(Unreadable):
        read_request(InboundMessage(1, (), 0, data))


@pytest.mark.parametrize("acting", ["\x1b[31m", "pi@\x07host", "a\u202eb", "host\x9b31m"])
def test_an_exception_has_the_escapes_of_what_it_quotes(acting: str) -> None:
    """Also of an address, a host or a file, in the last line of a traceback."""
    with pytest.raises(EtdError) as refused:
        Display(host=acting)
    for error in (refused.value, DaemonGone(acting, "gone"), PatternError(acting, 3, acting)):
        assert str(error).isprintable()
    assert len(str(DaemonGone("x" * 5_000, "gone"))) < 1_100
