"""The fake's chip models against golden words of their datasheets."""

from __future__ import annotations

from typing import Literal

import pytest

from etd_body.interface import Side, Sides
from etd_hal.boardfile import RelayLines, Relays
from etd_hal.fake.ad5452 import Ad5452
from etd_hal.fake.ad7276 import Ad7276
from etd_hal.fake.faults import (
    AlsoSwitches,
    DataFlipped,
    ExtraClock,
    Fault,
    LatchIgnored,
    LostClock,
)
from etd_hal.fake.faults_due import Faults
from etd_hal.fake.halfbridges import HalfBridgeChain
from etd_hal.fake.i2cchips import Ads1115, Mcp4725
from etd_hal.fake.relays import RelayChain

S, G, OPEN = Side.SOURCE, Side.GROUND, Side.OPEN
MS = 1_000_000


class DacBench:
    """An AD5452 with what it puts out and complains about."""

    def __init__(self, mode: int = 1) -> None:
        self.codes: list[int] = []
        self.complaints: list[str] = []
        self.mode = mode
        self.chip = Ad5452(
            lambda _t_ns, code: self.codes.append(code),
            lambda _t_ns, what: self.complaints.append(what),
        )

    def frame(self, hexadecimal: str) -> None:
        self.chip.select()
        self.chip.shift(bytes.fromhex(hexadecimal), self.mode)
        self.chip.deselect(0)


class TestAd5452:
    @pytest.mark.parametrize(
        ("word", "code"), [("0000", 0), ("1330", 1228), ("3ffc", 4095), ("0004", 1), ("2000", 2048)]
    )
    def test_a_load_word_sets_its_code(self, word: str, code: int) -> None:
        dac = DacBench()
        dac.frame(word)
        assert (dac.codes, dac.complaints) == ([code], [])

    def test_the_output_changes_when_chip_select_rises_not_before(self) -> None:
        dac = DacBench()
        dac.chip.select()
        dac.chip.shift(b"\x13\x30", 1)
        assert dac.codes == []
        dac.chip.deselect(0)
        assert dac.codes == [1228]

    @pytest.mark.parametrize("mode", [0, 1, 2])
    def test_modes_0_to_2_are_aligned(self, mode: int) -> None:
        dac = DacBench(mode)
        dac.frame("2000")
        assert dac.codes == [2048]

    def test_mode_3_moves_the_word_by_a_bit_to_half_the_current(self) -> None:
        dac = DacBench(mode=3)
        dac.frame("2000")
        assert dac.codes == [1024]

    @pytest.mark.parametrize("word", ["4000", "8000", "7ffc"])
    def test_reserved_control_bits_change_nothing_and_are_told(self, word: str) -> None:
        dac = DacBench()
        dac.frame(word)
        assert dac.codes == []
        assert "reserved" in dac.complaints[0]

    def test_control_11_changes_the_clock_edge_until_power_is_removed(self) -> None:
        dac = DacBench()
        dac.frame("c000")
        dac.frame("2000")
        assert dac.codes == [1024], "in mode 1 data changes on the rising edge now sampled"
        assert "stuck" in dac.complaints[0]

    def test_a_short_frame_is_taken_with_the_bits_left_over_and_told(self) -> None:
        dac = DacBench()
        dac.frame("0004")
        dac.frame("20")
        assert dac.codes == [1, 0x0420 >> 2]
        assert "8 clocks" in dac.complaints[0]

    def test_a_long_frame_is_told(self) -> None:
        dac = DacBench()
        dac.frame("00001330")
        assert "32 clocks" in dac.complaints[0]


class TestAd7276:
    def read(self, adc: Ad7276, code: int, mode: int = 1) -> int:
        adc.select(code)
        word = int.from_bytes(adc.shift(2, mode), "big")
        adc.deselect()
        return word

    @pytest.mark.parametrize(("code", "word"), [(0, 0), (1, 0x0004), (437, 0x06D4), (4095, 0x3FFC)])
    def test_the_frame_is_two_zeros_twelve_bits_two_zeros(self, code: int, word: int) -> None:
        assert self.read(Ad7276(), code) == word

    def test_mode_3_loses_a_leading_zero(self) -> None:
        assert self.read(Ad7276(), 437, mode=3) >> 3 == 437

    def test_after_twelve_bits_there_are_only_zeros(self) -> None:
        adc = Ad7276()
        adc.select(4095)
        assert adc.shift(4, 1).hex() == "3ffc0000"

    def test_a_frame_cut_short_spoils_the_next_conversion(self) -> None:
        adc = Ad7276()
        adc.select(1_000)
        adc.shift(1, 1)
        adc.deselect()
        assert self.read(adc, 1_000) == 0
        assert self.read(adc, 1_000) == 1_000 << 2


