"""`etd selftest` while faults come: a board on a bench with a load clipped on, and nobody on it.

Owns: the bench, and what the report says of a fault. Must not know: what a stage checks, faults.
"""

from __future__ import annotations

import contextlib
import io
from dataclasses import replace

import msgspec

from campaign.account import AccountedBody, Course
from campaign.engine_script import PULSE_PC
from campaign.operations import Operations
from campaign.scene import Said
from campaign.subject import Subject
from etd.files.configuration import LoadedConfig
from etd.selftest.fixture import DummyLoad, Fixture, SelftestOptions
from etd.selftest.report import Report
from etd.selftest.run import run
from etd_body.electrode import OPEN_CONTACT
from etd_body.minimal import MinimalBody
from etd_hal.backend import Backend, Bench
from etd_hal.compose import codec_of
from etd_hal.fake.board import FakeBoard
from etd_hal.fake.clock import SteppedClock
from etd_hal.fake.kill_test_process import FakeKillTestProcess
from etd_hal.fake.operator import FakeOperator
from etd_hal.fake.stepped_beside import SteppedBeside
from etd_hal.linesetup import line_setup, spi_setup
from selftest_rig import DATE, LOAD_OHM, SECOND_OHM

MS = 1_000_000


def _with_short_chain(loaded: LoadedConfig) -> LoadedConfig:
    """A board of this kind with an output for each electrode: a self-test tries all outputs, and
    takes three to seven times as long with all that the shipped ones have; more are the same again.
    """
    switch = msgspec.structs.replace(loaded.board.switch, outputs=loaded.array.count)
    return replace(loaded, board=msgspec.structs.replace(loaded.board, switch=switch))


class SelftestScene:
    """All stages, the strong pulses into the load too."""

    #: What counts as much of one is as in the other scenes.
    pulse_pc = PULSE_PC

    def __init__(
        self, loaded: LoadedConfig, operations: Operations, course: Course | None = None
    ) -> None:
        loaded = _with_short_chain(loaded)
        source = loaded.board.source
        clock = SteppedClock()
        body = AccountedBody(
            MinimalBody(
                (OPEN_CONTACT,) * loaded.array.count,
                leak_ohm=source.leak_ohm,
                compliance_v=source.compliance_v,
            ),
            course,
        )
        fake = FakeBoard(loaded.board, clock, body, electrodes=loaded.array.outputs())
        setup = line_setup(loaded.board)
        ports = fake.request(setup, spi_setup(loaded.board))
        backend = Backend(
            "fake",
            *(ports.spi, ports.gpio, ports.i2c, clock, ports.marker, ports.close),
            host_clock=clock,
            codec=codec_of(source),
            beside=SteppedBeside(ports.gpio, clock),
        )
        at_board = FakeOperator(fake.world, clock, {})
        load, second = (DummyLoad(ohm, 1, 2) for ohm in (LOAD_OHM, SECOND_OHM))
        at_board.clip(load.resistance_ohm, load.first, load.second)
        understudy = FakeKillTestProcess(fake, loaded.board, ports.gpio, setup, clock)
        bench = Bench(backend, fake.world.host, at_board, understudy)
        self._loaded, self._operator = loaded, at_board
        self._bench = replace(bench, backend=operations.wrap(backend))
        self._options = SelftestOptions(load, 250, second)
        self.subject = Subject(fake, clock, body)
        self._report: Report | None = None
        self._printed = io.StringIO()

    @property
    def leaves_supply_on(self) -> bool:
        return self.subject.fake.world.is_supply_enabled

    def prepare(self) -> None:
        pass

    def play(self) -> None:
        with contextlib.redirect_stderr(self._printed):
            fixture = Fixture(self._loaded, self._bench, self._operator, self._options)
            self._report = run(fixture, DATE)

    def play_on(self, is_long: bool) -> None:
        """A report is its end."""

    def insist(self) -> None:
        """Nothing follows."""

    def after_kill(self) -> None:
        """Lines stay as they are: nobody keeps a bench."""
        self.subject.clock.spend(100 * MS)

    def said(self, begun_ns: int) -> Said:
        if self._report is None or self._report.passed:
            return Said("nothing")
        bad = [one for one in self._report.checks if one.result == "fail"]
        first = bad[0] if bad else self._report.checks[-1]
        return Said("refused", None, f"{first.stage}: {first.name}: {first.measured}")

    def problem(self) -> str | None:
        said = self.said(0)
        return None if said.seen == "nothing" else said.why

    def close(self) -> None:
        self.subject.fake.release()
