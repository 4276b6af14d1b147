"""What `etd.toml` says, and the files it names, checked against one another.

Owns: the configuration of a daemon, the loading of all it names, and the rules between those
files. Must not know: how any of it is driven; what a client wants.

Nothing is assumed: a missing key is a refusal, and what a board has not must be accepted by name.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

from msgspec import Meta

from etd.files.array import ARRAY_FOR_COUNT, Array, array_for_count, check_fits, load_array
from etd.files.body_site import BodySite, load_body_site
from etd.files.etactilekit import read_layout
from etd.files.resources import Kind, find
from etd.protocol.frame import Name
from etd_hal.boardfile import GUARDS, BoardFile, MachineFile, load_board, load_machine
from etd_hal.errors import FileError
from etd_hal.names import whole
from etd_hal.tomlfile import Strict, load_toml

Backend = Literal["linux", "fake"]
#: The name of a shipped file, or a path: absolute, or from the folder of the file that names it.
FileName = Annotated[str, Meta(min_length=1, max_length=200)]

#: As adduser takes them, those of a domain too; or a number.
_USER = whole(r"[A-Za-z0-9_][A-Za-z0-9_.@+$\\-]*")

#: What the fake is made of when nobody says otherwise.
FAKE_BOARD = "kajimoto-hv507"
FAKE_STACK = "etactilekit-hv513-x8"
#: A pattern with more electrodes than this needs the stack.
FAKE_LARGEST = 64


class EngineConfig(Strict, frozen=True):
    """Where and how urgently the scan thread runs; needs the rights that the unit grants."""

    #: The processor core it is bound to; "any" leaves it to the kernel.
    core: Annotated[int, Meta(ge=0, le=63)] | Literal["any"]
    #: SCHED_FIFO priority; "none" leaves it an ordinary thread, which every report then says.
    priority: Annotated[int, Meta(ge=1, le=98)] | Literal["none"]

    @property
    def scan_core(self) -> int | None:
        """None: the kernel chooses."""
        return None if self.core == "any" else self.core

    @property
    def stopper_priority(self) -> int | None:
        """Above the scan thread's. None: ordinary, as that is."""
        return None if self.priority == "none" else self.priority + 1


class EtdConfig(Strict, frozen=True):
    """`etd.toml`, key by key."""

    backend: Backend
    board: FileName
    machine: FileName
    array: FileName
    body_site: FileName
    #: Arming needs every absent guard of the board in this list.
    accept_absent_guards: tuple[str, ...]
    #: User names that may arm, clear and store calibrations; empty: all who reach the socket.
    operators: tuple[Annotated[str, Meta(min_length=1, max_length=32, pattern=_USER)], ...]
    engine: EngineConfig
    #: Refused while there are no keys.
    tcp: str | None = None
    #: Offered to clients as the calibration to open with.
    default_calibration: Name | None = None


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
    #: What had to be mended in a layout file of another kit, a sentence each: to be shown.
    mended: tuple[str, ...] = ()
    #: SHA-256 of each file, by what it describes; a fake without a file has no configuration.
    digests: dict[str, str] = field(default_factory=dict)
    #: Of the board's file, as it was read.
    board_file: Path = Path()

    @property
    def unaccepted_guards(self) -> tuple[str, ...]:
        """What the board lacks and nobody has accepted: arming is refused while there is any."""
        accepted = self.config.accept_absent_guards
        return tuple(name for name in self.board.absent_guards if name not in accepted)


def load_config(path: Path) -> LoadedConfig:
    """Read `etd.toml` and all it names, and check them together. Raises: FileError."""
    loaded = _load_named(load_toml(path, EtdConfig), path.resolve().parent, str(path))
    loaded.digests["configuration"] = digest_of(path)
    return loaded


def fake_config(
    board: str | None = None,
    array: str | None = None,
    electrodes: int | None = None,
    machine: str = "pi4",
) -> LoadedConfig:
    """The fake's own configuration; `electrodes` (a pattern's, say) choose what is not named.

    Its absent guards are accepted, because its skin is nobody's. Raises: FileError.
    """
    many = electrodes is not None and electrodes > FAKE_LARGEST
    board_name = board or (FAKE_STACK if many else FAKE_BOARD)
    board_file = load_board(find("boards", board_name))
    array_name = array or array_for_count(electrodes or board_file.switch.outputs)
    config = EtdConfig(
        backend="fake",
        board=board_name,
        machine=machine,
        array=array_name,
        body_site="fingertip",
        accept_absent_guards=board_file.absent_guards,
        operators=(),
        engine=EngineConfig(core="any", priority="none"),
        default_calibration=fake_calibration_of(array_name),
    )
    return _load_named(config, Path.cwd(), "the fake")


