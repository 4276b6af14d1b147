"""Calibrations in a daemon's store, as the command puts them there and takes them out.

Owns: both, by the command itself. Must not know: what is tested.
"""

from __future__ import annotations

from command_rig import CommandRig
from etd.files.calibration import load_calibration, to_toml
from etd.protocol.calibration import Calibration


def import_as(rig: CommandRig, made: Calibration, name: str) -> None:
    path = rig.folder / "imported.toml"
    path.write_text(to_toml(made))
    assert rig.run("calibration", "import", str(path), "--as", name).status == 0


def exported(rig: CommandRig, name: str) -> Calibration:
    path = rig.folder / f"{name}-exported.toml"
    path.unlink(missing_ok=True)
    assert rig.run("calibration", "export", name, str(path)).status == 0
    return load_calibration(path)
