"""What a simulated person feels of a presentation, by the fake body's reports."""

from __future__ import annotations

import sys

import pytest

from etd.calibrate.modelled import ModelledBody
from etd.calibrate.person import Felt
from etd.cli.keys import keyboard
from etd.protocol.errors import FileError
from etd.protocol.messages import Modelled


def report(felt: tuple[float, ...], pain: tuple[float, ...] = (0.0, 0.0, 0.0)) -> Modelled:
    return Modelled(now_ns=0, felt=felt, pain=pain)


def test_of_one_electrode_the_strongest_pulse_is_felt() -> None:
    body = ModelledBody()
    body.begin(1)
    body.hear(report((3.0, 1.0, 0.0), (0.2, 0.1, 0.0)))
    body.hear(report((3.0, 1.5, 0.0)))
    assert body.sense(1) == Felt(1.5, 0.2)
    body.end()
    body.hear(report((9.0, 9.0, 9.0)))
    assert body.sense(1) == Felt(1.5, 0.2)


def test_of_all_at_once_the_mean_is_felt_whatever_comes_in_which_report() -> None:
    body = ModelledBody()
    body.begin(2, (0, 2))
    body.hear(report((3.0, 7.0, 0.0)))
    body.hear(report((0.0, 7.0, 1.0)))
    assert body.sense(2) == Felt(2.0, 0.0)
    body.begin(2)
    body.hear(report((3.0, 7.0, 0.5)))
    assert body.sense(2) == Felt(0.5, 0.0)


def test_without_a_standard_input_it_is_said_that_no_key_can_be_pressed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(sys, "stdin", None)
    with (
        pytest.raises(FileError, match="no key can be pressed"),
        keyboard(lambda _: None, lambda _: None, lambda: None),
    ):
        raise AssertionError("nobody can stop it")
