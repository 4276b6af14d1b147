"""The gateway's configuration, and the checks of it before anything is opened.

Owns: the configuration's fields and the operators' user ids. Must not know: sockets, the engine.
"""

from __future__ import annotations

import pwd
from dataclasses import dataclass
from pathlib import Path

from etd.protocol.errors import FileError


@dataclass(frozen=True, slots=True, kw_only=True)
class GatewayConfig:
    """Folders, names and rights of one gateway.

    runtime_folder: the three sockets for clients, and the two of the engine.
    state_dir: calibrations are kept in its folder `calibrations`.
    shipped_calibrations: those of the fake's own body; offered only while the engine drives a
    fake board.
    operators: user names or ids that may arm, clear and set calibrations; empty: whoever reaches
    the socket.
    """

    name: str
    runtime_folder: Path
    state_dir: Path
    shipped_calibrations: Path | None = None
    default_calibration: str | None = None
    operators: tuple[str, ...] = ()


def operator_uids(operators: tuple[str, ...]) -> frozenset[int] | None:
    """The user ids that may operate, or None for everybody. Raises: FileError (unknown user)."""
    if not operators:
        return None
    return frozenset(_uid(operator) for operator in operators)


def _uid(operator: str) -> int:
    if operator.isdecimal():
        return int(operator)
    try:
        return pwd.getpwnam(operator).pw_uid
    except KeyError:
        raise FileError(
            "the configuration",
            "operators",
            f"there is no user {operator!r}",
            "give a user's name or number as `id` prints it",
        ) from None
