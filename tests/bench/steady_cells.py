"""One cell of bodies x laws x fingers: it is played once, and kept on disk.

Owns: how much of a finger is played, what a kept result stands on, and where it lies. A result is
found again by body, law, finger, how much was played, and a digest of all code that plays it: a run
that was cut continues where it stopped, and code that changed begins anew.
Must not know: what is made of the figures.
"""

from __future__ import annotations

import hashlib
import os
from dataclasses import asdict, dataclass
from functools import cache
from pathlib import Path

import msgspec

from bench.steady_figures import SteadyFigures, figures
from bench.steady_laws import LAWS, K
from bench.steady_run import run
from etd_body.kinds import BodyKind

_CLONE = Path(__file__).resolve().parents[2]
KEPT = _CLONE / "build" / "steady"
_PLAYED_BY = (
    *("daemon/**/*.py", "hal/**/*.py", "config/**/*.toml", "tests/engine_rig.py"),
    *("tests/followed_trace.py", "tests/stepped_stopper.py", "tests/bench/steady_cells.py"),
    *("tests/bench/steady_figures.py", "tests/bench/steady_laws.py"),
    *("tests/bench/steady_run.py", "tests/bench/steady_skin.py"),
)
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
            return msgspec.json.decode(self.path(folder).read_bytes(), type=SteadyFigures)
        except FileNotFoundError:
            return None

    def played(self, folder: Path = KEPT) -> SteadyFigures:
        """As it was kept, or played now and kept."""
        found = self.kept(folder)
        if found is None:
            form = self.form
            ran = run(
                self.seed,
                LAWS[self.law],
                LEVEL,
                form.minutes,
                form.pieces,
                electrodes=form.electrodes,
                kind=self.body,
                k=K if LAWS[self.law].power_law is not None else None,
            )
            found = figures(self.law, [ran])
            _keep(self.path(folder), found)
        return found


def _keep(path: Path, found: SteadyFigures) -> None:
    """Whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    beside = path.with_suffix(f".{os.getpid()}.tmp")
    beside.write_bytes(msgspec.json.encode(asdict(found)))
    beside.replace(path)


@cache
def digest() -> str:
    """Of all code and settings that a result depends on."""
    paths = {path for pattern in _PLAYED_BY for path in _CLONE.glob(pattern)}
    found = hashlib.sha256()
    for path in sorted(paths):
        found.update(str(path.relative_to(_CLONE)).encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()[:16]
