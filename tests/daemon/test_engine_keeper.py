"""An engine that is silent with the supply on is cut; what stood still meanwhile is never shown;
and a crash is remembered until it is cleared.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import engine_rig
from engine_rig import LEASE, EngineRig
from engine_scenes import MS, armed, fully_open, halts, moves, only, phases
from etd.protocol.link import Alive, ArmBoard, ClearHalt, DisarmBoard, KeepLease, StopNow
from etd_hal.cutlatch import ALIVE_NS
from etd_hal.stopper import PERIOD_NS
from etd_hal.supply_note import SupplyNote

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
REFERENCE, KIT, RELAYS = "reference-hv507", "kajimoto-hv507", "feetthrough-relay"
BOARDS = [REFERENCE, KIT, RELAYS]
#: The reference board's heartbeat; the others have none.
WINDOW_MS = {REFERENCE: 20, KIT: 100, RELAYS: 100}
MARGIN_MS = 5
ELECTRODES = {REFERENCE: 16, KIT: 16, RELAYS: 32}


def rig_on(make_rig: MakeRig, board: str) -> EngineRig:
    return fully_open(make_rig(board, electrodes=ELECTRODES[board]), 400)


def keeping(rig: EngineRig) -> Callable[[int], None]:
    """A client that keeps its lease while it waits."""

    def keep(_: int) -> None:
        rig.commands.send(KeepLease(ref=0, lease=LEASE))

    return keep


# --- silence --------------------------------------------------------------------------------------


@pytest.mark.parametrize("board", BOARDS)
def test_a_silent_engine_is_cut_within_the_window_and_five_ms(
    make_rig: MakeRig, board: str
) -> None:
    rig = rig_on(make_rig, board)
    cut = rig.engine.components.board.cut
    silent_from_ns = cut.words[ALIVE_NS]
    rig.clock.spend(silent_from_ns + WINDOW_MS[board] * MS - rig.clock.now_ns())
    assert not cut.is_cut, "within the window it is not silent"
    rig.clock.spend(MARGIN_MS * MS)
    assert cut.is_cut
    if board != KIT:
        off_ns = next(t_ns for t_ns, level in moves(rig, "HV", silent_from_ns) if not level)
        assert off_ns - silent_from_ns <= (WINDOW_MS[board] + MARGIN_MS) * MS
    rig.run_ms(5)
    assert rig.state == "HALTED"
    (halt,) = halts(rig)
    assert (halt.cause, halt.source) == ("fault", "stopper")
    assert f"no poll for more than {WINDOW_MS[board]} ms" in halt.detail
    assert rig.ask(ArmBoard).error == "halted"
    assert rig.ask(ClearHalt).error is None
    rig.open()
    rig.arm()
    assert rig.state == "ARMED"


@pytest.mark.parametrize("board", BOARDS)
def test_an_engine_without_supply_may_be_silent(make_rig: MakeRig, board: str) -> None:
    rig = armed(make_rig(board))
    assert rig.ask(DisarmBoard, lease=LEASE).error is None
    rig.clock.spend(900 * MS)
    rig.run_ms(50)
    assert halts(rig) == []


@pytest.mark.parametrize("board", BOARDS)
def test_what_polls_at_the_last_moment_is_not_silent(make_rig: MakeRig, board: str) -> None:
    rig = armed(make_rig(board))
    for _ in range(20):
        rig.clock.spend((WINDOW_MS[board] - 6) * MS)
        rig.step()
    assert halts(rig) == []


@settings(max_examples=30)
@given(
    board=st.sampled_from([REFERENCE, KIT]),
    is_whole_machine=st.booleans(),
    sent_ms=st.lists(st.integers(0, 4_999), min_size=1, max_size=8, unique=True).map(sorted),
    ttl_ms=st.integers(1, 1_000),
    is_kept=st.booleans(),
)
def test_a_frame_sent_while_the_daemon_stood_still_for_five_seconds_is_never_shown(
    board: str, is_whole_machine: bool, sent_ms: list[int], ttl_ms: int, is_kept: bool
) -> None:
    """Whenever in it, however long it would have stood, and also if the client kept its lease."""
    rig = fully_open(engine_rig.make(board, electrodes=16), 400)
    rig.stopper.is_looking = not is_whole_machine
    begun_ns = rig.clock.now_ns()
    refs = []
    for at_ms in sent_ms:
        rig.clock.spend(begun_ns + at_ms * MS - rig.clock.now_ns())
        rig.commands.send(Alive())
        if is_kept:
            rig.commands.send(KeepLease(ref=0, lease=LEASE))
        refs.append(rig.send(current_ua=only(16, e3=400), ttl_ms=ttl_ms))
    rig.clock.spend(begun_ns + 5_000 * MS - rig.clock.now_ns())
    rig.stopper.is_looking = True
    back_ns = rig.clock.now_ns()
    rig.run_ms(300)
    assert phases(rig, back_ns) == []
    assert rig.state == ("SAFE" if is_whole_machine else "HALTED")
    assert rig.close() == ()


# --- the note of the supply -----------------------------------------------------------------------


class Kept:
    """A note in a folder, and the engines that come one after the other."""

    def __init__(self, make_rig: MakeRig, folder: Path) -> None:
        self.path = folder / "supply.json"
        self._make_rig = make_rig
        self.told: list[str] = []

    def rig(self, board: str = KIT) -> EngineRig:
        return self._make_rig(board, supply_note=SupplyNote(self.path), tell=self.told.append)

    @property
    def is_there(self) -> bool:
        return self.path.exists()


@pytest.fixture
def kept(make_rig: MakeRig, tmp_path: Path) -> Kept:
    return Kept(make_rig, tmp_path)


@pytest.mark.parametrize("board", BOARDS)
def test_the_note_is_there_before_the_supply_is_on_and_gone_when_it_is_off(
    kept: Kept, board: str
) -> None:
    rig = kept.rig(board)
    rig.open()
    if rig.engine.components.loaded.board.guards.wearer_stop != "absent":
        rig.try_wearer_stop()
    assert not kept.is_there
    seen: list[tuple[bool, bool]] = []
    board_of_rig = rig.engine.components.board

    keep = keeping(rig)

    def look(_: int) -> None:
        keep(0)
        seen.append((board_of_rig.is_supply_on, kept.is_there))

    rig.meanwhile = look
    assert rig.ask(ArmBoard).error is None
    if board != KIT:
        assert (True, False) not in seen
    assert kept.is_there
    assert rig.ask(DisarmBoard, lease=LEASE).error is None
    assert not kept.is_there
    assert rig.ask(ArmBoard).error is None
    rig.ask(StopNow, client="operator")
    assert rig.state == "HALTED"
    assert not kept.is_there, "a halt has made the board safe"


def test_an_engine_that_ends_in_order_leaves_nothing(kept: Kept) -> None:
    rig = armed(kept.rig())
    assert kept.is_there
    assert rig.engine.supervisor.end() == ()
    assert not kept.is_there
    assert kept.rig().state == "SAFE"


def test_after_a_crash_arming_is_refused_until_it_is_cleared(kept: Kept) -> None:
    armed(kept.rig())
    assert kept.is_there, "nothing follows: the engine was killed"
    rig = kept.rig()
    assert rig.state == "HALTED"
    assert (
        "the last engine was killed with the supply on, or could not make the board safe"
        in kept.told[0]
    )
    rig.run_ms(10)
    report = rig.engine.supervisor.state_report(rig.clock.now_ns())
    assert report.halt is not None
    assert (report.halt.cause, report.halt.source) == ("fault", "crash")
    assert rig.ask(ArmBoard).error == "halted"
    assert kept.is_there
    # It is no matter of this engine's life alone: one more start says the same.
    assert rig.engine.supervisor.end() == ()
    assert kept.is_there
    rig = kept.rig()
    assert rig.state == "HALTED"
    assert rig.ask(ClearHalt).error is None
    assert not kept.is_there
    rig.open()
    rig.arm()
    assert rig.state == "ARMED"


def ended_by_defect(rig: EngineRig) -> None:
    """As the engine's process does with what a step raises, in its order."""
    supervisor = rig.engine.supervisor
    supervisor.supply.remember_defect(is_powered=supervisor.is_powered)
    assert supervisor.end() == ()
    assert supervisor.end() == (), "the caller repeats it"
    rig.stopper.end()
    supervisor.supply.note_defect()


