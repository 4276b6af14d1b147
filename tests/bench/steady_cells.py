"""One cell of bodies x laws x fingers: it is played once, and kept on disk.

Owns: how much of a finger is played, what a kept result stands on, and where it lies. A result is
found again by body, law, finger, how much was played, and a digest of all code that plays it (what
this module imports, and what that imports): a run that was cut continues where it stopped, and code
that changed begins anew.
Must not know: what is made of the figures.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import asdict, dataclass, fields, replace
from functools import cache
from math import nan
from pathlib import Path

import msgspec

from bench.import_closure import closure
from bench.steady_figures import SteadyFigures, figures
from bench.steady_fit_own import own_fit
from bench.steady_laws import LAWS, NONE, OWN_K
from bench.steady_run import ANYBODYS, run
from etd.protocol.exponent import FittedExponent
from etd_body.kinds import BodyKind

_CLONE = Path(__file__).resolve().parents[2]
KEPT = _CLONE / "build" / "steady"
#: What is not imported, and plays a result all the same.
_SETTINGS = "config/**/*.toml"
_ROOTS = (_CLONE / "daemon", _CLONE / "hal", _CLONE / "tests")
LEVEL = 0.6


@dataclass(frozen=True)
class Form:
    """How much is played of each finger: `pieces` of its minutes (see `steady_skin`), or all."""

    name: str
    electrodes: int
    minutes: float
    pieces: int | None


@dataclass(frozen=True)
class Cell:
    """One finger of one body under one law."""

    form: Form
    body: BodyKind
    law: str
    seed: int

    def path(self, folder: Path = KEPT) -> Path:
        form = self.form
        played = f"{form.electrodes}-{form.minutes:g}min-{form.pieces or 'all'}"
        law = self.law.replace(" ", "")
        return folder / digest() / played / f"{self.body}.{law}.{self.seed}.json"

    def kept(self, folder: Path = KEPT) -> SteadyFigures | None:
        """None where it was not played, or with other code."""
        try:
            found = msgspec.json.decode(self.path(folder).read_bytes())
        except FileNotFoundError:
            return None
        # JSON has no number for what is nothing.
        number = {field.name for field in fields(SteadyFigures) if field.type == "float"}
        given = {key: nan if key in number and it is None else it for key, it in found.items()}
        return msgspec.convert(given, SteadyFigures)

    def played(self, folder: Path = KEPT) -> SteadyFigures:
        """As it was kept, or played now and kept."""
        found = self.kept(folder)
        if found is None:
            found = self._played(folder)
            _keep(self.path(folder), found)
        return found

    def _played(self, folder: Path) -> SteadyFigures:
        """Where a law goes by the person's own k, and the fit refuses this person, there is no law:
        a lease is refused, and what is felt is what is felt without one.
        """
        form, exponent = self.form, ANYBODYS if LAWS[self.law].power_law is not None else None
        if self.law in OWN_K:
            fitted = own_fit(self.body, self.seed, form.electrodes)
            if not isinstance(fitted, FittedExponent) or fitted.why_not is not None:
                plain = Cell(form, self.body, NONE, self.seed).played(folder)
                return replace(plain, name=self.law, is_refused=True)
            exponent = fitted
        ran = run(
            self.seed,
            LAWS[self.law],
            LEVEL,
            form.minutes,
            form.pieces,
            electrodes=form.electrodes,
            kind=self.body,
            exponent=exponent,
        )
        return figures(self.law, [ran])


def _keep(path: Path, found: SteadyFigures) -> None:
    """Whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_suffix(f".{os.getpid()}.tmp")
    beside.write_bytes(msgspec.json.encode(asdict(found)))
    beside.replace(path)


@cache
def played_by() -> frozenset[Path]:
    """All code that plays a result, and the settings."""
    return frozenset(closure([Path(__file__)], _ROOTS) | set(_CLONE.glob(_SETTINGS)))


@cache
def digest() -> str:
    """Of all that a result depends on."""
    found = hashlib.sha256()
    for path in sorted(played_by()):
        found.update(str(path.relative_to(_CLONE)).encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()[:16]
