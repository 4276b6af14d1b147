"""A fake board on a stepped clock, with everything a test wants to look at.

Owns: how tests put a shipped board file, a body and a trace together.
"""

from __future__ import annotations

import io
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from etd_hal.backend import Backend
from etd_hal.boardfile import BoardFile, load_board
from etd_hal.compose import codec_of
from etd_hal.fake.board import FakeBoard
from etd_hal.fake.clock import SteppedClock
from etd_hal.fake.faults import Fault
from etd_hal.fake.fingertip import fingertip_body
from etd_hal.fake.trace import Trace
from etd_hal.fake.world import Touchable
from etd_hal.linesetup import line_setup, spi_setup
from followed_trace import FollowedTrace

BOARDS = Path(__file__).parent.parent / "config" / "boards"


class KeptBytes(io.BytesIO):
    """A file in memory that can still be read when it was closed."""

    def close(self) -> None:
        pass


@dataclass(frozen=True, slots=True)
class SteppedBoard:
    """A board file made live on the fake, its ports requested."""

    board: BoardFile
    fake: FakeBoard
    clock: SteppedClock
    body: Touchable
    backend: Backend
    traced: KeptBytes
    followed: FollowedTrace

    def trace_lines(self) -> list[dict[str, Any]]:
        """The trace so far, its header first."""
        return list(self.followed.records())

    def events(self, bus: str) -> list[dict[str, Any]]:
        return [event for event in self.trace_lines()[1:] if event["bus"] == bus]


def shipped_board(name: str) -> BoardFile:
    return load_board(BOARDS / f"{name}.toml")


def stepped_board(
    name: str = "kajimoto-hv507",
    *,
    electrodes: Sequence[int] | None = None,
    body: Touchable | None = None,
    faults: Iterable[Fault] = (),
    board: BoardFile | None = None,
) -> SteppedBoard:
    """All outputs of the board as electrodes on a fingertip, unless told otherwise."""
    board = board or shipped_board(name)
    electrodes = range(board.switch.outputs) if electrodes is None else electrodes
    body = body or fingertip_body(board, len(electrodes))
    clock = SteppedClock()
    traced = KeptBytes()
    fake = FakeBoard(board, clock, body, electrodes=electrodes, trace=Trace(traced), faults=faults)
    ports = fake.request(line_setup(board), spi_setup(board))
    backend = Backend(
        "fake",
        *(ports.spi, ports.gpio, ports.i2c, clock, ports.marker, ports.close),
        host_clock=clock,
        codec=codec_of(board.source),
    )
    return SteppedBoard(board, fake, clock, body, backend, traced, FollowedTrace(traced))