class ChainBench:
    """Eight half-bridges with all their inputs on a test's fingers."""

    def __init__(self, *faults: Fault) -> None:
        self.seen: list[Sides] = []
        self.chain = HalfBridgeChain(
            8, range(8), Faults(faults), lambda _t_ns, sides: self.seen.append(sides), seed=5
        )

    def set(self, **levels: int) -> None:
        for name, level in levels.items():
            self.chain.set(0, name, level)

    def shift(self, bits: str) -> None:
        for bit in bits:
            self.set(DATA=int(bit), CLK=1)
            self.set(CLK=0)

    def latch(self) -> None:
        self.set(LE=1)
        self.set(LE=0)

    @property
    def picture(self) -> str:
        return "".join("H" if side is S else "L" for side in self.chain.sides)


class TestHalfBridges:
    def test_the_function_table(self) -> None:
        bench = ChainBench()
        bench.shift("00000001")
        bench.latch()
        seen = {}
        for blank, polarity in ((0, 1), (1, 1), (1, 0), (0, 0)):
            bench.set(BL=blank, POL=polarity)
            seen[blank, polarity] = bench.picture
        assert seen == {
            (0, 0): "HHHHHHHH",
            (0, 1): "LLLLLLLL",
            (1, 0): "LHHHHHHH",
            (1, 1): "HLLLLLLL",
        }

    def test_each_further_clock_moves_the_selection_by_one(self) -> None:
        bench = ChainBench()
        bench.shift("00000001")
        bench.shift("0")
        bench.latch()
        bench.set(BL=1)
        assert bench.picture == "LHLLLLLL"

    def test_it_shifts_whatever_latch_blank_and_polarity_are(self) -> None:
        bench = ChainBench()
        bench.set(BL=1, POL=0, LE=1)
        bench.shift("10000000")
        bench.set(POL=1)
        assert bench.picture == "LLLLLLLH"

    def test_an_open_latch_lets_the_register_ripple_through(self) -> None:
        bench = ChainBench()
        bench.shift("00000000")
        bench.set(LE=1, BL=1)
        bench.seen.clear()
        bench.shift("100")
        assert [sides.index(S) for sides in bench.seen] == [0, 1, 2]

    def test_a_closed_latch_holds(self) -> None:
        bench = ChainBench()
        bench.shift("00000001")
        bench.latch()
        bench.set(BL=1)
        bench.shift("11111111")
        assert bench.picture == "HLLLLLLL"

    def test_the_register_holds_anything_at_power_up(self) -> None:
        bench = ChainBench()
        bench.latch()
        bench.set(BL=1)
        assert bench.picture not in ("LLLLLLLL", "HHHHHHHH")

    def test_data_out_is_the_last_stage(self) -> None:
        bench = ChainBench()
        bench.shift("10000000")
        assert bench.chain.data_out == 1
        bench.shift("0")
        assert bench.chain.data_out == 0

    def test_a_lost_clock_leaves_the_selection_one_behind(self) -> None:
        bench = ChainBench(LostClock(at_edge=9))
        bench.shift("000000010")
        bench.latch()
        bench.set(BL=1)
        assert bench.picture == "HLLLLLLL"

    def test_an_extra_clock_leaves_the_selection_one_ahead(self) -> None:
        bench = ChainBench(ExtraClock(at_edge=9))
        bench.shift("000000010")
        bench.latch()
        bench.set(BL=1)
        assert bench.picture == "LLHLLLLL"

    def test_a_flipped_bit_is_taken_once(self) -> None:
        bench = ChainBench(DataFlipped(at_edge=3))
        bench.shift("00000001")
        bench.latch()
        bench.set(BL=1)
        assert bench.picture == "HLLLLHLL"

    def test_every_so_many_is_as_often(self) -> None:
        bench = ChainBench(DataFlipped(every=4))
        bench.shift("00000000")
        bench.latch()
        bench.set(BL=1)
        assert bench.picture == "HLLLHLLL"

    def test_an_ignored_latch_keeps_the_old_selection(self) -> None:
        bench = ChainBench(LatchIgnored(at_edge=2))
        bench.shift("00000001")
        bench.latch()
        bench.shift("0")
        bench.latch()
        bench.set(BL=1)
        assert bench.picture == "HLLLLLLL"

    def test_one_state_is_one_object(self) -> None:
        bench = ChainBench()
        first = bench.chain.sides
        bench.set(BL=1)
        bench.set(BL=0)
        assert bench.chain.sides is first


