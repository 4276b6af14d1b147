"""A self-test on the stepped fake: a bench, a hand that does what is asked, and the skin's account.

Owns: how tests put a board, its faults and a load together. Time passes only as it is spent.
"""

from __future__ import annotations

import datetime
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

from etd.files.body_site import load_body_site
from etd.files.configuration import LoadedConfig, fake_config
from etd.files.resources import find
from etd.selftest.fixture import DummyLoad, Fixture, SelftestOptions
from etd.selftest.report import Check, Report
from etd.selftest.run import run
from etd_body.electrode import OPEN_CONTACT
from etd_body.minimal import MinimalBody
from etd_hal.backend import Backend, Bench
from etd_hal.bench import KillTestProcess, Operator, StopName
from etd_hal.boardfile import BoardFile
from etd_hal.compose import codec_of
from etd_hal.fake.board import FakeBoard
from etd_hal.fake.clock import SteppedClock
from etd_hal.fake.faults import Fault
from etd_hal.fake.fingertip import fingertip_body
from etd_hal.fake.kill_test_process import FakeKillTestProcess
from etd_hal.fake.operator import FakeOperator
from etd_hal.fake.stepped_beside import SteppedBeside
from etd_hal.linesetup import line_setup, spi_setup
from etd_hal.ports import Message, Spi

LOAD_OHM, SECOND_OHM = 47_000, 10_000
#: Sixteen electrodes say what 64 say, in a sixteenth of the time.
ARRAY = "grid-4x4"
DATE = datetime.datetime(2026, 3, 4, 5, 6, tzinfo=datetime.UTC)


class LazyHand:
    """Does nothing that it is asked for."""

    def press(self, stop: StopName) -> None:
        pass

    def hold(self, stop: StopName) -> None:
        pass

    def let_go(self, stop: StopName) -> None:
        pass

    def clip(self, load_ohm: int, first: int, second: int) -> None:
        pass

    def ground(self, load_ohm: int, electrode: int) -> None:
        pass

    def misplaced(self, asked: int, found: tuple[int, ...]) -> None:
        pass

    def stand_back(self) -> None:
        pass


class ChangedUnderstudy:
    """The bench's understudy, for a test that changes one thing of it."""

    def __init__(self, inner: KillTestProcess) -> None:
        self._inner = inner

    def take_over(self) -> None:
        self._inner.take_over()

    def kill(self) -> float:
        return self._inner.kill()

    def levels(self) -> Mapping[int, int]:
        return self._inner.levels()

    def step_back(self) -> None:
        self._inner.step_back()


class ChargeWatch:
    """The Spi port, with the body's own account taken around each message.

    `before_pulse`: what happens to the world before the first, second, ... message with a pulse.
    """

    def __init__(self, inner: Spi, body: MinimalBody) -> None:
        self._inner = inner
        self._body = body
        self._before = body.absolute_charges_pc()
        #: The most that any electrode got in one message, or between two.
        self.most_pc = 0.0
        self.pulses = 0
        #: The strongest that was on the wire.
        self.most_code = 0
        self.before_pulse: dict[int, Callable[[], None]] = {}

    def prepare(self, message: Message) -> None:
        self._inner.prepare(message)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        code = max(_dac_code(transfer.tx) for transfer in message.transfers)
        if code:
            self.pulses += 1
            self.most_code = max(self.most_code, code)
            self.before_pulse.get(self.pulses, _nothing)()
        self.look()
        try:
            return self._inner.transfer(message)
        finally:
            self.look()

    def look(self) -> None:
        """Take the account up to now."""
        now = self._body.absolute_charges_pc()
        self.most_pc = max(
            self.most_pc, *(after - before for before, after in zip(self._before, now, strict=True))
        )
        self._before = now


def _dac_code(word: bytes) -> int:
    """Of an AD5452: two bits of control, twelve of code, two of nothing. A delay has no word."""
    return int.from_bytes(word) >> 2 & 0xFFF


def _nothing() -> None:
    pass


