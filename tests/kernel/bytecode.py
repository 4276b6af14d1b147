"""What the guests' Pythons would otherwise compile again in every process: the tree's own bytecode.

Owns: having it beside the sources before a guest starts. The guests see the tree read-only, and
import it some fifty times in a run. Must not know: who imports what.
"""

from __future__ import annotations

import compileall

from pieces import HERE, TREE, RigFailure

_FOLDERS = (TREE / "daemon", TREE / "hal", TREE / "tests/contract", HERE)


def compile_tree() -> None:
    """Of what has changed since it was compiled. Raises: RigFailure where a file is no Python."""
    # However this Python was told to leave no bytecode behind: that is for its own imports.
    found = [compileall.compile_dir(folder, quiet=1) for folder in _FOLDERS]
    found += [compileall.compile_file(path, quiet=1) for path in (TREE / "tests").glob("*.py")]
    if not all(found):
        raise RigFailure("a file of the tree cannot be compiled: see above")