def test_a_defect_while_armed_makes_the_board_safe_and_is_remembered(kept: Kept) -> None:
    rig = armed(kept.rig(REFERENCE))
    ended_by_defect(rig)
    assert not rig.engine.components.board.is_supply_on
    assert moves(rig, "HV")[-1][1] == 0
    rig = kept.rig(REFERENCE)
    assert rig.state == "HALTED"
    assert "the last engine was ended by a defect of its own with the supply on" in kept.told[0]
    assert rig.ask(ArmBoard).error == "halted"
    assert rig.ask(ClearHalt).error is None
    assert not kept.is_there
    rig.open()
    rig.arm()
    assert rig.state == "ARMED"


def test_a_defect_once_the_supply_has_just_gone_off_is_remembered_too(kept: Kept) -> None:
    """It comes in what is still to be done then: by its state the board is armed."""
    rig = armed(kept.rig())
    assert rig.engine.supervisor.supply.off() == ()
    assert not kept.is_there
    ended_by_defect(rig)
    assert kept.rig().state == "HALTED"
    assert "ended by a defect of its own" in kept.told[0]


def test_a_defect_without_supply_is_no_crash_to_the_next_engine(kept: Kept) -> None:
    ended_by_defect(kept.rig())
    rig = armed(kept.rig())
    assert rig.ask(DisarmBoard, lease=LEASE).error is None
    ended_by_defect(rig)
    assert not kept.is_there
    assert kept.rig().state == "SAFE"


