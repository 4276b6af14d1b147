"""The bus trace, line by line."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from board_hand import PAUSE, Hand, pulse, word
from etd_hal.fake.trace import Trace
from etd_hal.linesetup import line_setup
from etd_hal.ports import Message, Transfer
from stepped_board import stepped_board

ALL_BOARDS = [
    "kajimoto-hv507",
    "reference-hv507",
    "etactilekit-hv513",
    "etactilekit-hv513-x8",
    "feetthrough-relay",
]


def test_a_trace_is_written_over_an_old_one_and_through_no_link(tmp_path: Path) -> None:
    path, named = tmp_path / "bus.jsonl", tmp_path / "victim"
    path.write_bytes(b"an old one")
    Trace.to(path).close()
    assert path.read_bytes() == b""
    named.write_bytes(b"as it was")
    path.unlink()
    path.symlink_to(named)
    with pytest.raises(OSError, match="symbolic link"):
        Trace.to(path)
    assert named.read_bytes() == b"as it was"
    path.unlink()
    path.hardlink_to(named)
    with pytest.raises(OSError, match="second name"):
        Trace.to(path)
    assert named.read_bytes() == b"as it was"


class TestTrace:
    def test_the_header_is_the_documented_one(self) -> None:
        rig = stepped_board(electrodes=[5, 3, 60])
        header = rig.trace_lines()[0]
        assert list(header) == [
            *("etd_trace", "board", "switch", "outputs", "lines"),
            *("full_scale_ua", "codes", "probe_current_ua", "electrodes"),
        ]
        assert header["lines"] == {
            "POL": 4,
            "DATA": 5,
            "LE": 22,
            "BL": 23,
            "CLK": 24,
            "SYNC": 12,
            "TRIGGER": 13,
        }
        assert (header["switch"], header["electrodes"]) == ("HV507", [5, 3, 60])

    def test_a_relay_board_adds_how_to_read_its_stages(self) -> None:
        header = stepped_board("feetthrough-relay").trace_lines()[0]
        assert list(header)[-5:] == [
            "bits_per_electrode",
            "on_bit",
            "return_bit",
            "ton_us",
            "toff_us",
        ]
        assert set(header["lines"]) == {"DATA", "LE", "CLK", "HV", "SYNC", "TRIGGER"}

    def test_the_reference_board_names_its_guards_lines(self) -> None:
        lines = stepped_board("reference-hv507").trace_lines()[0]["lines"]
        assert set(lines) == {
            *("POL", "DATA", "LE", "BL", "CLK", "HV", "HEARTBEAT"),
            *("READBACK", "EMERGENCY_STOP", "WEARER_STOP", "SYNC", "TRIGGER"),
        }

    @pytest.mark.parametrize("name", ALL_BOARDS)
    def test_the_levels_of_the_request_come_first_in_its_order(self, name: str) -> None:
        rig = stepped_board(name)
        events = [(event["line"], event["value"]) for event in rig.trace_lines()[1:]]
        assert events == list(line_setup(rig.board).outputs)

    def test_a_message_is_written_step_by_step(self) -> None:
        rig = stepped_board()
        Hand(rig).spi.transfer(pulse(0, Transfer(delay_us=7)))
        events = rig.events("spi")
        assert [list(event) for event in events] == [
            ["t_ns", "bus", "event", "transfers"],
            ["t_ns", "bus", "event", "active"],
            ["t_ns", "bus", "event", "tx", "rx", "delay_us", "cs_change"],
            ["t_ns", "bus", "event", "active"],
            ["t_ns", "bus", "event", "active"],
            ["t_ns", "bus", "event", "tx", "rx", "delay_us", "cs_change"],
            ["t_ns", "bus", "event", "tx", "rx", "delay_us", "cs_change"],
            ["t_ns", "bus", "event", "active"],
            ["t_ns", "bus", "event", "bytes"],
        ]
        assert [event["active"] for event in events if event["event"] == "cs"] == [
            *(True, False, True, False)
        ]
        assert events[0]["transfers"] == 3
        assert events[2]["cs_change"] is True
        assert (events[5]["tx"], events[5]["rx"], events[5]["delay_us"]) == ("", "", 7)
        assert events[-1]["bytes"] == 4

    @pytest.mark.parametrize(("output", "polarity"), [(3, 1), (3, 0), (63, 1)])
    def test_each_phase_has_the_bodys_account(self, output: int, polarity: int) -> None:
        rig = stepped_board(electrodes=range(63, -1, -1))
        hand = Hand(rig)
        hand.select(output, polarity)
        before_pc = rig.body.charge_pc(63 - output)
        hand.spi.transfer(pulse(1_228, *[PAUSE] * 8))
        (record,) = rig.events("body")
        rises = [event["t_ns"] for event in rig.events("spi") if event.get("active") is False]
        sign = 1 if polarity else -1
        width_us = (rises[1] - rises[0]) / 1_000
        assert record["electrode"] == 63 - output
        assert (record["from_ns"], record["to_ns"], record["t_ns"]) == (*rises, rises[1])
        assert record["asked_ua"] == sign * round(1_228 * 10_000 / 4_095)
        charge_pc = record["current_ua"] * width_us
        assert charge_pc == pytest.approx(rig.body.charge_pc(63 - output) - before_pc, rel=0.01)
        assert 0 < record["current_ua"] * sign < record["asked_ua"] * sign

    def test_repeating_the_code_for_an_end_sample_is_one_phase(self) -> None:
        rig = stepped_board()
        hand = Hand(rig)
        hand.select(0)
        again = Transfer(word(500), cs_change=True)
        reads = hand.spi.transfer(Message((again, PAUSE, again, Transfer(word(0)))))
        assert len(rig.events("body")) == 1
        samples = [int.from_bytes(read, "big") >> 2 for read in reads]
        assert samples[0] == 0 < samples[1] < samples[2]

    def test_an_engines_mark_stands_between_the_calls(self) -> None:
        rig = stepped_board()
        rig.backend.marker.mark("frame", 7, 3)
        rig.backend.marker.mark("mark", 8, None)
        rig.backend.marker.mark("mark", 9, 'a "µ"')
        assert [list(event.values())[1:] for event in rig.events("engine")] == [
            ["engine", "frame", 7, 3],
            ["engine", "mark", 8, None],
            ["engine", "mark", 9, 'a "µ"'],
        ]

    @given(st.lists(st.integers(0, 5), max_size=12))
    def test_events_are_in_order_of_time_whatever_is_called(self, calls: list[int]) -> None:
        rig = stepped_board("reference-hv507")
        lines = Hand(rig).lines
        for call in calls:
            match call:
                case 0:
                    rig.backend.spi.transfer(pulse(0, PAUSE))
                case 1:
                    rig.backend.gpio.set(((lines.DATA, 1), (lines.CLK, 1)))
                case 2:
                    rig.backend.gpio.edges()
                case 3:
                    assert rig.backend.i2c is not None
                    rig.backend.i2c.transfer(0x48, b"\x00", 2)
                case 4:
                    rig.fake.world.press("wearer_stop", rig.clock.now_ns() + 6_000)
                case _:
                    rig.fake.world.release("wearer_stop")
        times = [event["t_ns"] for event in rig.trace_lines()[1:]]
        assert times == sorted(times)
