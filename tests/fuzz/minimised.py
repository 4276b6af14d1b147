"""A corpus without what reaches nothing that others do not reach as well.

Owns: the fuzzer's own merge, in processes of its own: it starts itself again by a script. Must not
know: how time is shared.
"""

from __future__ import annotations

import shlex
import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path


def minimise(name: str, folder: Path, worker: Sequence[str], log: Path) -> bool:
    """The corpus of this target, with the `worker`'s command; False: it was left as it is."""
    corpus, smaller = folder / "corpus" / name, folder / "smaller" / name
    if not any(corpus.iterdir()):
        return False
    shutil.rmtree(smaller, ignore_errors=True)
    smaller.mkdir(parents=True)
    script = folder / f"{name}.sh"
    script.write_text(f'#!/bin/sh\nexec {shlex.join(worker)} --merge "$0" "$@"\n')
    script.chmod(0o755)
    command = [str(script), "-merge=1", str(smaller), str(corpus)]
    with log.open("ab") as told:
        merged = subprocess.run(command, stdout=subprocess.DEVNULL, stderr=told, check=False)
    if merged.returncode or not any(smaller.iterdir()):
        return False
    shutil.rmtree(corpus)
    smaller.rename(corpus)
    return True
