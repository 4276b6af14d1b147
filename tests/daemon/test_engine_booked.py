"""Charge is in the ledger before it can flow, and stays there whatever becomes of the message."""

from __future__ import annotations

import dataclasses
from typing import Any

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import engine_rig
from charge_witness import Witness, even_skin
from engine_rig import EngineRig
from engine_scenes import config, fully_open
from etd.stabilize.settings import Settings
from etd_hal.fake.faults import Fault, MisoStuck, SpiError, SpiShort, SpiStall

pytestmark = pytest.mark.slow

KAJIMOTO, RELAY = "kajimoto-hv507", "feetthrough-relay"
ELECTRODES = {KAJIMOTO: 16, RELAY: 32}
#: The electrode that is stimulated; where returns are named, those two.
HERE, RETURNS = 5, (6, 9)
CURRENT_UA, WIDTH_US = 500, 100
POLARITIES = ("anodic", "cathodic", "biphasic", "biphasic_cathodic_first")
#: Of the machine file: a message that is more over its plan halts.
HALT_EXCESS_US = 300
MS = 1_000_000


class Scene:
    """An engine that is open for the current, on even skin, and watched."""

    def __init__(self, board: str = KAJIMOTO, *, is_probe_first: bool = False) -> None:
        self.count = ELECTRODES[board]
        loaded = config(board, self.count)
        if is_probe_first:
            settings_ = Settings(order=(), probe_first=True)
            site = msgspec.structs.replace(loaded.body_site, stabilize=settings_)
            loaded = dataclasses.replace(loaded, body_site=site)
        body = even_skin(loaded.board, self.count)
        self.witness = Witness(body)
        self.rig: EngineRig = engine_rig.make(
            loaded=loaded, body=body, wrap=self.witness.wrap, is_traced=False
        )
        self.witness.begin(self.rig.engine.components.ledger, HALT_EXCESS_US * 1_000)
        fully_open(self.rig, CURRENT_UA)
        self.rig.run_ms(100)
        self._before_pc = self.booked_pc

    @property
    def booked_pc(self) -> int:
        return self.rig.engine.components.ledger.charge_pc(HERE, self.rig.clock.now_ns())

    @property
    def added_pc(self) -> int:
        """What the ledger has of it since the scene began."""
        return self.booked_pc - self._before_pc

    def show(self, *faults: Fault, **fields: Any) -> None:
        """One pulse at one electrode, with these faults put in before."""
        self._faults = faults
        for fault in faults:
            self.rig.fake.world.put_in(fault)
        wanted = {HERE: CURRENT_UA}
        asked = {
            "current_ua": tuple(wanted.get(electrode, 0) for electrode in range(self.count)),
            "width_us": WIDTH_US,
            "pulses": 1,
            "rate_hz": 10.0,
            "ttl_ms": 1_000,
        }
        self.rig.send(**{**asked, **fields})
        until_ns = self.rig.clock.now_ns() + 120 * MS
        while self.rig.clock.now_ns() < until_ns:
            self.rig.step()
            self.witness.look("between two turns")

    def end(self) -> None:
        for fault in self._faults:
            self.rig.fake.world.take_out(fault)
        assert self.rig.close() == ()
        assert self.witness.shortfalls == []


def to_named_returns(count: int) -> tuple[tuple[int, ...], ...]:
    """Two for the electrode that is stimulated; the others get none of it."""
    others = tuple(((electrode + 1) % count, (electrode + 2) % count) for electrode in range(count))
    return (*others[:HERE], RETURNS, *others[HERE + 1 :])


