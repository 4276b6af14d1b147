"""The machines that a fake board can be on.

Owns: their names, which the shipped machine files of these names belong to. A command that only
offers them need not load what opens boards. Must not know: what anything costs on them
(`fake/machines.py`).
"""

from __future__ import annotations

from typing import Final

MODELLED_MACHINES: Final = ("pi4", "pi3", "zero2w")