def test_a_loss_of_power_is_remembered_too(kept: Kept) -> None:
    kept.path.write_text('{"boot": "another"}')
    rig = kept.rig()
    assert rig.state == "HALTED"
    assert "the machine lost its power, or was reset" in kept.told[0]


def test_without_a_place_for_the_note_nothing_is_powered(kept: Kept) -> None:
    kept.path = kept.path.parent / "not-there" / "supply.json"
    rig = kept.rig(RELAYS)
    assert rig.state == "SAFE"
    report = rig.engine.supervisor.state_report(rig.clock.now_ns())
    assert "cannot be noted" in (report.arming_refused or ""), "known from the start"
    rig.open()
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert f"cannot be noted in {kept.path} (No such file or directory)" in answer.reason
    assert rig.state == "SAFE"
    assert [level for _, level in moves(rig, "HV") if level] == []
    report = rig.engine.supervisor.state_report(rig.clock.now_ns())
    assert "cannot be noted" in (report.arming_refused or "")
    # It may be mended while the daemon runs.
    os.mkdir(kept.path.parent)
    rig.arm()
    assert rig.state == "ARMED"


def test_trying_at_the_start_is_no_crash_to_the_next_engine(kept: Kept) -> None:
    assert kept.rig().state == "SAFE"
    assert os.listdir(kept.path.parent) == []
    assert kept.rig().state == "SAFE"


def test_where_another_could_hide_a_crash_nothing_is_armed(make_rig: MakeRig) -> None:
    rig = make_rig(RELAYS)
    rig.engine.components.stopper_liveness.refuse_note("/state: it belongs to user 65534")
    report = rig.engine.supervisor.state_report(rig.clock.now_ns())
    assert "belongs to user 65534" in (report.arming_refused or "")
    rig.open()
    answer = rig.ask(ArmBoard)
    assert answer.error == "arm_failed"
    assert "cannot be noted: /state: it belongs to user 65534" in answer.reason
    assert [level for _, level in moves(rig, "HV") if level] == []
    last = rig.engine.supervisor.state_report(rig.clock.now_ns()).last_disarm
    assert last == answer.reason, "and not that the rail is not known"


def test_the_supply_waits_for_a_slow_disk_and_not_for_ever(make_rig: MakeRig) -> None:
    rig = make_rig(RELAYS)
    rig.open()
    rig.meanwhile = keeping(rig)
    rig.stopper.is_noting = False
    answer = rig.ask(ArmBoard, patience_ms=7_000)
    assert answer.error == "arm_failed"
    assert "the disk takes seconds" in answer.reason
    assert [level for _, level in moves(rig, "HV") if level] == []
    ref = rig.next_ref()
    rig.commands.send(ArmBoard(ref=ref))
    rig.run_ms(2_000)
    assert not rig.engine.components.board.is_supply_on
    rig.stopper.is_noting = True
    assert rig.wait_for(ref).error is None
    assert rig.state == "ARMED"


def test_the_period_of_the_checks_leaves_room_in_the_margin() -> None:
    assert 2 * PERIOD_NS < MARGIN_MS * MS
