"""Whatever arrives on the link: the engine lives on, the skin is silent, and the reason is told."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import engine_rig
from engine_rig import LEASE, EngineRig, turn
from engine_scenes import MS, armed, calibration, fully_open, open_calibrated, phases, states
from etd.protocol.calibration import Calibration, ElectrodeLimits
from etd.protocol.frame import Frame, Ring
from etd.protocol.link import (
    Alive,
    ArmBoard,
    Channel,
    ClearHalt,
    CloseLease,
    Command,
    DisarmBoard,
    EngineHello,
    KeepLease,
    MeasureContact,
    NewFrame,
    OpenLease,
    SayFelt,
    SetMark,
    StopNow,
    ToGateway,
)
from etd.protocol.messages import Limits, RefusedReport
from etd.stabilize.bursts import Bursts
from etd.stabilize.prepulse import Prepulse
from etd.stabilize.shape import Shape
from etd.stabilize.strength_duration import StrengthDuration

pytestmark = pytest.mark.slow

MakeRig = Callable[..., EngineRig]
N = 8
ALL = (1_000,) * N
#: With half-bridges nobody can choose returns: a set of them is looked at all the same.
RELAYS = "feetthrough-relay"
OPENING = OpenLease(lease=LEASE, client="test", limits=Limits(max_current_ua=3_000, width_us=200))
SOCKETS = ("commands", "frames")


def send_bytes(rig: EngineRig, where: str, data: bytes) -> None:
    """As they are, in one datagram; nothing where the engine has hung up or does not read."""
    channel: Channel[ToGateway] = getattr(rig, where)
    if not channel.is_open:
        return
    try:
        os.write(channel.fileno(), data)
    except OSError:
        channel.close()


def refusals(rig: EngineRig) -> list[RefusedReport]:
    return [report.refused for report in rig.reports if report.refused is not None]


# --- bytes ----------------------------------------------------------------------------------------


def text(key: bytes, value: bytes) -> bytes:
    """A msgpack map of a tagged KeepLease with this raw string for its lease."""
    return b"\x82\xa4type\xa9KeepLease" + key + value


UNDECODABLE = {
    "no msgpack": b"\xff\xff",
    "nothing of a map": b"\x80",
    "cut short": msgspec.msgpack.encode(KeepLease(lease=LEASE))[:-1],
    "no UTF-8 in a value": text(b"\xa5lease", b"\xa2\xff\xfe"),
    "no UTF-8 in a key": text(b"\xa5\xff\xfe\xfd\xfc\xfb", b"\x01"),
    "deep nesting": text(b"\xa1x", b"\x91" * 100_000 + b"\x01"),
    "a list that claims to be long": text(b"\xa1x", b"\xdd\xff\xff\xff\xff"),
    "an engine's message": msgspec.msgpack.encode(EngineHello.__struct_fields__),
    "a ttl that is none": msgspec.msgpack.encode(
        NewFrame(ref=1, frame=Frame(lease=LEASE, seq=1, current_ua=ALL, ttl_ms=60_000))
    ),
    "a rate that is no number": msgspec.msgpack.encode(
        NewFrame(ref=1, frame=Frame(lease=LEASE, seq=1, current_ua=ALL, rate_hz=float("nan")))
    ),
    "a level that has no end": msgspec.msgpack.encode(
        NewFrame(ref=1, frame=Frame(lease=LEASE, seq=1, level=(float("inf"),) * N))
    ),
    "a kind without end": msgspec.msgpack.encode({"type": "x" * 100_000}),
    "a name without end": msgspec.msgpack.encode(StopNow(client="x" * 100_000)),
}


@pytest.mark.parametrize("where", SOCKETS)
@pytest.mark.parametrize("what", UNDECODABLE)
def test_what_cannot_be_read_ends_the_gateway_and_not_the_engine(
    make_rig: MakeRig, where: str, what: str
) -> None:
    rig = fully_open(make_rig(electrodes=N), 1_000)
    rig.show(current_ua=ALL, ttl_ms=1_000)
    rig.run_ms(20)
    rig.reports.clear()
    since_ns = rig.clock.now_ns()
    send_bytes(rig, where, UNDECODABLE[what])
    rig.run_ms(20)
    assert not rig.engine.has_gateway
    assert (rig.state, rig.engine.supervisor.lease, rig.fake.dac_code) == ("SAFE", None, 0)
    assert [phase for phase in phases(rig, since_ns) if phase.from_ns > since_ns + 2 * MS] == []
    (refusal,) = refusals(rig)
    assert refusal.error == "bad_message"
    assert "could not be decoded" in refusal.reason
    assert len(refusal.reason) < 400
    assert rig.engine.components.reporter.counters["gateway_undecodable"] == 1
    rig.attach_next_gateway()
    armed(rig)
    assert "could not be decoded" in (states(rig)[-1].last_disarm or "")
    assert rig.show(current_ua=ALL).error is None


@pytest.mark.parametrize("where", SOCKETS)
def test_a_stop_beside_it_is_still_obeyed_and_nothing_else_is(
    make_rig: MakeRig, where: str
) -> None:
    rig = armed(make_rig(electrodes=N))
    rig.clock.spend(2 * MS)
    send_bytes(rig, "frames", b"\xff")
    turn(rig.engine)
    rig.commands.send(StopNow(ref=0, client="operator"))
    rig.commands.send(ClearHalt(ref=0))
    if where == "commands":
        send_bytes(rig, "commands", b"\xff")
    rig.run_ms(5)
    assert not rig.engine.has_gateway
    assert rig.state == "HALTED"
    assert rig.engine.supervisor.states.halt is not None
    assert rig.engine.supervisor.states.halt.source == "operator"


# --- frames that are none -------------------------------------------------------------------------

CHAIN = (*((electrode + 1,) for electrode in range(31)), (0,))
WRONG: dict[str, dict[str, Any]] = {
    "too few currents": {"current_ua": (500,) * 31},
    "too many currents": {"current_ua": (500,) * 33},
    "no currents": {"current_ua": ()},
    "neither": {},
    "both": {"current_ua": (500,) * 32, "level": (0.5,) * 32},
    "too few levels": {"level": (0.5,)},
    "too few widths": {"current_ua": (500,) * 32, "width_us": (50,) * 31},
    "too few rates": {"current_ua": (500,) * 32, "rate_hz": (5.0,) * 31},
    "too few polarities": {"current_ua": (500,) * 32, "polarity": ("anodic",) * 31},
    "too few sets of returns": {"current_ua": (500,) * 32, "returns": CHAIN[:31]},
    "no returns at all": {"current_ua": (500,) * 32, "returns": ()},
    "a return beyond the array": {"current_ua": (500,) * 32, "returns": (*CHAIN[:31], (32,))},
    "a return far beyond": {"current_ua": (500,) * 32, "returns": (*CHAIN[:31], (2**62,))},
    "a return below zero": {"current_ua": (500,) * 32, "returns": (*CHAIN[:31], (-1,))},
    "a return that is itself": {"current_ua": (500,) * 32, "returns": (*CHAIN[:31], (31,))},
    "a return twice": {"current_ua": (500,) * 32, "returns": (*CHAIN[:31], (0, 0))},
}


@pytest.mark.parametrize("board", [RELAYS, "kajimoto-hv507"])
@pytest.mark.parametrize("what", WRONG)
def test_a_frame_of_the_wrong_shape_is_refused_by_the_engine_too(
    make_rig: MakeRig, what: str, board: str
) -> None:
    rig = make_rig(board, electrodes=32)
    made = calibration(rig, [2_000] * 32)
    assert open_calibrated(rig, made).error is None
    rig.arm()
    answer = rig.show(**{"rate_hz": 1.0, **WRONG[what]})
    assert answer.error == "bad_frame", answer.reason
    rig.reports.clear()
    frame = Frame(**{"lease": LEASE, "seq": 1_000, "rate_hz": 1.0, **WRONG[what]})
    rig.frames.send(NewFrame(ref=0, frame=frame))
    rig.run_ms(5)
    assert [refusal.error for refusal in refusals(rig)] == ["bad_frame"]
    assert rig.state == "ARMED"
    assert rig.show(seq=1_000, current_ua=(500,) * 32, rate_hz=1.0).error is None


BAD_RESISTANCE = ElectrodeLimits(
    threshold_ua=500, comfortable_ua=1_000, cap_ua=2_000, resistance_ohm=-7
)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"returns": CHAIN[:31]}, "31 lists for 32 electrodes"),
        ({"returns": ()}, "0 lists for 32 electrodes"),
        ({"returns": (*CHAIN[:31], (32,))}, "returns[31]"),
        ({"returns": (*CHAIN[:31], (31,))}, "returns[31]"),
        ({"electrode": (BAD_RESISTANCE,) * 32}, "electrode[0].resistance_ohm"),
    ],
)
def test_a_calibration_of_the_wrong_shape_is_refused_by_the_engine_too(
    make_rig: MakeRig, changes: dict[str, Any], said: str
) -> None:
    rig = make_rig(RELAYS)
    answer = open_calibrated(rig, calibration(rig, [2_000] * 32, **changes))
    assert answer.error == "bad_calibration"
    assert said in answer.reason
    assert rig.engine.supervisor.lease is None


# --- anything at all ------------------------------------------------------------------------------

numbers = st.one_of(
    st.integers(-3, 70), st.sampled_from([-(2**63), 2**63 - 1, 10_000, 1_000_000, 200, 20])
)
floats = st.one_of(st.floats(), st.sampled_from([0.0, 0.5, 1.0, 60.0, 200.0, 1e308]))
strings = st.one_of(st.just(LEASE), st.text(max_size=70))


def few(values: st.SearchStrategy[Any]) -> st.SearchStrategy[tuple[Any, ...]]:
    """Mostly as many as there are electrodes."""
    right = st.tuples(*[values] * N)
    return st.one_of(right, right, st.lists(values, max_size=N + 2).map(tuple))


currents_ua = st.one_of(st.sampled_from([0, 500, 1_000, 3_000]), numbers)
returns = st.one_of(
    st.just("all"),
    st.builds(Ring, ring_mm=floats),
    few(st.lists(st.integers(-1, N), max_size=3).map(tuple)),
)
shapes = st.builds(
    Shape,
    strength_duration=st.one_of(
        st.none(), st.builds(StrengthDuration, width_us=numbers, tau_us=floats)
    ),
    prepulse=st.one_of(st.none(), st.builds(Prepulse, below_db=floats, width_us=numbers)),
    bursts=st.one_of(st.none(), st.builds(Bursts, pulses=numbers, rate_hz=floats)),
    probe_first=st.booleans(),
)
polarities = st.sampled_from(["anodic", "biphasic", "upwards"])
frames = st.builds(
    Frame,
    lease=strings,
    seq=numbers,
    level=st.one_of(st.none(), few(st.one_of(st.floats(0.0, 1.0), floats))),
    current_ua=st.one_of(st.none(), few(currents_ua)),
    width_us=st.one_of(st.none(), st.integers(20, 200), numbers, few(numbers)),
    polarity=st.one_of(st.none(), polarities, few(polarities)),
    rate_hz=st.one_of(st.none(), st.floats(0.1, 200.0), floats, few(floats)),
    returns=st.one_of(st.none(), returns),
    ttl_ms=st.one_of(st.just(200), numbers),
    pulses=st.one_of(st.none(), numbers),
    strict=st.booleans(),
    allow_slower=st.booleans(),
    sent_ns=st.one_of(st.none(), numbers),
    tag=st.one_of(st.none(), numbers),
    sync=st.booleans(),
)
electrode_limits = st.builds(
    ElectrodeLimits,
    threshold_ua=st.one_of(st.just(500), numbers),
    comfortable_ua=st.one_of(st.just(1_000), numbers),
    cap_ua=st.one_of(st.just(2_000), numbers),
    resistance_ohm=st.one_of(st.none(), numbers),
    felt=st.booleans(),
)


@st.composite
def calibrations(draw: st.DrawFn, rig: EngineRig) -> Calibration:
    """The right one but for what is drawn."""
    changes = draw(
        st.fixed_dictionaries(
            {},
            optional={
                "array": strings,
                "body_site": strings,
                "width_us": numbers,
                "rate_hz": floats,
                "returns": returns,
                "electrode": few(electrode_limits),
                "shape": shapes,
                "gamma": floats,
            },
        )
    )
    return calibration(rig, [2_000] * N, **changes)


def commands(rig: EngineRig) -> st.SearchStrategy[Command]:
    leases = {"ref": st.just(7), "lease": strings}
    return st.one_of(
        st.builds(Alive),
        st.builds(StopNow, ref=numbers, client=strings),
        st.builds(ClearHalt),
        st.builds(ArmBoard, ref=numbers),
        st.builds(
            SayFelt,
            ref=numbers,
            answer=st.sampled_from(["too_weak", "good", "too_strong", "no answer"]),
            electrodes=st.one_of(st.none(), st.lists(numbers, max_size=4).map(tuple)),
            lease=st.one_of(st.none(), strings),
        ),
        st.builds(SetMark, tag=st.one_of(st.none(), numbers), **leases),
        *(
            st.builds(kind, **leases)
            for kind in (KeepLease, CloseLease, DisarmBoard, MeasureContact)
        ),
        st.builds(
            OpenLease,
            client=strings,
            calibrations=st.one_of(st.just(()), calibrations(rig).map(rig.wanted)),
            limits=st.one_of(
                st.none(), st.builds(Limits, max_current_ua=currents_ua, width_us=numbers)
            ),
            **leases,
        ),
    )


@st.composite
def damaged(draw: st.DrawFn, whole: st.SearchStrategy[bytes]) -> bytes:
    """One byte of a whole message is another one, or it ends early."""
    data = bytearray(draw(whole))
    at = draw(st.integers(0, len(data) - 1))
    if draw(st.booleans()):
        data[at] = draw(st.integers(0, 255))
        return bytes(data)
    return bytes(data[: max(1, at)])


def datagrams(rig: EngineRig) -> st.SearchStrategy[tuple[str, bytes]]:
    """To either socket, what belongs there and what does not."""
    new_frames = st.builds(NewFrame, ref=numbers, frame=frames).map(encoded)
    said = commands(rig).map(encoded)
    return st.one_of(
        st.tuples(st.just("frames"), new_frames),
        st.tuples(st.just("commands"), said),
        st.tuples(st.sampled_from(SOCKETS), damaged(st.one_of(new_frames, said))),
        st.tuples(st.sampled_from(SOCKETS), st.binary(min_size=1, max_size=60)),
    )


def encoded(message: object) -> bytes:
    try:
        return msgspec.msgpack.encode(message)
    except UnicodeEncodeError:  # a lone surrogate has no bytes
        return b"\xff"


@contextmanager
def armed_rig(board: str) -> Iterator[EngineRig]:
    """For one example."""
    rig = engine_rig.make(board, electrodes=N, is_traced=False)
    try:
        yield armed(rig)
    finally:
        problems = rig.close()
    assert problems == ()


@pytest.mark.parametrize("board", [RELAYS, "kajimoto-hv507"])
@settings(max_examples=20, suppress_health_check=list(HealthCheck))
@given(data=st.data())
def test_nothing_that_arrives_ends_the_engine(board: str, data: st.DataObject) -> None:
    with armed_rig(board) as rig:
        for where, datagram in data.draw(st.lists(datagrams(rig), min_size=1, max_size=8)):
            if not rig.engine.has_gateway:
                rig.attach_next_gateway()
            if rig.state == "SAFE" and rig.engine.supervisor.lease is None:
                rig.commands.send(OPENING)
                rig.commands.send(ArmBoard())
            send_bytes(rig, where, datagram)
            rig.run_ms(3)
            halt = rig.engine.supervisor.states.halt
            assert halt is None or halt.cause == "stop"
            assert rig.engine.has_gateway or rig.state in ("SAFE", "HALTED")


@settings(max_examples=30, suppress_health_check=list(HealthCheck))
@given(frame=frames, is_streamed=st.booleans())
def test_every_frame_is_taken_or_refused_or_ends_its_gateway(
    frame: Frame, is_streamed: bool
) -> None:
    with armed_rig("kajimoto-hv507") as rig:
        rig.reports.clear()
        ref = 0 if is_streamed else 99
        send_bytes(rig, "frames", encoded(NewFrame(ref=ref, frame=frame)))
        rig.run_ms(5)
        told = [
            *refusals(rig),
            *(answer for answer in rig.answers.values() if answer.error is not None),
        ]
        is_taken = rig.engine.components.reporter.counters["frames_shown"] > 0
        assert is_taken or len(told) == 1
        assert rig.engine.has_gateway or rig.state == "SAFE"
