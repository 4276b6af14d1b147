"""The client, installed for another Python, beside a daemon of this one.

Owns: its environment (`build/client`, made anew), the examples and verbs that are run there, and
what each must say. Must not know: what `tests/test_client_python.py` finds without such a Python.

`python tests/client_on.py python3.10` (`make test-client`). It needs pip's index.
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
from pathlib import Path

from command_rig import WITHIN_S, CommandRig, Said, command_rig
from etd.cli import DAEMON_VERBS

CLONE = Path(__file__).parents[1]
HOME = CLONE / "build" / "client"
EXAMPLES = ("hello", "moving_bar", "two_intervals", "stream_numpy", "with_asyncio", "contact")
PATIENT = ("--timeout-factor", "10")
WAVE = {
    "etd_pattern": 1,
    "electrodes": 64,
    "frames": [{"duration_ms": 100, "active": [27]}] * 5,
}
REFUSED = r"needs Python 3\.11 or newer, and .* runs etd's client only"
#: Verb and options, exit status, and a pattern that is in what it says.
VERBS = (
    ("status", 0, "SAFE"),
    ("status --json", 0, '"ok":'),
    ("measure", 0, "touched"),
    ("record start b1", 0, "has begun"),
    ("note changed", 0, ""),
    ("play wave.json --arm", 0, "wave.json: 5 frames"),
    ("record stop", 0, "has ended"),
    ("record show b1", 0, "pulses"),
    ("record csv b1 --out b1.tsv", 0, "events to b1.tsv"),
    ("record pattern b1 frames.json", 0, "frames to frames.json"),
    ("record replay b1", 3, REFUSED),
    ("calibration list", 0, "uA"),
    # Standard input is closed: as where the person's terminal goes away.
    ("calibrate P1 --max-current-ua 2500 --arm", 1, "stopped"),
    ("clear", 0, "cleared"),
    ("monitor --seconds 1", 0, ""),
    ("stop", 0, ""),
    ("clear", 0, "cleared"),
    ("arm", 1, "lease"),
    ("disarm", 1, "only the holder"),
    ("play wave.json --board fake", 3, f"a fake board {REFUSED}"),
    ("calibrate P1 --board fake --max-current-ua 900", 3, f"a fake board {REFUSED}"),
    ("calibration import etd.toml", 3, f"reading TOML {REFUSED}"),
    *((verb, 3, f"etd {verb} {REFUSED}") for verb in sorted(DAEMON_VERBS)),
)


def installed(python: str) -> Path:
    """The Python of an environment with the client, as somebody installs it from a clone."""
    subprocess.run([python, "-m", "venv", "--clear", HOME], check=True, timeout=WITHIN_S)
    program = HOME / "bin" / "python"
    pip = [str(program), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
    # rich and numpy are for the monitor and for an example.
    subprocess.run([*pip, f"{CLONE}[daemon]"], check=True, timeout=10 * WITHIN_S)
    return program


def ran(rig: CommandRig, *words: str | Path) -> Said:
    done = subprocess.run(
        words,
        capture_output=True,
        text=True,
        env=rig.environment,
        cwd=rig.folder,
        stdin=subprocess.DEVNULL,
        timeout=WITHIN_S,
        check=False,
    )
    return Said(done.returncode, done.stdout, done.stderr)


def wrong(rig: CommandRig, python: Path) -> int:
    """How many were not as they should be; each is printed."""
    found = 0
    for name in EXAMPLES:
        words = ("4",) if name == "two_intervals" else ()
        said = ran(rig, python, CLONE / "docs" / "examples" / f"{name}.py", *words)
        found += not _is_told(name, said, said.status == 0 and not said.err)
    for line, status, expected in VERBS:
        said = ran(rig, python, "-m", "etd", *line.split())
        fits = re.search(expected, said.out + said.err) is not None
        found += not _is_told(f"etd {line}", said, said.status == status and fits)
    return found


def _is_told(what: str, said: Said, is_right: bool) -> bool:
    print(f"{'as it should be' if is_right else 'WRONG':<15}  {what}", flush=True)
    if not is_right:
        print(f"status {said.status}\n{said.out}{said.err}")
    return is_right


def main() -> int:
    """0: all as it should be."""
    python = installed(*sys.argv[1:])
    asked = [str(python), "-c", "import etd, sys; print(sys.version, etd.__file__)"]
    print(subprocess.run(asked, capture_output=True, text=True, check=True).stdout, end="")
    with command_rig() as rig:
        (rig.folder / "wave.json").write_text(json.dumps(WAVE))
        (rig.folder / "etd.toml").write_bytes((CLONE / "config" / "etd.toml").read_bytes())
        with rig.daemon(*PATIENT):
            found = wrong(rig, python)
    print(f"{found} wrong of {len(EXAMPLES) + len(VERBS)}")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
