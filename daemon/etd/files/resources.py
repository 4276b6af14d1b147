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


def find(kind: Kind, name: str, folder: Path = Path()) -> Path:
    """The path of a shipped file given by name, or of any file given by path.

    What has a folder in it or ends in a suffix is a path (`./mine.toml`, `mine.json`), from
    `folder`; all else is a name. Raises: FileError, listing the names there are.
    """
    path, what = folder / name, "there is no such file"
    if "/" not in name and "\\" not in name and not Path(name).suffix:
        path = config_dir() / kind / f"{name}.toml"
        what = f"there is no {name!r} among the shipped {kind}"
    if path.is_file():
        return path
    if path.exists():
        what = "it is no regular file"
    advice = (
        f"name one of {', '.join(names(kind)) or '(none are shipped)'}, or give a path to a file"
    )
    raise FileError(str(path), "", what, advice)