class RelayBench:
    """Two electrodes' relays."""

    def __init__(self, *faults: Fault, ton_us: int = 300, toff_us: int = 200) -> None:
        self.moved: list[tuple[int, Sides, bool]] = []
        switch = Relays(
            outputs=2,
            lines=RelayLines(DATA=5, LE=22, CLK=24),
            on_bit=0,
            return_bit=1,
            ton_us=ton_us,
            toff_us=toff_us,
        )
        self.chain = RelayChain(
            switch,
            range(2),
            Faults(faults),
            lambda t_ns, sides, shorted: self.moved.append((t_ns, sides, shorted)),
            seed=7,
        )

    def write(self, t_ns: int, bits: str) -> None:
        """Shift the last stage first, then copy."""
        for bit in bits:
            self.chain.set(t_ns, "DATA", int(bit))
            self.chain.set(t_ns, "CLK", 1)
            self.chain.set(t_ns, "CLK", 0)
        self.chain.set(t_ns, "LE", 1)
        self.chain.set(t_ns, "LE", 0)


class TestRelays:
    def test_relays_close_and_open_after_their_times(self) -> None:
        bench = RelayBench()
        bench.write(0, "0000")
        bench.chain.settle(1 * MS)
        assert bench.chain.sides == (OPEN, OPEN)
        bench.moved.clear()
        bench.write(1 * MS, "1001")
        bench.chain.settle(1_299_999)
        assert bench.moved == []
        bench.chain.settle(1_300_000)
        assert bench.moved == [(1_300_000, (S, G), False)]
        bench.write(2 * MS, "0000")
        bench.chain.settle(3 * MS)
        assert bench.moved[1:] == [(2_200_000, (OPEN, OPEN), False)]

    def test_both_relays_of_one_electrode_are_told_as_shorted(self) -> None:
        bench = RelayBench()
        bench.write(0, "0000")
        bench.chain.settle(1 * MS)
        bench.write(1 * MS, "0011")
        bench.chain.settle(2 * MS)
        assert bench.moved[-1][2] is True

    @pytest.mark.parametrize(
        ("polarity", "bits"), [(None, "1001"), ("anodic", "1001"), ("cathodic", "0110")]
    )
    def test_a_relay_that_closes_anothers_along_puts_that_ones_source_on_ground(
        self, polarity: Literal["anodic", "cathodic"] | None, bits: str
    ) -> None:
        bench = RelayBench(AlsoSwitches(0, 1, polarity))
        shorted: dict[str, bool] = {}
        for now in ("1001", "0110"):
            bench.write(len(shorted) * 2 * MS, "0000")
            bench.chain.settle((len(shorted) * 2 + 1) * MS)
            bench.write((len(shorted) * 2 + 1) * MS, now)
            bench.chain.settle((len(shorted) + 1) * 2 * MS)
            shorted[now] = bench.chain.shorted
        assert shorted == {now: now == bits for now in ("1001", "0110")}

    @pytest.mark.parametrize(("toff_us", "meanwhile"), [(200, False), (400, True)])
    def test_make_without_break_shorts_when_a_relay_opens_late(
        self, toff_us: int, meanwhile: bool
    ) -> None:
        bench = RelayBench(toff_us=toff_us)
        bench.write(0, "0000")
        bench.chain.settle(1 * MS)
        bench.write(1 * MS, "0001")
        bench.chain.settle(2 * MS)
        bench.write(2 * MS, "0010")
        bench.chain.settle(3 * MS)
        assert [shorted for _, _, shorted in bench.moved[-2:]] == [meanwhile, False]
        assert bench.chain.sides == (G, OPEN)

    def test_a_relay_driven_back_in_time_does_not_move(self) -> None:
        bench = RelayBench()
        bench.write(0, "0000")
        bench.chain.settle(1 * MS)
        bench.moved.clear()
        bench.write(1 * MS, "0001")
        bench.write(1 * MS + 100_000, "0000")
        bench.chain.settle(3 * MS)
        assert bench.moved == []

    def test_outputs_follow_the_copy_not_the_shift(self) -> None:
        bench = RelayBench()
        bench.write(0, "0000")
        bench.chain.settle(1 * MS)
        bench.moved.clear()
        for _ in range(4):
            bench.chain.set(1 * MS, "DATA", 1)
            bench.chain.set(1 * MS, "CLK", 1)
            bench.chain.set(1 * MS, "CLK", 0)
        bench.chain.settle(2 * MS)
        assert bench.moved == []
        assert bench.chain.data_out == 1


