"""A lease whose calibrations are read meanwhile: by the engine, past a gateway that may lie.

Owns: what a gateway that was taken over gets by messages of its own, and that the engine's loop
waits for no file.
"""

from __future__ import annotations

import itertools
import os
from collections.abc import Callable, Sequence
from typing import Any

import msgspec
import pytest
from msgspec.structs import replace

from engine_rig import LEASE, EngineRig
from engine_scenes import MS, calibration, states
from etd.engine.idle_wait import UNPOWERED_TICK_NS
from etd.engine.opening import READ_WITHIN_NS
from etd.protocol.calibration import Calibration
from etd.protocol.calibration_set import digest_of
from etd.protocol.errors import Refused
from etd.protocol.link import (
    Answer,
    ArmBoard,
    ClearHalt,
    CloseLease,
    KeepLease,
    OpenLease,
    StopNow,
)
from etd.protocol.messages import Limits
from etd.protocol.opening import LeaseCalibration, WantedCalibration
from etd.protocol.peer import Peer

MakeRig = Callable[..., EngineRig]
N = 8
WANTED = (WantedCalibration(name="p01"),)


class HandReader:
    """Reads when the test lets it."""

    def __init__(self) -> None:
        self.asked: list[tuple[tuple[str, ...], Peer]] = []
        self.cancelled = 0
        self.found: tuple[Calibration, ...] | Refused | None = None

    def begin(self, names: Sequence[str], gateway: Peer) -> None:
        self.asked.append((tuple(names), gateway))
        self.found = None

    def result(self) -> tuple[Calibration, ...] | None:
        if isinstance(self.found, Refused):
            raise self.found
        return self.found

    def cancel(self) -> None:
        self.cancelled += 1


@pytest.fixture
def reader() -> HandReader:
    return HandReader()


@pytest.fixture
def rig(make_rig: MakeRig, reader: HandReader) -> EngineRig:
    return make_rig(electrodes=N, reader=reader)


def begin(rig: EngineRig, **fields: Any) -> int:
    """A lease is asked for; nothing is read yet. The ref."""
    ref = rig.next_ref()
    asked = {"lease": LEASE, "client": "test", "calibrations": WANTED, **fields}
    assert rig.commands.send(OpenLease(ref=ref, **asked))
    rig.run_ms(10)
    assert ref not in rig.answers
    return ref


# --- what is read, and what is told of it ---------------------------------------------------------


def test_the_engine_tells_which_electrodes_were_not_felt(
    rig: EngineRig, reader: HandReader
) -> None:
    made = calibration(rig, (1_000,) * N)
    unfelt = replace(made.electrode[1], felt=False)
    ref = begin(rig)
    reader.found = (replace(made, electrode=(made.electrode[0], unfelt, *made.electrode[2:])),)
    (told,) = rig.wait_for(ref).calibrations
    assert told.unfelt == (1,)


def test_the_engine_tells_what_it_took_when_it_opens_arms_and_reports(
    rig: EngineRig, reader: HandReader
) -> None:
    made = calibration(rig, (1_000,) * N)
    ref = begin(rig)
    reader.found = (made,)
    told = (LeaseCalibration(name="p01", polarity="anodic", digest=digest_of(made)),)
    assert rig.wait_for(ref).calibrations == told
    assert reader.asked == [(("p01",), Peer(os.geteuid(), (os.getegid(), *os.getgroups())))]
    assert states(rig)[-1].calibrations == told
    assert rig.ask(ArmBoard).calibrations == told
    assert rig.ask(ArmBoard).calibrations == told, "armed already"
    rig.ask(CloseLease, lease=LEASE)
    rig.open()
    assert (states(rig)[-1].calibrations, rig.ask(ArmBoard).calibrations) == ((), ())


@pytest.mark.parametrize("is_meant", [True, False])
def test_another_digest_than_was_meant_is_refused(
    rig: EngineRig, reader: HandReader, is_meant: bool
) -> None:
    made = calibration(rig, (1_000,) * N)
    digest = digest_of(made) if is_meant else "0" * 64
    ref = begin(rig, calibrations=(WantedCalibration(name="p01", digest=digest),))
    reader.found = (made,)
    answer = rig.wait_for(ref)
    assert answer.error == (None if is_meant else "bad_calibration")
    assert is_meant or "not the one that was meant" in answer.reason
    assert (rig.engine.supervisor.lease is not None) is is_meant


def test_it_is_checked_against_the_maxima_as_ever(rig: EngineRig, reader: HandReader) -> None:
    ref = begin(rig)
    reader.found = (calibration(rig, (10_000,) * N, width_us=200, rate_hz=200.0),)
    assert rig.wait_for(ref).error == "over_maximum"
    assert rig.engine.supervisor.lease is None


# --- a gateway that was taken over ----------------------------------------------------------------


def send(rig: EngineRig, message: dict[str, Any]) -> None:
    os.write(rig.commands.fileno(), msgspec.msgpack.encode({"type": "OpenLease", **message}))


