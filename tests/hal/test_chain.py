"""A chain of shift register stages: the fewest clocks, and what is known after an error."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from etd_hal.chips.chain import Chain, fewest_clocks
from etd_hal.errors import BoardFault, BusError
from etd_hal.ports import Changes, Edge

DATA, CLK, LE, READBACK = 5, 24, 22, 18


class Register:
    """Stages on the wire: they shift on the rising edge of CLK, first stage nearest to DATA."""

    def __init__(self, stages: int, held: int = 0) -> None:
        self.stages = stages
        self.held = held
        self.calls: list[Changes] = []
        self.clocks = 0
        self.lost_clock = -1
        self.fails_at = -1
        self._levels = {DATA: 0, CLK: 0}

    def set(self, changes: Changes) -> None:
        if len(self.calls) == self.fails_at:
            self.fails_at = -1
            raise BusError("io", "the lines", "set")
        self.calls.append(changes)
        for line, value in sorted(changes):
            rises = line == CLK and value and not self._levels[CLK]
            self._levels[line] = value
            if rises:
                self._shift()

    def _shift(self) -> None:
        if self.clocks != self.lost_clock:
            self.held = (self.held << 1 | self._levels[DATA]) & ((1 << self.stages) - 1)
        self.clocks += 1

    def get(self, line: int) -> int:
        assert line == READBACK
        return self.held >> (self.stages - 1)

    def edges(self) -> tuple[Edge, ...]:
        return ()


def chain_on(register: Register, *, readback: bool = False) -> Chain:
    return Chain(register, register.stages, DATA, CLK, READBACK if readback else None)


def fewest_by_trying(held: int, wanted: int, stages: int) -> int:
    """Whatever goes in, after k clocks the upper stages hold what was there before."""
    full = (1 << stages) - 1
    return next(
        clocks
        for clocks in range(stages + 1)
        if (held << clocks) & full == wanted & full & ~((1 << clocks) - 1)
    )


@given(st.integers(1, 24).flatmap(lambda n: st.tuples(st.just(n), *[st.integers(0, 2**n - 1)] * 2)))
def test_no_fewer_clocks_would_do(case: tuple[int, int, int]) -> None:
    stages, held, wanted = case
    assert fewest_clocks(held, wanted, stages) == fewest_by_trying(held, wanted, stages)


@pytest.mark.parametrize(
    ("held", "wanted", "clocks"),
    [
        (1 << 4, 1 << 4, 0),
        (1 << 4, 1 << 5, 1),
        (1 << 63, 1 << 0, 1),
        (1 << 3, 1 << 10, 7),
        (1 << 60, 1 << 2, 4),
        (1 << 10, 1 << 3, 54),
        (0, 1 << 0, 1),
        (0, 1 << 63, 64),
    ],
)
def test_a_walking_one_needs_as_many_clocks_as_places(held: int, wanted: int, clocks: int) -> None:
    assert fewest_clocks(held, wanted, 64) == clocks


@given(st.lists(st.integers(0, 2**16 - 1), min_size=1, max_size=6), st.integers(0, 2**16 - 1))
def test_after_each_write_the_chain_holds_the_word(words: list[int], at_power_up: int) -> None:
    register = Register(16, at_power_up)
    chain = chain_on(register)
    for word in words:
        chain.write(word)
        assert register.held == chain.held == word


def test_the_first_write_is_a_whole_one() -> None:
    register = Register(8, 0b0001)
    chain_on(register).write(0b0001)
    assert register.clocks == 8


def test_a_step_of_the_walking_one_is_two_calls() -> None:
    register = Register(8)
    chain = chain_on(register)
    chain.write(1 << 2)
    register.calls.clear()
    chain.write(1 << 3)
    assert register.calls == [((DATA, 0), (CLK, 1)), ((CLK, 0),)]


def test_what_falls_with_the_last_clock_falls_once() -> None:
    register = Register(8)
    chain = chain_on(register)
    chain.write(1)
    register.calls.clear()
    chain.write(1 << 2, ((LE, 1), (CLK, 0)))
    assert register.calls[1::2] == [((CLK, 0),), ((LE, 1), (CLK, 0))]


def test_what_shall_fall_with_the_last_clock_also_goes_out_without_any_clock() -> None:
    register = Register(8)
    chain = chain_on(register)
    chain.write(1)
    register.calls.clear()
    chain.write(1, ((LE, 1), (CLK, 0)))
    assert register.calls == [((LE, 1), (CLK, 0))]


@pytest.mark.parametrize("how", ["write", "rewrite"])
@pytest.mark.parametrize("fails_at", [0, 1, 5])
def test_after_a_call_that_failed_the_next_write_is_a_whole_one(how: str, fails_at: int) -> None:
    register = Register(8)
    chain = chain_on(register)
    chain.write(1)
    register.fails_at = len(register.calls) + fails_at
    with pytest.raises(BusError):
        getattr(chain, how)(1 << 3)
    clocks = register.clocks
    chain.write(1 << 4)
    assert register.clocks - clocks == 8
    assert register.held == 1 << 4


def test_forgotten_content_is_written_whole() -> None:
    register = Register(8)
    chain = chain_on(register)
    chain.write(1)
    chain.reset()
    register.held = 0b1010_1010
    chain.write(1 << 1)
    assert register.held == 1 << 1


def test_a_rewrite_shifts_the_whole_chain_whatever_it_holds() -> None:
    register = Register(8)
    chain = chain_on(register, readback=True)
    chain.write(1 << 2)
    clocks = register.clocks
    chain.rewrite(1 << 2)
    assert register.clocks - clocks == 8
    assert register.held == 1 << 2


@given(st.integers(0, 2**12 - 1), st.integers(0, 2**12 - 1))
def test_an_intact_chain_passes_its_readback(held: int, wanted: int) -> None:
    register = Register(12, 0b1100_0011_1010)
    chain = chain_on(register, readback=True)
    chain.write(held)
    chain.rewrite(wanted)
    assert register.held == wanted


@given(st.integers(0, 11), st.data())
def test_a_lost_clock_shows_when_the_chain_is_read_back(output: int, data: st.DataObject) -> None:
    register = Register(12)
    chain = chain_on(register, readback=True)
    chain.write(1)
    register.lost_clock = register.clocks + data.draw(st.integers(0, output), "which clock")
    for place in range(1, output + 2):
        chain.write(1 << place % 12)
    with pytest.raises(BoardFault, match="readback"):
        chain.rewrite(1)


@pytest.mark.parametrize(("stuck", "measured"), [(0, "0"), (2**8 - 1, "1")])
def test_a_stuck_output_is_told_with_what_it_showed(stuck: int, measured: str) -> None:
    register = Register(8)
    chain = chain_on(register, readback=True)
    chain.write(1 << 5)
    register.held = stuck
    with pytest.raises(BoardFault) as caught:
        chain.rewrite(1)
    assert caught.value.measured == measured
    assert chain.held is None


def test_without_a_readback_line_nothing_is_read() -> None:
    register = Register(8)
    chain = chain_on(register)
    chain.write(1 << 5)
    register.held = 0
    chain.rewrite(1)
    assert register.held == 1