class TestAds1115:
    #: OS, AIN0 against ground, 4.096 V, single shot, 860 a second, comparator off.
    START = bytes((1, 0xC3, 0xE3))

    def test_a_conversion_reads_back_after_its_period(self) -> None:
        adc = Ads1115(lambda _t_ns, channel: (3.0, 1.0, 0.0, 0.0)[channel])
        adc.write(0, self.START)
        adc.write(0, b"\x00")
        assert adc.read(1 * MS, 2) == b"\x00\x00"
        assert adc.read(2 * MS, 2) == (24_000).to_bytes(2, "big")

    def test_the_os_bit_tells_when_it_is_ready(self) -> None:
        adc = Ads1115(lambda _t_ns, _channel: 1.0)
        adc.write(0, self.START)
        assert adc.read(1 * MS, 2)[0] & 0x80 == 0
        assert adc.read(2 * MS, 2)[0] & 0x80 == 0x80

    def test_the_multiplexer_chooses_the_channel(self) -> None:
        adc = Ads1115(lambda _t_ns, channel: float(channel))
        adc.write(0, bytes((1, 0xE3, 0xE3)))
        adc.write(0, b"\x00")
        assert adc.read(2 * MS, 2) == (16_000).to_bytes(2, "big")

    def test_an_input_above_the_supply_reads_as_the_supply(self) -> None:
        adc = Ads1115(lambda _t_ns, _channel: 12.0)
        adc.write(0, self.START)
        adc.write(0, b"\x00")
        assert adc.read(2 * MS, 2) == round(3.3 / 4.096 * 32_768).to_bytes(2, "big")

    def test_the_sample_is_of_the_instant_the_conversion_started(self) -> None:
        adc = Ads1115(lambda t_ns, _channel: 1.0 if t_ns < 500_000 else 2.0)
        adc.write(0, self.START)
        adc.write(0, b"\x00")
        assert adc.read(2 * MS, 2) == (8_000).to_bytes(2, "big")


class TestMcp4725:
    def test_a_fast_write_sets_the_output(self) -> None:
        codes: list[int] = []
        dac = Mcp4725(lambda _t_ns, code: codes.append(code))
        dac.write(0, bytes((0x0D, 0xAC)))
        assert codes == [0xDAC]
        assert dac.read(0, 3) == bytes((0x80, 0xDA, 0xC0))

    def test_a_long_write_to_the_eeprom_reads_back_there(self) -> None:
        dac = Mcp4725(lambda _t_ns, _code: None)
        dac.write(0, bytes((0x60, 0xDA, 0xC0)))
        assert dac.read(0, 5) == bytes((0x80, 0xDA, 0xC0, 0x0D, 0xAC))

    def test_power_down_takes_the_output_away(self) -> None:
        codes: list[int] = []
        dac = Mcp4725(lambda _t_ns, code: codes.append(code))
        dac.write(0, bytes((0x1D, 0xAC)))
        assert codes == [0]
