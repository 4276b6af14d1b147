"""What may follow what."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from etd.protocol.errors import Refused
from etd.protocol.messages import Halt, State
from etd.safety.state import StateMachine

HALT = Halt(cause="stop", source="operator", detail="asked to stop", t_ns=1)
SECOND = Halt(cause="fault", source="rail", detail="0 V", t_ns=2)


def machine_in(state: State) -> StateMachine:
    machine = StateMachine()
    if state in ("PROBE", "ARMED"):
        machine.probe()
    if state == "ARMED":
        machine.arm()
    if state == "HALTED":
        machine.stop(HALT)
    assert machine.state == state
    return machine


MOVES: dict[str, Callable[[StateMachine], object]] = {
    "probe": StateMachine.probe,
    "arm": StateMachine.arm,
    "safe": StateMachine.safe,
    "stop": lambda machine: machine.stop(SECOND),
    "clear": StateMachine.clear,
}
#: (from, move): what it leads to, or the code of the refusal.
TABLE: dict[tuple[State, str], str] = {
    ("SAFE", "probe"): "PROBE",
    ("SAFE", "arm"): "wrong_state",
    ("SAFE", "safe"): "SAFE",
    ("SAFE", "stop"): "HALTED",
    ("SAFE", "clear"): "wrong_state",
    ("PROBE", "probe"): "wrong_state",
    ("PROBE", "arm"): "ARMED",
    ("PROBE", "safe"): "SAFE",
    ("PROBE", "stop"): "HALTED",
    ("PROBE", "clear"): "wrong_state",
    ("ARMED", "probe"): "wrong_state",
    ("ARMED", "arm"): "wrong_state",
    ("ARMED", "safe"): "SAFE",
    ("ARMED", "stop"): "HALTED",
    ("ARMED", "clear"): "wrong_state",
    ("HALTED", "probe"): "halted",
    ("HALTED", "arm"): "halted",
    ("HALTED", "safe"): "HALTED",
    ("HALTED", "stop"): "HALTED",
    ("HALTED", "clear"): "SAFE",
}


@pytest.mark.parametrize(("state", "move"), TABLE)
def test_every_move_from_every_state_leads_where_the_table_says(state: State, move: str) -> None:
    machine = machine_in(state)
    outcome = TABLE[state, move]
    if outcome.isupper():
        MOVES[move](machine)
        assert machine.state == outcome
        return
    with pytest.raises(Refused) as refusal:
        MOVES[move](machine)
    assert refusal.value.code == outcome
    assert machine.state == state


def test_it_starts_safe_without_a_cause() -> None:
    machine = StateMachine()
    assert (machine.state, machine.halt) == ("SAFE", None)


def test_the_first_cause_stands() -> None:
    machine = StateMachine()
    assert machine.stop(HALT)
    assert not machine.stop(SECOND)
    assert machine.halt is HALT


def test_clearing_forgets_the_cause() -> None:
    machine = machine_in("HALTED")
    machine.clear()
    assert machine.halt is None


def test_a_refusal_in_halted_tells_the_cause_and_the_commands_in_their_order() -> None:
    with pytest.raises(Refused) as told:
        machine_in("HALTED").need("ARMED")
    reason = told.value.reason
    assert all(said in reason for said in (HALT.cause, HALT.source, HALT.detail))
    assert 0 < reason.find("`etd status`") < reason.find("`etd clear`")


def test_what_needs_armed_is_told_to_arm() -> None:
    with pytest.raises(Refused, match="arm first") as refusal:
        machine_in("SAFE").need("ARMED")
    assert refusal.value.code == "not_armed"