def test_the_content_of_a_calibration_in_a_message_is_no_calibration(
    rig: EngineRig, reader: HandReader
) -> None:
    made = msgspec.to_builtins(calibration(rig, (2_000,) * N))
    ref = rig.next_ref()
    asked = {"ref": ref, "lease": LEASE, "client": "x", "calibration": made, "others": [made]}
    send(rig, asked)
    assert rig.wait_for(ref).error == "limits_missing"
    assert (rig.engine.supervisor.lease, reader.asked) == (None, [])


@pytest.mark.parametrize(
    "wanted",
    [
        *({"name": name} for name in ("../p01", "a/b", "p01\n", "p01\x00", "", "p" * 33, ".", "é")),
        {"name": "p01", "digest": "0" * 63},
        {"name": "p01", "digest": "0" * 64 + "\n"},
        {"name": 7},
    ],
)
def test_a_name_that_is_none_ends_the_gateway_and_opens_nothing(
    rig: EngineRig, reader: HandReader, wanted: dict[str, Any]
) -> None:
    send(rig, {"ref": 1, "lease": LEASE, "client": "x", "calibrations": [wanted]})
    rig.run_ms(10)
    assert not rig.engine.has_gateway
    assert (rig.engine.supervisor.lease, reader.asked) == (None, [])


def test_nor_are_there_more_than_a_lease_can_have(rig: EngineRig, reader: HandReader) -> None:
    send(rig, {"ref": 1, "lease": LEASE, "client": "x", "calibrations": [{"name": "p01"}] * 5})
    rig.run_ms(10)
    assert (rig.engine.has_gateway, reader.asked) == (False, [])


# --- while it is read -----------------------------------------------------------------------------


def test_polls_go_on_while_a_calibration_is_read(rig: EngineRig) -> None:
    polls: list[int] = []
    rig.meanwhile = polls.append
    begin(rig)
    rig.run_ms(3_000)
    between = [after - before for before, after in itertools.pairwise(polls)]
    assert max(between) <= UNPOWERED_TICK_NS, "as with nothing to do"
    assert rig.ask(ClearHalt).error == "wrong_state", "other commands are answered"
    assert len([report for report in states(rig) if report.state == "SAFE"]) >= 3


def test_a_stop_meanwhile_halts_and_no_lease_begins(rig: EngineRig, reader: HandReader) -> None:
    ref = begin(rig)
    rig.ask(StopNow, client="operator")
    reader.found = (calibration(rig, (1_000,) * N),)
    answer = rig.wait_for(ref)
    assert (answer.error, rig.state, rig.engine.supervisor.lease) == ("halted", "HALTED", None)


def test_there_is_one_at_a_time_and_the_first_stands(rig: EngineRig, reader: HandReader) -> None:
    ref = begin(rig)
    second = rig.ask(OpenLease, lease="b", client="second", calibrations=WANTED)
    assert (second.error, "being opened by 'test'" in second.reason) == ("other_lease", True)
    assert rig.ask(ArmBoard).error == "no_lease"
    assert rig.ask(KeepLease, lease=LEASE).error == "no_lease"
    reader.found = (calibration(rig, (1_000,) * N),)
    assert rig.wait_for(ref).error is None
    assert rig.engine.supervisor.lease is not None


def test_one_that_was_opened_with_limits_meanwhile_stands(
    rig: EngineRig, reader: HandReader
) -> None:
    ref = begin(rig)
    limits = Limits(max_current_ua=500, width_us=50)
    assert rig.ask(OpenLease, lease="b", client="second", limits=limits).error is None
    reader.found = (calibration(rig, (1_000,) * N),)
    assert rig.wait_for(ref).error == "other_lease"
    assert rig.engine.supervisor.lease is not None
    assert rig.engine.supervisor.lease.token == "b"


def test_a_reading_without_end_is_ended_and_told(rig: EngineRig, reader: HandReader) -> None:
    ref = begin(rig)
    answer = rig.wait_for(ref, patience_ms=READ_WITHIN_NS // MS + 100)
    assert (answer.error, "longer than 8 s" in answer.reason) == ("bad_calibration", True)
    assert reader.cancelled == 1
    ref = begin(rig)
    reader.found = Refused("not_found", "there is none")
    assert rig.wait_for(ref) == Answer.refusing(ref, reader.found)


@pytest.mark.parametrize("how", ["gone", "undecodable"])
def test_a_lease_for_a_gateway_that_is_gone_does_not_begin_for_the_next(
    rig: EngineRig, reader: HandReader, how: str
) -> None:
    begin(rig)
    if how == "gone":
        rig.commands.close()
    else:
        os.write(rig.commands.fileno(), b"\xff")
    rig.run_ms(10)
    rig.attach_next_gateway()
    reader.found = (calibration(rig, (1_000,) * N),)
    rig.run_ms(50)
    assert (reader.cancelled, rig.engine.supervisor.lease, rig.answers) == (1, None, {})
    ref = begin(rig)
    reader.found = (calibration(rig, (1_000,) * N),)
    assert rig.wait_for(ref).error is None
