"""The gateway's configuration, and the checks of it before anything is opened.

Owns: the configuration's fields and the operators' user ids. Must not know: sockets, the engine.
"""

from __future__ import annotations

import os
import pwd
from dataclasses import dataclass
from pathlib import Path

from etd.protocol.errors import FileError, Refused


@dataclass(frozen=True, slots=True, kw_only=True)
class GatewayConfig:
    """Folders, names and rights of one gateway.

    runtime_folder: the three sockets for clients, and the two of the engine.
    state_dir: records are kept in its folder `records`.
    calibrations: their folder, which this process only reads; None: in `state_dir`.
    shipped_calibrations: those of the fake's own body; offered only while the engine drives a
    fake board.
    operators: user names or ids that may arm and clear a halt; empty: every user that reaches
    the socket.
    """

    name: str
    runtime_folder: Path
    state_dir: Path
    calibrations: Path | None = None
    shipped_calibrations: Path | None = None
    default_calibration: str | None = None
    operators: tuple[str, ...] = ()
    #: The record that begins with the gateway.
    record: str | None = None


class Operators:
    """The users that may operate. Raises, when made: FileError (unknown user)."""

    def __init__(self, operators: tuple[str, ...]) -> None:
        self._uids = frozenset(_uid(operator) for operator in operators)

    def is_one(self, uid: int | None) -> bool:
        """By name; and root, and the user of the gateway itself, who have its files anyhow."""
        return uid in self._uids or uid in (0, os.geteuid())

    def check(self, uid: int | None) -> None:
        """Where none is named, all may. Raises: Refused (`not_permitted`)."""
        if self._uids and not self.is_one(uid):
            raise Refused(
                "not_permitted",
                f"user {uid} has no operate rights: only users listed as operators in the"
                " configuration have them",
            )


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