@dataclass
class SelftestRig:
    """See the module; `selftest_rig` makes one."""

    loaded: LoadedConfig
    fake: FakeBoard
    body: MinimalBody
    clock: SteppedClock
    bench: Bench
    operator: Operator | None
    options: SelftestOptions
    watch: ChargeWatch
    kill_test_process: FakeKillTestProcess

    def run(self) -> Report:
        return run(Fixture(self.loaded, self.bench, self.operator, self.options), DATE)

    def let_another_be_killed(self, changed: Callable[[KillTestProcess], KillTestProcess]) -> None:
        """The bench has another understudy: what is made of the one that it has."""
        self.bench = replace(self.bench, kill_test_process=changed(self.bench.kill_test_process))

    @property
    def is_understudy_alive(self) -> bool:
        return self.kill_test_process.is_alive

    def rail_v_after_a_while(self) -> float:
        """What is left of the rail when a supply that is off has had its time to fall."""
        self.clock.spend(4_000_000_000)
        self.bench.backend.gpio.edges()
        return self.fake.world.rail_v()

    def lay_finger_on(self) -> None:
        """A dry fingertip on the whole array, over whatever is there."""
        count = self.body.electrode_count
        skin = fingertip_body(self.loaded.board, count)
        for electrode in range(count):
            self.fake.world.touch(electrode, skin.contact(electrode))

    @property
    def most_charge_nc(self) -> float:
        """Of one pulse at one electrode, by the body's own account."""
        self.watch.look()
        return self.watch.most_pc / 1_000


def bad(report: Report) -> list[tuple[str, str]]:
    """(stage, name) of what failed, in order."""
    return [(check.stage, check.name) for check in report.checks if check.result == "fail"]


def by_name(report: Report) -> dict[str, Check]:
    """The last check of each name."""
    return {check.name: check for check in report.checks}


def selftest_rig(
    board: str = "reference-hv507",
    array: str | None = ARRAY,
    *,
    faults: Sequence[Fault] = (),
    file: BoardFile | None = None,
    body_site: str | None = None,
    load_ohm: int | None = LOAD_OHM,
    second_ohm: int | None = SECOND_OHM,
    really_ohm: Mapping[int, float] | None = None,
    leak_factor: float = 1.0,
    on_skin: bool = False,
    has_operator: bool = True,
    is_lazy: bool = False,
    one_shot_us: int | None = 250,
) -> SelftestRig:
    """A board on a bench: nothing on it but, with `load_ohm`, a resistor between 1 and 2."""
    loaded = fake_config(board, array)
    if file is not None:
        loaded = replace(loaded, board=file)
    if body_site is not None:
        loaded = replace(loaded, body_site=load_body_site(find("bodysites", body_site)))
    clock = SteppedClock()
    count = loaded.array.count
    body = MinimalBody(
        (OPEN_CONTACT,) * count,
        leak_ohm=loaded.board.source.leak_ohm * leak_factor,
        compliance_v=loaded.board.source.compliance_v,
    )
    if on_skin:
        body = fingertip_body(loaded.board, count)
    fake = FakeBoard(loaded.board, clock, body, electrodes=loaded.array.outputs(), faults=faults)
    ports = fake.request(line_setup(loaded.board), spi_setup(loaded.board))
    watch = ChargeWatch(ports.spi, body)
    backend = Backend(
        "fake",
        *(watch, ports.gpio, ports.i2c, clock, ports.marker, ports.close),
        host_clock=clock,
        codec=codec_of(loaded.board.source),
        beside=SteppedBeside(ports.gpio, clock),
    )
    at_board = FakeOperator(fake.world, clock, really_ohm or {})
    load = second = None
    if load_ohm is not None:
        load = DummyLoad(load_ohm, 1, 2)
        if second_ohm is not None:
            second = DummyLoad(second_ohm, 1, 2)
        at_board.clip(load.resistance_ohm, load.first, load.second)
    operator: Operator | None = LazyHand() if is_lazy else at_board
    kill_test_process = FakeKillTestProcess(
        fake, loaded.board, ports.gpio, line_setup(loaded.board), clock
    )
    return SelftestRig(
        loaded,
        fake,
        body,
        clock,
        Bench(
            backend,
            fake.world.host,
            at_board,
            kill_test_process,
        ),
        operator if has_operator else None,
        SelftestOptions(load, one_shot_us, second),
        watch,
        kill_test_process,
    )
