"""A finger that goes through states of its skin: one after each silence, and which finger it is."""

from __future__ import annotations

import numpy as np
import pytest

from etd.files.configuration import fake_config
from etd_body.interface import Side
from etd_body.kinds import BodyKind, drawn, living
from etd_body.states import SILENCE_S, STATES, BreathingBody
from etd_hal.fake.fingertip import living_fingertip
from etd_hal.modelled_fingers import KINDS, OWN, Finger, finger_named

pytestmark = pytest.mark.slow

COUNT = 8
PLACES = [(2.5 * (electrode % 4), 2.5 * (electrode // 4)) for electrode in range(COUNT)]
FIRST = tuple(Side.SOURCE if one == 0 else Side.GROUND for one in range(COUNT))
NOWHERE = (Side.OPEN,) * COUNT
S = 1_000_000_000


def breathing(kind: BodyKind = BodyKind.AREA) -> BreathingBody:
    made = living(kind, PLACES, leak_ohm=66_000, compliance_v=300.0, seed=3, body=BreathingBody)
    assert isinstance(made, BreathingBody)
    return made


def pulse(body: BreathingBody, at_s: float, sides: tuple[Side, ...] = FIRST) -> float:
    """One of 1 mA; returns what the contacts resist then, the mean of all."""
    at_ns = int(at_s * S)
    body.drive(at_ns, 1_000.0, sides)
    body.drive(at_ns + 100_000, 0.0, sides)
    return float(np.mean([body.resistance_ohm(electrode, 1_000.0) for electrode in range(COUNT)]))


def test_after_each_silence_it_is_in_the_next_state_and_the_last_one_stays() -> None:
    body, at_s, seen = breathing(), 100.0, []
    for _ in range(len(STATES) + 2):
        seen.append(pulse(body, at_s))
        assert pulse(body, at_s + SILENCE_S - 1.0) == seen[-1], "no silence yet"
        at_s += 2.0 * SILENCE_S
    dry, damp, again, pressed, last = seen[:5]
    assert dry / damp == pytest.approx(3.0, rel=0.3)
    assert dry / pressed == pytest.approx(1.9 * 1.25, rel=0.3)
    assert 1.0 < dry / last < dry / again < 1.3
    assert seen[5:] == [last, last]


def test_what_flows_through_no_skin_ends_no_silence() -> None:
    body = breathing()
    dry = pulse(body, 1.0)
    for at_s in range(2, 18):
        pulse(body, float(at_s), NOWHERE)
    assert pulse(body, 18.0) < 0.6 * dry


def test_each_kind_of_body_can_be_named_and_is_the_finger_of_its_seed() -> None:
    assert tuple(BodyKind) == KINDS
    board = fake_config(electrodes=COUNT).board
    for kind in BodyKind:
        body = living_fingertip(board, PLACES, finger_named(f"{kind}:31"))
        assert body.skin.figures == drawn(kind, 31).skin
        assert not isinstance(body, BreathingBody)
    assert finger_named("sweat") == Finger("sweat", 1)
    own = living_fingertip(board, PLACES, Finger(OWN.kind, OWN.seed, is_breathing=True))
    assert isinstance(own, BreathingBody)
    assert own.skin.figures == living_fingertip(board, PLACES).skin.figures


@pytest.mark.parametrize("text", ["", "dry", "area:", "area:x", "area:-1", "area:2147483648"])
def test_what_names_no_finger_is_refused_with_what_can_be_said(text: str) -> None:
    with pytest.raises(ValueError, match=r"one of area, indifferent, .*summing|a whole number up"):
        finger_named(text)
