"""What a fuzzer keeps: inputs that reach something new, findings, and what it was last clean for.

Owns: the folders, and the digests of decoders. Must not know: how inputs are made and played.
"""

from __future__ import annotations

import hashlib
import traceback
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path

from fuzz.target import Target

HERE = Path(__file__).resolve().parent
CLONE = HERE.parents[1]
BUILD = CLONE / "build" / "fuzz"
#: Inputs that were findings once, in the repository: each is played by `make check`.
KEPT = HERE / "corpus"
FUZZED = HERE / "fuzzed.txt"
_ABOUT = (
    "# The decoders of each target as they were when it was last fuzzed after a change, without a\n"
    "# finding: a minute at least, and ten at least with all that had changed together.\n"
)


def starts(target: Target) -> list[bytes]:
    """Seeds, and what was found once."""
    return [*target.seeds(), *(path.read_bytes() for path in kept(target))]


def kept(target: Target) -> list[Path]:
    return sorted((KEPT / target.name).glob("*"))


def written(folder: Path, inputs: Iterable[bytes]) -> Path:
    """A file for each, named by its content."""
    folder.mkdir(parents=True, exist_ok=True)
    for data in inputs:
        (folder / hashlib.sha1(data).hexdigest()).write_bytes(data)
    return folder


def keep_finding(folder: Path, data: bytes, error: BaseException) -> Path:
    """The input, and beside it why."""
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"finding-{hashlib.sha1(data).hexdigest()}"
    path.write_bytes(data)
    path.with_suffix(".txt").write_text("".join(traceback.format_exception(error)))
    return path


def findings(folder: Path) -> dict[Path, int]:
    """Inputs alone, with when each was found last; the fuzzer has its own names for one that hangs
    or takes all memory.
    """
    paths = sorted(path for path in folder.glob("*-*") if path.suffix != ".txt")
    return {path: path.stat().st_mtime_ns for path in paths}


def digest(target: Target) -> str:
    """Of all that decodes there."""
    found = hashlib.sha256()
    for path in _decoders(target):
        found.update(str(path.relative_to(CLONE)).encode() + b"\0" + path.read_bytes() + b"\0")
    return found.hexdigest()[:16]


def _decoders(target: Target) -> Iterator[Path]:
    for pattern in target.decoders:
        paths = sorted(CLONE.glob(pattern))
        if not paths:
            raise FileNotFoundError(f"{target.name}: {pattern} names no file")
        yield from paths


def _fuzzed(path: Path) -> dict[str, str]:
    lines = path.read_text().splitlines() if path.exists() else []
    return dict(line.split() for line in lines if not line.startswith("#"))


def changed(targets: Sequence[Target], path: Path = FUZZED) -> list[Target]:
    """Those whose decoders are not as they were."""
    before = _fuzzed(path)
    return [target for target in targets if before.get(target.name) != digest(target)]


def note_fuzzed(targets: Sequence[Target], path: Path = FUZZED) -> None:
    """These are clean as they are now."""
    known = _fuzzed(path) | {target.name: digest(target) for target in targets}
    path.write_text(_ABOUT + "".join(f"{name} {value}\n" for name, value in sorted(known.items())))
