"""What a self-test is of: board, machine, array, strength, program; and whether that is still so.

Owns: what makes a self-test one of something else. Must not know: what is checked, reports' files.

Names are for people. What is compared is what a name stands for: all that a file says, which
machine of its model, which outputs were walked, how strong the strongest pulse was.
"""

from __future__ import annotations

import hashlib
from typing import Literal

import msgspec

from etd.files.configuration import LoadedConfig
from etd.safety.maxima import maxima_of
from etd.version import __version__


class Subject(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """See the module."""

    backend: Literal["linux", "fake"]
    board: str
    #: Of all that the board file says: another file is another board.
    board_digest: str
    machine: str
    machine_digest: str
    #: Which one of its model, as a digest; "" where nothing tells them apart.
    machine_identity: str
    array: str
    #: Of the switch, one for each electrode.
    outputs: tuple[int, ...]
    body_site: str
    #: The most that this body site lets into a load, at the probe's width.
    strongest_ua: int
    program: str

    @property
    def configuration(self) -> str:
        """A name for board, machine file, array and strength together, fit for a file's name."""
        parts = (self.board_digest, self.machine_digest, self.outputs, self.strongest_ua)
        return f"{self.board}-{_digest(parts)[:12]}"


def subject_of(
    loaded: LoadedConfig, backend: Literal["linux", "fake"], machine_identity: str
) -> Subject:
    """What would be tested, or armed, now."""
    return Subject(
        backend=backend,
        board=loaded.board.name,
        board_digest=_digest(loaded.board),
        machine=loaded.machine.name,
        machine_digest=_digest(loaded.machine),
        machine_identity=machine_identity,
        array=loaded.array.name,
        outputs=tuple(loaded.array.outputs()),
        body_site=loaded.body_site.name,
        strongest_ua=strongest_ua(loaded),
        program=f"etd {__version__}",
    )


def strongest_ua(loaded: LoadedConfig) -> int:
    """The most that anybody may get from this board at this body site, at the probe's width."""
    maxima = maxima_of(loaded.board, loaded.body_site)
    return min(maxima.current_ua, maxima.charge_pc // maxima.probe_width_us)


def difference(then: Subject, now: Subject) -> str | None:
    """Why a self-test of `then` says nothing of `now`, as a clause; None if it does.

    An array may have fewer of the electrodes that were walked, a body site may be weaker. Any other
    version of the program counts as another: it is what makes and bounds the pulses.
    """
    checks = (
        (then.backend == now.backend, "backend", then.backend, now.backend),
        (then.board_digest == now.board_digest, "board file", then.board, now.board),
        (then.machine_digest == now.machine_digest, "machine file", then.machine, now.machine),
        (
            then.machine_identity == now.machine_identity,
            "machine",
            _named(then.machine_identity),
            _named(now.machine_identity),
        ),
        (set(now.outputs) <= set(then.outputs), "array", then.array, now.array),
        (
            now.strongest_ua <= then.strongest_ua,
            "strength",
            f"{then.strongest_ua} uA ({then.body_site})",
            f"{now.strongest_ua} uA ({now.body_site})",
        ),
        (then.program == now.program, "version", then.program, now.program),
    )
    for is_same, what, was, here in checks:
        if not is_same:
            return (
                f"another {what} ({was})" if was != here else f"another {what} than {here} is now"
            )
    return None


def _named(identity: str) -> str:
    return identity or "unknown"


def _digest(said: object) -> str:
    """Of everything that a file says, comments and order of keys apart."""
    return hashlib.sha256(msgspec.json.encode(said, order="deterministic")).hexdigest()
