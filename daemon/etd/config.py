"""What `etd.toml` says, and the files it names, checked against one another.

Owns: the configuration of a daemon, the loading of all it names, and the rules between those
files. Must not know: how any of it is driven; what a client wants.

Nothing is assumed: a missing key is a refusal, and what a board has not must be accepted by name.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import msgspec
from msgspec import Meta

from etd.array import Array, array_for_count, check_fits, load_array
from etd.bodysite import BodySite, load_body_site
from etd.calibration import Calibration, load_calibration
from etd.shipped import find
from etd_hal.boardfile import GUARDS, BoardFile, MachineFile, load_board, load_machine, load_toml
from etd_hal.errors import FileError

Backend = Literal["linux", "fake"]
#: The name of a shipped file, or a path: absolute, or from the folder of the file that names it.
FileName = Annotated[str, Meta(min_length=1)]

#: What the fake is made of when nobody says otherwise.
FAKE_BOARD = "kajimoto-hv507"
FAKE_STACK = "etactilekit-hv513-x8"
FAKE_ELECTRODES = 64


class _Strict(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Unknown keys are errors: a typo must not disable a limit."""


class EngineConfig(_Strict):
    """Where and how urgently the scan thread runs; needs the rights that the unit grants."""

    #: The processor core it is bound to; "any" leaves it to the kernel.
    core: Annotated[int, Meta(ge=0, le=63)] | Literal["any"]
    #: SCHED_FIFO priority; "none" leaves it an ordinary thread, which every report then says.
    priority: Annotated[int, Meta(ge=1, le=98)] | Literal["none"]


class EtdConfig(_Strict):
    """`etd.toml`, key by key."""

    backend: Backend
    board: FileName
    machine: FileName
    array: FileName
    body_site: FileName
    #: Arming needs every absent guard of the board in this list.
    accept_absent_guards: tuple[str, ...]
    #: User names that may arm, clear and store calibrations; empty: all who reach the socket.
    operators: tuple[Annotated[str, Meta(min_length=1, max_length=32)], ...]
    engine: EngineConfig
    #: Offered to clients as the calibration to open with.
    default_calibration: Annotated[str, Meta(pattern=r"^[A-Za-z0-9_-]{1,32}$")] | None = None


@dataclass(frozen=True, slots=True)
class LoadedConfig:
    """A configuration with every file it names, all checked against one another."""

    config: EtdConfig
    board: BoardFile
    machine: MachineFile
    array: Array
    body_site: BodySite
    #: The file itself, for messages; "the fake" where there is none.
    source: str

    @property
    def unaccepted_guards(self) -> tuple[str, ...]:
        """What the board lacks and nobody has accepted: arming is refused while there is any."""
        accepted = self.config.accept_absent_guards
        return tuple(name for name in self.board.absent_guards if name not in accepted)


def load_config(path: Path) -> LoadedConfig:
    """Read `etd.toml` and all it names, and check them together. Raises: FileError."""
    config = load_toml(path, EtdConfig)
    folder = path.resolve().parent
    return _load_named(config, folder, str(path))


def fake_config(
    board: str | None = None, array: str | None = None, electrodes: int | None = None
) -> LoadedConfig:
    """The fake's own configuration: `electrodes` (of a pattern, say) choose board and array where
    these are not named. Its absent guards are accepted: its skin is nobody's.

    Raises: FileError.
    """
    count = FAKE_ELECTRODES if electrodes is None else electrodes
    board_name = board or (FAKE_STACK if count > FAKE_ELECTRODES else FAKE_BOARD)
    array_name = array or array_for_count(_shown_on(board_name, electrodes))
    absent = load_board(find("boards", board_name)).absent_guards
    config = EtdConfig(
        backend="fake",
        board=board_name,
        machine="pi4",
        array=array_name,
        body_site="fingertip",
        accept_absent_guards=absent,
        operators=(),
        engine=EngineConfig(core="any", priority="none"),
        default_calibration=fake_calibration_for(array_name),
    )
    return _load_named(config, Path.cwd(), "the fake")
