"""What a self-test has tested: board, machine, array, strength, program.

Owns: whether a self-test is valid for what is used now. Must not know: what is checked, files of
reports.

Names are for people. The comparison is of contents: the whole files, the individual machine, the
outputs that were tested, the strongest pulse.
"""

from __future__ import annotations

import hashlib
from typing import Literal

import msgspec

from etd.files.configuration import LoadedConfig
from etd.safety.maxima import maxima_of
from etd.version import __version__
from etd_hal import compiled


class Subject(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """What was tested, or what would be armed."""

    backend: Literal["linux", "fake"]
    board: str
    #: Of the content of the board file.
    board_digest: str
    machine: str
    machine_digest: str
    #: A digest of the individual machine's serial; "" if it has none.
    machine_identity: str
    array: str
    #: The switch's output of each electrode.
    outputs: tuple[int, ...]
    body_site: str
    #: The highest current that this body site allows, at the probe's width.
    strongest_ua: int
    program: str

    @property
    def configuration(self) -> str:
        """A file name for board, machine file, array and strength together."""
        parts = (self.board_digest, self.machine_digest, self.outputs, self.strongest_ua)
        return f"{self.board}-{_digest(parts)[:12]}"


def subject_of(
    loaded: LoadedConfig, backend: Literal["linux", "fake"], machine_identity: str
) -> Subject:
    """What would be tested or armed now."""
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
        program=f"etd {__version__}, {compiled.runs()}",
    )


def strongest_ua(loaded: LoadedConfig) -> int:
    """The highest current allowed for this board and body site, at the probe's width."""
    maxima = maxima_of(loaded.board, loaded.body_site)
    return min(maxima.current_ua, maxima.charge_pc // maxima.probe_width_us)


def difference(then: Subject, now: Subject) -> str | None:
    """Why a self-test of `then` is not valid for `now`, as a clause; None if it is.

    An array may have fewer electrodes, and a body site may be weaker. Any other version of the
    program counts as a difference, because the program makes and bounds the pulses; so does
    the same version compiled instead of interpreted.
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


def _digest(content: object) -> str:
    """Of the whole content, without comments and the order of keys."""
    return hashlib.sha256(msgspec.json.encode(content, order="deterministic")).hexdigest()
