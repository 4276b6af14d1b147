"""Where the files that we ship are: boards, machines, arrays, body sites, calibrations.

Owns: finding a file of `config/` by its name, in an installed wheel as in a checkout, and the
sentence that lists the names there are. Must not know: what is in the files.
"""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from etd.protocol.errors import FileError

Kind = Literal["boards", "machines", "arrays", "bodysites", "calibrations"]

_PACKAGE = Path(__file__).resolve().parents[1]


def config_dir() -> Path:
    """The folder `config`: inside the installed package, else beside the sources."""
    installed = _PACKAGE / "data" / "config"
    return installed if installed.is_dir() else _PACKAGE.parents[1] / "config"


def names(kind: Kind) -> tuple[str, ...]:
    """The shipped names of this kind, in alphabetical order."""
    return tuple(sorted(path.stem for path in (config_dir() / kind).glob("*.toml")))


def find(kind: Kind, name_or_path: str | Path) -> Path:
    """The path of a shipped file given by name, or of any file given by path.

    What has a folder in it or ends in a suffix is a path (`./mine.toml`, `mine.json`); all else
    is a name. Raises: FileError, listing the names there are.
    """
    if _is_path(name_or_path):
        return _existing(Path(name_or_path), kind)
    wanted = config_dir() / kind / f"{name_or_path}.toml"
    if str(name_or_path) in names(kind):
        return wanted
    raise FileError(
        str(wanted),
        "",
        f"there is no {name_or_path!r} among the shipped {kind}",
        _advice(kind),
    )


def _is_path(name_or_path: str | Path) -> bool:
    if isinstance(name_or_path, Path):
        return True
    return "/" in name_or_path or "\\" in name_or_path or Path(name_or_path).suffix != ""


def _existing(path: Path, kind: Kind) -> Path:
    if path.is_file():
        return path
    raise FileError(str(path), "", "there is no such file", _advice(kind))


def _advice(kind: Kind) -> str:
    return f"name one of {', '.join(names(kind)) or '(none are shipped)'}, or give a path to a file"
