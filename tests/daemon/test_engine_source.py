"""A source that makes current with the DAC at zero, or more than it is told, on an armed board: in
which pulse it is told, with which figures, and what skin gets until then.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace

import msgspec
import pytest

import engine_rig
from engine_rig import EngineRig
from engine_scenes import config, first_fault, fully_open, halts, only, scans
from etd.files.configuration import LoadedConfig, fake_config
from etd.files.resources import names
from etd_body.electrode import Contact
from etd_hal.backend import Backend
from etd_hal.boardfile import Relays
from etd_hal.fake.faults import AdcNoise, DacGain, DacOffset, DacStuck, Fault, LostSync
from etd_hal.ports import Message, Spi

pytestmark = pytest.mark.slow

Armed = Callable[[str | LoadedConfig], EngineRig]
BOARDS = names("boards")
WITH_ONE_SHOT = "reference-hv507"
POLARITIES = ("anodic", "cathodic", "biphasic", "biphasic_cathodic_first")
N, PULSE_UA, WIDTH_US = 16, 1_000, 100
#: Above what 20 uA make of the leak of 66 k, tolerance and noise included.
CHARGED_V = 2.7
#: From the first connection to the outputs' being cut, the message and the judgment of it included.
VISIT_US = 200


@pytest.fixture
def armed() -> Iterator[Armed]:
    """A board with a fingertip on it, and the soft start done. What a test has put in is taken out
    in the end: then it must be possible to make the board safe. Lines that were moved while the
    source stood above zero are the fault's doing.
    """
    made: list[EngineRig] = []

    def make(board: str | LoadedConfig) -> EngineRig:
        loaded = fake_config(board=board, electrodes=N) if isinstance(board, str) else board
        made.append(engine_rig.make(loaded=loaded, is_traced=False))
        return fully_open(made[-1], PULSE_UA)

    yield make
    for rig in made:
        rig.fake.world.mend()
        assert [text for text in rig.close() if "with the DAC at code" not in text] == []
        assert rig.fake.dac_code == 0


def passed_uc(rig: EngineRig) -> float:
    """What has gone through the skin so far: in at one electrode, out at others."""
    body = rig.fake.world.body
    pc = rig.fake.ask_body(
        lambda: sum(body.absolute_charge_pc(electrode) for electrode in range(body.electrode_count))
    )
    return pc / 2e6


def code_of(rig: EngineRig, current_ua: int) -> int:
    source = rig.engine.components.loaded.board.source
    return min(4_095, current_ua * 4_095 // source.full_scale_ua)


def pulses_until_halted(rig: EngineRig, **fields: object) -> int:
    """A frame on all electrodes; how many pulses were reported of it."""
    before = rig.engine.components.reporter.counters["pulses"]
    rig.send(current_ua=(PULSE_UA,) * N, width_us=WIDTH_US, rate_hz=5.0, ttl_ms=1_000, **fields)
    rig.run_ms(150)
    return rig.engine.components.reporter.counters["pulses"] - before


def shown_v(rig: EngineRig) -> list[float]:
    """What the node came to, of the last scans."""
    last = [scan.fired.voltage_v for scan in scans(rig)[-2:]]
    return [value for scan in last for value in scan if value is not None]


def shown_probes_ua(rig: EngineRig) -> list[int]:
    return [electrode for scan in scans(rig) for electrode in scan.fired.probe_ua]


def has_relays(rig: EngineRig) -> bool:
    return isinstance(rig.engine.components.loaded.board.switch, Relays)


# --- current at code 0 ----------------------------------------------------------------------------


@pytest.mark.parametrize("polarity", POLARITIES)
@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("standing_ua", [600, 1_000, 3_200, 10_000])
def test_a_dac_that_stands_above_zero_ends_in_the_first_visit(
    armed: Armed, board: str, polarity: str, standing_ua: int
) -> None:
    rig = armed(board)
    rig.fake.world.put_in(DacStuck(code_of(rig, standing_ua)))
    before_uc = passed_uc(rig)
    assert pulses_until_halted(rig, polarity=polarity) == 0
    assert first_fault(rig) == "BoardFault"
    assert "a current flows that was not commanded" in halts(rig)[0].detail
    most_uc = 0.001 if has_relays(rig) else standing_ua * VISIT_US / 1e6
    assert passed_uc(rig) - before_uc <= most_uc


@pytest.mark.parametrize("board", BOARDS)
def test_the_halt_tells_the_electrode_and_what_the_node_read(armed: Armed, board: str) -> None:
    rig = armed(board)
    rig.fake.world.put_in(DacStuck(code_of(rig, 3_200)))
    pulses_until_halted(rig)
    detail = halts(rig)[0].detail
    if has_relays(rig):
        assert "node with the DAC at zero: measured 211.1 V with all relays open" in detail
        assert "at most 3.3 V" in detail
    else:
        assert "before the pulse at electrode 0, with the DAC at zero: measured" in detail
        assert "at most 5.0 V" in detail


@pytest.mark.parametrize("polarity", POLARITIES)
@pytest.mark.parametrize("board", BOARDS)
def test_an_offset_of_4_ma_ends_in_the_first_visit(armed: Armed, board: str, polarity: str) -> None:
    rig = armed(board)
    rig.fake.world.put_in(DacOffset(4_000))
    before_uc = passed_uc(rig)
    assert pulses_until_halted(rig, polarity=polarity) == 0
    assert first_fault(rig) == "BoardFault"
    most_uc = 0.001 if has_relays(rig) else (4_000 + PULSE_UA) * VISIT_US / 1e6
    assert passed_uc(rig) - before_uc <= most_uc


@pytest.mark.parametrize("board", [board for board in BOARDS if board != WITH_ONE_SHOT])
def test_a_pulse_whose_end_the_dac_has_missed_is_the_last(armed: Armed, board: str) -> None:
    """The current goes on through the rest: blanked on half-bridges, through the leak's relays on
    others, until these open.
    """
    rig = armed(board)
    # Of a pulse with a sample near its end, the third word is the zero.
    words_before = 1 if has_relays(rig) else 0
    rig.fake.world.put_in(LostSync(at_edge=words_before + 3))
    assert pulses_until_halted(rig) == 1
    assert "a current flows that was not commanded" in halts(rig)[0].detail


def test_a_one_shot_ends_such_a_pulse_by_itself(armed: Armed) -> None:
    rig = armed(WITH_ONE_SHOT)
    rig.fake.world.put_in(LostSync(at_edge=3))
    assert pulses_until_halted(rig) >= N
    assert rig.state == "ARMED"


def test_a_current_that_stands_in_skin_of_little_resistance_is_told_by_the_probe_at_no_output(
    armed: Armed,
) -> None:
    """There it lifts the node by less than the charge that skin may hold does; with no output
    selected, as far as a current into the leak.
    """
    rig = armed("kajimoto-hv507")
    for electrode in range(N):
        rig.fake.world.touch(electrode, Contact("skin", 2_000.0, 8_000.0, 1_000.0))
    frame = {"current_ua": (PULSE_UA // 4,) * N, "width_us": 50, "rate_hz": 25.0, "ttl_ms": 1_000}
    rig.send(**frame)
    rig.run_ms(500)
    assert rig.state == "ARMED"
    begun_ns = rig.clock.now_ns()
    # Of each message the third word, which is the zero.
    rig.fake.world.put_in(LostSync(every=3))
    rig.run_ms(200)
    assert first_fault(rig) == "BoardFault"
    # A tenth of a second and the scan under way.
    assert halts(rig)[0].t_ns - begun_ns <= 145e6


@pytest.mark.parametrize("board", ["kajimoto-hv507", "feetthrough-relay"])
def test_what_a_probe_has_left_in_the_skin_is_no_current(armed: Armed, board: str) -> None:
    """Dry skin: its time constant beside the leak is about that between probe and pulse."""
    loaded = config(board, N)
    probing = msgspec.structs.replace(loaded.body_site.stabilize, probe_first=True)
    site = msgspec.structs.replace(loaded.body_site, stabilize=probing)
    rig = armed(replace(loaded, body_site=site))
    rig.fake.world.put_in(AdcNoise(1.5))
    for electrode in range(N):
        rig.fake.world.touch(electrode, Contact("skin", 2_000.0, 500_000.0, 0.3))
    assert pulses_until_halted(rig) >= N
    assert rig.state == "ARMED"
    assert max(shown_probes_ua(rig)) > 0


class Happens:
    """A bus on which something happens right behind a message with current."""

    def __init__(self, spi: Spi) -> None:
        self._spi = spi
        #: How many messages had current since `then` was set.
        self.messages = 0
        self.then: Callable[[], object] | None = None

    def prepare(self, message: Message) -> None:
        self._spi.prepare(message)

    def transfer(self, message: Message) -> tuple[bytes, ...]:
        received = self._spi.transfer(message)
        if self.then is not None and any(part.tx.strip(b"\0") for part in message.transfers):
            self.messages += 1
            if self.messages == 1:
                self.then()
        return received


@pytest.mark.parametrize("polarity", ["anodic", "cathodic"])
def test_a_current_that_stands_since_the_probe_ends_in_the_pulse_behind_it(polarity: str) -> None:
    """It does not pass for what the probe has left in the skin."""
    buses: list[Happens] = []

    def wrap(backend: Backend) -> Backend:
        buses.append(Happens(backend.spi))
        return replace(backend, spi=buses[0])

    loaded = config("kajimoto-hv507", N)
    probing = msgspec.structs.replace(loaded.body_site.stabilize, probe_first=True)
    loaded = replace(loaded, body_site=msgspec.structs.replace(loaded.body_site, stabilize=probing))
    rig = fully_open(engine_rig.make(loaded=loaded, wrap=wrap, is_traced=False), PULSE_UA)
    buses[0].then = lambda: rig.fake.world.put_in(DacOffset(3_000))
    assert pulses_until_halted(rig, polarity=polarity) == 0
    assert first_fault(rig) == "BoardFault"
    detail = halts(rig)[0].detail
    assert "before the pulse at electrode 0, with the DAC at zero" in detail
    assert buses[0].messages == 2, "the probe, and its pulse"
    rig.fake.world.mend()
    assert [text for text in rig.close() if "with the DAC at code" not in text] == []


@pytest.mark.parametrize("polarity", ["anodic", "cathodic"])
def test_skin_that_stays_charged_is_told_from_a_current_on_relays(
    armed: Armed, polarity: str
) -> None:
    """A capacity that neither the rest nor the time between pulses empties: the node before a
    pulse reads some volts, and in a weak one more than current x leak. With all relays open it
    reads none.
    """
    rig = armed("feetthrough-relay")
    rig.fake.world.touch(3, Contact("skin", 2_000.0, 50_000_000.0, 100.0))
    for hold_ms, current_ua, width_us in ((400, PULSE_UA, 200), (60, 20, 50)):
        rig.hold(
            hold_ms,
            current_ua=only(N, e3=current_ua),
            width_us=width_us,
            rate_hz=40.0,
            polarity=polarity,
        )
    assert max(shown_v(rig)) > CHARGED_V
    assert rig.state == "ARMED"


# --- more current than was commanded --------------------------------------------------------------


@pytest.mark.parametrize("board", BOARDS)
def test_a_node_above_current_times_leak_ends_in_that_pulse(armed: Armed, board: str) -> None:
    rig = armed(board)
    rig.fake.world.put_in(DacGain(4.0))
    before_uc = passed_uc(rig)
    assert pulses_until_halted(rig) == 0
    assert first_fault(rig) == "BoardFault"
    assert "current x leak: more current flows than was commanded" in halts(rig)[0].detail
    assert passed_uc(rig) - before_uc <= 4 * PULSE_UA * WIDTH_US / 1e6


@pytest.mark.parametrize("fault", [AdcNoise(1.5), DacGain(1.15)])
@pytest.mark.parametrize("board", BOARDS)
def test_an_electrode_in_the_air_on_a_board_within_its_tolerance_is_none(
    armed: Armed, board: str, fault: Fault
) -> None:
    rig = armed(board)
    rig.fake.world.put_in(fault)
    for electrode in range(0, N, 2):
        rig.fake.world.lift(electrode)
    assert pulses_until_halted(rig) >= N // 2
    assert rig.state == "ARMED"
