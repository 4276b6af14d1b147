"""The last guard, to the last step of each figure: the worst case, the probe's bounds, what it
permits before anybody has told it anything, and what it counts as time.

Bounds are tried on a board of 1 uA for each code, and a machine where the guard reckons 30 us a
word and 2 us on top of a delay at worst, 12 us a word at best: all sums are whole numbers.
"""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pytest

from board_rig import ZERO_WORD, BoardRig, changed, fire_phase, machine_file, pulse_words
from etd_hal.cutlatch import CUTS, CutLatch
from etd_hal.errors import BoardFault, GuardRefusal
from etd_hal.guard import Guard
from etd_hal.ports import Message, Transfer
from etd_hal.switch_shadow import Approval
from guard_bench import ALL, ON, approval, assert_refused, connected, send, silent
from stepped_board import shipped_board, stepped_board

Boards = Callable[..., BoardRig]


def whole(boards: Boards, **maxima: int) -> BoardRig:
    board = changed(shipped_board("kajimoto-hv507"), "source", full_scale_ua=4_095)
    machine = msgspec.structs.replace(machine_file(), guard_word_us=30.0, guard_delay_extra_us=2.0)
    return boards(board=changed(board, "maxima", **maxima), machine=machine)


class TestWorstCase:
    def test_the_width_may_be_the_maximum_and_a_fifth_and_no_microsecond_more(
        self, boards: Boards
    ) -> None:
        """30 + 17 x 12 + 6 = 240 us, of 200 and a fifth."""
        rig = connected(whole(boards))
        widest, wider = pulse_words(100, *[10] * 17, 4), pulse_words(100, *[10] * 17, 5)
        send(rig, widest, approval())
        assert rig.board.guard.lets_width_pass(widest)
        assert assert_refused(rig, "width", wider, approval()).value == "241 us"
        assert not rig.board.guard.lets_width_pass(wider)

    def test_the_charge_may_be_the_maximum_and_a_fifth_and_no_microampere_more(
        self, boards: Boards
    ) -> None:
        """30 + 2 x 12 + 6 = 60 us at 2 mA are 120 nC, of 100 and a fifth; at 2001 uA 120.06."""
        rig = connected(whole(boards, charge_nc=100))
        send(rig, pulse_words(2_000, 10, 10, 4), approval())
        assert_refused(rig, "charge", pulse_words(2_001, 10, 10, 4), approval())


class TestProbe:
    """Into blanked outputs goes a probe alone: 300 uA for 50 us, one of tolerance for rounding."""

    APPROVED = Approval(0b1000, ALL - 0b1000, 1_000, 200, is_blanked=True)

    def blanked(self, boards: Boards) -> BoardRig:
        rig = whole(boards)
        rig.board.prepare(rig.board.selection(3, None))
        rig.board.release()
        return rig

    def test_what_is_just_its_current_and_its_width_is_one(self, boards: Boards) -> None:
        """12 + 39 us at best."""
        rig = self.blanked(boards)
        send(rig, pulse_words(300, 10, 10, 10, 9), self.APPROVED)
        assert rig.body() == [], "it reaches nobody"

    @pytest.mark.parametrize(("code", "last_us"), [(301, 9), (300, 10)])
    def test_what_is_more_by_one_is_none(self, boards: Boards, code: int, last_us: int) -> None:
        message = pulse_words(code, 10, 10, 10, last_us)
        refused = assert_refused(self.blanked(boards), "switch", message, self.APPROVED)
        assert refused.value == "a pulse with nothing connected"


class Untold:
    """A guard that was told nothing yet, on a board of a quarter of a microampere for each code."""

    def __init__(self) -> None:
        self.made = stepped_board("reference-hv507")
        board = changed(self.made.board, "source", full_scale_ua=1_000)
        self.lines, self.cut = board.used_lines(), CutLatch()
        safe_changes = ((self.lines["POL"], 1), (self.lines["BL"], 0))
        ports = self.made.backend.spi, self.made.backend.gpio, self.made.clock
        self.guard = Guard(board, machine_file(), *ports, self.cut, safe_changes)

    def set(self, name: str, level: int) -> None:
        self.guard.gpio.set(((self.lines[name], level),))