@pytest.mark.parametrize("board", [KAJIMOTO, RELAY])
@pytest.mark.parametrize(
    ("polarity", "at_message"), [("anodic", 1), ("cathodic", 1), ("biphasic", 1), ("biphasic", 2)]
)
@pytest.mark.parametrize("kind", ["short", "half-way", "no sample"])
def test_a_message_that_failed_after_current_flowed_is_in_the_ledger(
    board: str, polarity: str, at_message: int, kind: str
) -> None:
    scene = Scene(board)
    if board == RELAY:
        # Before relays close, a message of zero looks whether anything flows.
        at_message *= 2
    faults: dict[str, Fault] = {
        "short": SpiShort(at_message),
        "half-way": SpiError(at_message, at_transfer=3),
        "no sample": MisoStuck(1),
    }
    scene.show(faults[kind], polarity=polarity)
    assert scene.rig.state == "HALTED"
    phases = 2 if polarity == "biphasic" else 1
    if (board, kind) == (RELAY, "no sample"):
        assert scene.added_pc == 0, "it is seen by that look already"
    else:
        assert scene.added_pc >= CURRENT_UA * WIDTH_US * phases
    scene.end()


faults_of_a_message = st.one_of(
    st.builds(SpiShort),
    st.builds(SpiError, st.just(1), st.integers(0, 14), st.sampled_from(["io", "timeout", "gone"])),
    st.builds(SpiStall, st.integers(1, 5_000), st.just(1), st.integers(0, 14)),
    st.just(MisoStuck(1)),
)


@settings(max_examples=40, suppress_health_check=[HealthCheck.too_slow])
@given(
    board=st.sampled_from([KAJIMOTO, RELAY]),
    is_probe_first=st.booleans(),
    polarity=st.sampled_from(POLARITIES),
    width_us=st.sampled_from([20, 50, WIDTH_US]),
    is_named=st.booleans(),
    found=st.lists(faults_of_a_message, min_size=1, max_size=3),
    at_message=st.integers(1, 6),
)
def test_whatever_becomes_of_a_message_the_ledger_never_has_less_than_the_body_got(
    *,
    board: str,
    is_probe_first: bool,
    polarity: str,
    width_us: int,
    is_named: bool,
    found: list[Fault],
    at_message: int,
) -> None:
    """Asked before each message, directly after it unless it was too long, and between turns."""
    scene = Scene(board, is_probe_first=is_probe_first)
    returns = to_named_returns(scene.count) if is_named and board == RELAY else "all"
    faults = [
        spi_error
        if isinstance(spi_error, MisoStuck)
        else msgspec.structs.replace(spi_error, at_message=at_message)
        for spi_error in found
    ]
    wanted = {HERE: CURRENT_UA, HERE + 2: CURRENT_UA // 2}
    scene.show(
        *dict.fromkeys(faults),
        current_ua=tuple(wanted.get(electrode, 0) for electrode in range(scene.count)),
        width_us=width_us,
        polarity=polarity,
        returns=returns,
        pulses=2,
        rate_hz=20.0,
    )
    scene.end()


@pytest.mark.parametrize("polarity", POLARITIES)
def test_a_pulse_that_went_well_is_in_the_ledger_with_all_its_phases(polarity: str) -> None:
    scene = Scene()
    scene.show(polarity=polarity)
    phases = 2 if polarity.startswith("biphasic") else 1
    most_us = WIDTH_US + HALT_EXCESS_US // 10
    assert CURRENT_UA * WIDTH_US * phases <= scene.added_pc <= CURRENT_UA * most_us * phases
    scene.end()


def test_a_probe_and_its_pulse_are_in_the_ledger_of_their_named_returns() -> None:
    scene = Scene(RELAY, is_probe_first=True)
    ledger, clock = scene.rig.engine.components.ledger, scene.rig.clock
    before_pc = ledger.charge_pc(RETURNS[0], clock.now_ns())
    scene.show(returns=to_named_returns(scene.count))
    maxima = scene.rig.engine.components.maxima.now
    probe_pc = maxima.probe_current_ua * maxima.probe_width_us
    added_pc = ledger.charge_pc(RETURNS[0], clock.now_ns()) - before_pc
    assert added_pc >= CURRENT_UA * WIDTH_US + probe_pc
    scene.end()