def fake_calibration_of(array: str) -> str | None:
    """The shipped calibration of the fake's body on a shipped array; None for any other array."""
    if array == ARRAY_FOR_COUNT[FAKE_LARGEST]:
        return "fake-fingertip"
    return f"fake-fingertip-{array}" if array in ARRAY_FOR_COUNT.values() else None


def _load_named(config: EtdConfig, folder: Path, source: str) -> LoadedConfig:
    _check_no_tcp(config, source)

    paths: dict[str, Path] = {}

    def named(kind: Kind, key: str) -> Path:
        paths[key] = _resolve(kind, getattr(config, key), folder, source, key)
        return paths[key]

    array, mended = read_array(named("arrays", "array"))
    loaded = LoadedConfig(
        config=config,
        board=load_board(named("boards", "board")),
        machine=load_machine(named("machines", "machine")),
        array=array,
        body_site=load_body_site(named("bodysites", "body_site")),
        source=source,
        mended=mended,
        digests={key: digest_of(path) for key, path in paths.items()},
        board_file=paths["board"],
    )
    check_fits(array, loaded.board.switch.outputs, source)
    _check_guards(loaded)
    _check_site(loaded)
    _check_pressure(loaded)
    return loaded


def digest_of(path: Path) -> str:
    """SHA-256 of a file."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def read_array(path: Path) -> tuple[Array, tuple[str, ...]]:
    """An array file of ours, or a layout file of eTactileKit, which is JSON."""
    return read_layout(path) if path.suffix == ".json" else (load_array(path), ())


def _resolve(kind: Kind, name: str, folder: Path, source: str, key: str) -> Path:
    """A path is from `folder`, all else a shipped name. Raises: FileError, naming what names it."""
    try:
        return find(kind, name, folder)
    except FileError as error:
        raise FileError(source, key, f"it says {name!r}: {error.value}", error.allowed) from error
    except OSError as error:
        raise FileError(source, key, f"{name!r} cannot be read ({error})", "check it") from error


def _check_no_tcp(config: EtdConfig, source: str) -> None:
    if config.tcp is not None:
        raise FileError(
            source,
            "tcp",
            f"it says {config.tcp!r}",
            "leave it out: this version has no keys, and without them nobody is let in over a"
            " network; use the Unix sockets, from another computer over ssh (`--host USER@HOST`)",
        )


def _check_guards(loaded: LoadedConfig) -> None:
    absent = loaded.board.absent_guards
    for index, name in enumerate(loaded.config.accept_absent_guards):
        key = f"accept_absent_guards[{index}]"
        if name not in GUARDS:
            raise FileError(
                loaded.source, key, f"there is no guard {name!r}", f"one of {', '.join(GUARDS)}"
            )
        if name not in absent:
            raise FileError(
                loaded.source,
                key,
                f"the board {loaded.board.name} has {name}",
                "remove it from the list: its absence is not to be accepted in advance",
            )


def _check_site(loaded: LoadedConfig) -> None:
    site, array, board = loaded.body_site, loaded.array, loaded.board
    if array.diameter_mm < site.electrode_diameter_mm:
        raise FileError(
            loaded.source,
            "body_site",
            f"{site.name} holds for electrodes of {site.electrode_diameter_mm} mm and larger,"
            f" those of {array.name} have {array.diameter_mm} mm",
            "the same charge through less skin is another matter: name a body site made for them",
        )
    for key in ("width_us", "rate_hz"):
        default, most = getattr(site.defaults, key), getattr(board.maxima, key)
        if default > most:
            raise FileError(
                loaded.source,
                "body_site",
                f"the default {key} of {site.name} is {default}, {board.name} allows {most}",
                "name another body site, or a board that can do it",
            )


def _check_pressure(loaded: LoadedConfig) -> None:
    sensors, board = loaded.array.pressure, loaded.board
    if loaded.body_site.stabilize.pressure is not None and not sensors:
        raise FileError(
            loaded.source,
            "body_site",
            f"{loaded.body_site.name} goes by pressure, {loaded.array.name} has no sensor",
            "describe the sensors under the array in its file, or take the law out of the site's",
        )
    if sensors and board.i2c == "absent":
        raise FileError(
            loaded.source,
            "array",
            f"{loaded.array.name} has pressure sensors, {board.name} has no I2C",
            "name the bus in the board file, or an array without sensors",
        )
    monitor = board.guards.rail_monitor
    for index, sensor in enumerate(sensors):
        if monitor != "absent" and (sensor.address, sensor.channel) == (
            monitor.address,
            monitor.channel,
        ):
            raise FileError(
                loaded.source,
                "array",
                f"pressure[{index}] of {loaded.array.name} is on the input of {board.name} that"
                " watches the rail",
                "give each an input of its own",
            )