class TestBeginning:
    def test_no_current_passes(self) -> None:
        guard = Untold().guard
        with pytest.raises(GuardRefusal) as caught:
            guard.check(pulse_words(1))
        assert (caught.value.rule, caught.value.allowed) == ("state", "0 uA now")
        guard.check(silent())
        assert (guard.spi.begun_ns, guard.spi.ended_ns) == (0, 0), "nothing was sent"

    def test_the_supply_counts_as_off(self) -> None:
        """Inverted and blanked outputs are lifted by nothing, until it comes on."""
        untold = Untold()
        untold.set("POL", 0)
        with pytest.raises(GuardRefusal, match="POL 1 first"):
            untold.set("HV", 1)

    def test_a_cut_is_heeded(self) -> None:
        untold = Untold()
        untold.cut.words[CUTS] = 1
        with pytest.raises(BoardFault, match="cut off by the stopper"):
            untold.set("BL", 1)
        moved = [(event["line"], event["value"]) for event in untold.made.events("gpio")]
        assert (untold.lines["BL"], 1) not in moved


class TestLayingOut:
    """The driver's work before a message: 48 us and 4 for each transfer, once."""

    def test_it_does_not_count_as_time_with_current(self, boards: Boards) -> None:
        rig, message = connected(boards()), pulse_words(409, 10)
        took_ns = []
        for _ in range(2):
            send(rig, message, approval())
            took_ns.append(rig.board.guard.spi.ended_ns - rig.board.guard.spi.begun_ns)
        assert took_ns[0] == pytest.approx(took_ns[1], abs=1_000)

    def test_it_can_be_done_ahead(self, boards: Boards) -> None:
        rig, message = boards(), silent(Transfer(delay_us=1))
        for least_ns, most_ns in ((48_000, 100_000), (0, 0)):
            before_ns = rig.clock.now_ns()
            rig.board.guard.spi.prepare(message)
            assert least_ns <= rig.clock.now_ns() - before_ns <= most_ns


def test_a_refusal_tells_the_word_that_ends_a_message(boards: Boards) -> None:
    codes = (409, 500, 600)
    *first, last = (Transfer((code << 2).to_bytes(2, "big"), cs_change=True) for code in codes)
    message = Message((*first, Transfer(last.tx)))
    refused = assert_refused(connected(boards()), "end of message", message, approval())
    assert (refused.value, refused.allowed) == ("DAC code 600", "DAC code 0")


def test_a_refusal_tells_how_chip_select_is_left(boards: Boards) -> None:
    held = Message((Transfer(ON, cs_change=True), Transfer(ZERO_WORD, cs_change=True)))
    refused = assert_refused(connected(boards()), "chip select", held, approval())
    assert refused.allowed == "released"


@pytest.mark.parametrize("is_reset", [False, True])
def test_after_the_safe_state_relays_that_flip_reverse_no_visit(
    boards: Boards, is_reset: bool
) -> None:
    """They open and close as for a second phase, and as soon; it is a second visit all the same."""
    rig = boards(board=changed(shipped_board("feetthrough-relay"), "maxima", rate_hz=1))
    lines, selection = rig.file.used_lines(), rig.board.selection(3, None)
    pulse = rig.board.pulse(1_000, 100)
    rig.board.prepare(selection)
    rig.board.connect(selection, True)
    fire_phase(rig.board, pulse, selection, True, 1_000, 100)
    if is_reset:
        rig.board.guard.reset(((lines["CLK"], 0), (lines["LE"], 0)))
    rig.board.prepare(selection, whole=True)
    rig.board.flip(selection, False)
    if is_reset:
        with pytest.raises(GuardRefusal, match="2 pulses in a second, allowed is 1"):
            fire_phase(rig.board, pulse, selection, False, 1_000, 100)
    else:
        fire_phase(rig.board, pulse, selection, False, 1_000, 100)


def test_edges_come_through_as_they_are(boards: Boards) -> None:
    rig = boards("reference-hv507")
    rig.fake.world.press("emergency_stop")
    (edge,) = rig.board.guard.gpio.edges()
    assert edge.line == rig.file.used_lines()["EMERGENCY_STOP"]
