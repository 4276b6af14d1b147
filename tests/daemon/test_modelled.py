"""What a fake's body is modelled to feel, from the pulses to the telemetry, and nowhere else."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

import msgspec
import pytest
import zmq

from board_rig import board_rig
from engine_rig import EngineRig
from engine_scenes import fully_open, only
from etd.protocol.link import Report
from etd.protocol.messages import TELEMETRY_OF_TOPIC, Modelled
from etd_body.sensation import Felt
from etd_hal.backend import Backend
from etd_hal.boardfile import BoardFile
from etd_hal.compose import open_fake
from etd_hal.fake.fingertip import living_fingertip
from gateway_rig import GatewayRig
from stepped_board import shipped_board

MakeRig = Callable[..., EngineRig]
PLACES = [(0.0, 0.0), (2.5, 0.0), (0.0, 2.5), (2.5, 2.5)]


def opened(board: BoardFile, positions_mm: list[tuple[float, float]] | None) -> Backend:
    return open_fake(board, electrodes=range(4), positions_mm=positions_mm, stepped=True)


def test_a_fake_that_knows_where_its_electrodes_are_has_a_body_that_feels() -> None:
    backend = opened(shipped_board("kajimoto-hv507"), PLACES)
    assert backend.modelled is not None
    assert backend.modelled().felt == (0.0, 0.0, 0.0, 0.0)
    backend.close()


def test_a_fake_without_places_has_a_body_that_only_conducts() -> None:
    backend = opened(shipped_board("kajimoto-hv507"), None)
    assert backend.modelled is None
    backend.close()


def test_a_backend_models_nothing_unless_somebody_says_so() -> None:
    """Real hardware is opened without."""
    field = next(field for field in dataclasses.fields(Backend) if field.name == "modelled")
    assert field.default is None


NOTHING = Felt((0.0,) * 8, (0.0,) * 8)
FELT = Felt((0.0, 2.5, *(0.0,) * 6), (0.5, *(0.0,) * 7))


class Finger:
    """Says once that it felt something, and then that it does not."""

    def __init__(self) -> None:
        self.left = [FELT]

    def take(self) -> Felt:
        return self.left.pop() if self.left else NOTHING


def told(rig: EngineRig) -> list[Modelled]:
    return [report.modelled for report in rig.reports if report.modelled is not None]


def test_the_engine_tells_what_the_body_behind_its_backend_feels(make_rig: MakeRig) -> None:
    finger = Finger()
    rig = make_rig(
        electrodes=8,
        wrap=lambda backend: dataclasses.replace(backend, modelled=finger.take),
    )
    rig.run_ms(500)
    assert [(modelled.felt, modelled.pain) for modelled in told(rig)] == [FELT, NOTHING]


def test_an_engine_without_such_a_backend_never_tells_anything_modelled(make_rig: MakeRig) -> None:
    rig = fully_open(make_rig(electrodes=16), 500)
    rig.hold(500, current_ua=only(16, e3=2_000))
    assert told(rig) == []


def test_the_gateway_passes_on_what_is_modelled_under_that_name() -> None:
    with GatewayRig() as rig:
        socket = rig.context.socket(zmq.SUB)
        for topic in ("modelled", "state"):
            socket.setsockopt(zmq.SUBSCRIBE, topic.encode())
        socket.connect(f"ipc://{rig.folder}/telemetry.sock")
        rig.until(lambda: bool(socket.poll(0)))
        socket.recv_multipart()
        rig.engine.say(Report(modelled=Modelled(now_ns=7, felt=(1.5,), pain=(0.2,))))
        rig.until(lambda: bool(socket.poll(0)))
        topic_said, body = socket.recv_multipart()
        assert topic_said == b"modelled"
        report = msgspec.json.decode(body, type=TELEMETRY_OF_TOPIC["modelled"])
        assert report == Modelled(now_ns=7, felt=(1.5,), pain=(0.2,))


@pytest.mark.parametrize("is_anodic", [True, False], ids=["anodic", "cathodic"])
def test_a_pulse_on_the_wires_is_felt_by_the_body_under_them(is_anodic: bool) -> None:
    """Through driver, DAC, switch and source: told, made, delivered, felt."""
    file = shipped_board("kajimoto-hv507")
    body = living_fingertip(
        file, [(2.5 * (electrode % 8), 2.5 * (electrode // 8)) for electrode in range(64)]
    )
    rig = board_rig(board=file, body=body)
    rig.begin()
    body.take_felt()
    commanded_ua = body.commanded_threshold_ua(20, 100, "anodic" if is_anodic else "cathodic")
    rig.visit(20, is_anodic, current_ua=int(0.93 * commanded_ua), whole=True)
    below = body.take_felt().felt
    rig.visit(20, is_anodic, current_ua=int(1.07 * commanded_ua), whole=True)
    above = body.take_felt().felt
    assert max(below) == 0.0
    assert [electrode for electrode in range(64) if above[electrode] > 0.0] == [20]
    assert rig.board.safe_off() == ()
