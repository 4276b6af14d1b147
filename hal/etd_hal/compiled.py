"""Whether the code of a pulse runs compiled or interpreted.

Owns: the answer, for `etd status` and for the self-test, whose report holds for that code alone.
Must not know: how it is compiled (`hatch_build.py`), what is compiled beside the guard.
"""

from __future__ import annotations

from importlib.machinery import EXTENSION_SUFFIXES
from typing import Literal

from etd_hal import guard


def runs() -> Literal["compiled", "interpreted"]:
    """By the guard, which is compiled with all the others or with none."""
    is_compiled = guard.__file__.endswith(tuple(EXTENSION_SUFFIXES))
    return "compiled" if is_compiled else "interpreted"
