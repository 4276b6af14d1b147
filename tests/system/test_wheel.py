"""The built wheel, installed away from the sources, with nothing but what it says it needs."""

from __future__ import annotations

import email
import subprocess
import sys
import venv
import zipfile
from importlib.metadata import distribution
from pathlib import Path

import pytest
from packaging.requirements import Requirement

pytestmark = pytest.mark.slow

CLONE = Path(__file__).parents[2]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Not compiled, which takes minutes: `make install` in a guest of the kernel rig is."""
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(folder)]
    run(["env", "ETD_INTERPRETED=1", *build], CLONE)
    return next(folder.glob("*.whl"))


def run(command: list[str], cwd: Path) -> str:
    """Standard output; what a failing command said becomes the failure's text."""
    ran = subprocess.run(command, cwd=cwd, capture_output=True, text=True, check=False, timeout=600)
    assert ran.returncode == 0, f"{command}: {ran.returncode}\n{ran.stdout}\n{ran.stderr}"
    return ran.stdout


def needed(name: str, extra: str) -> set[str]:
    """The distributions that `name` asks for with this extra, and those that they ask for."""
    asked = map(Requirement, distribution(name).requires or ())
    direct = {
        requirement
        for requirement in asked
        if requirement.marker is None or requirement.marker.evaluate({"extra": extra})
    }
    return {requirement.name for requirement in direct} | {
        name for requirement in direct for name in needed(requirement.name, extra="")
    }


def make_installed(wheel: Path, folder: Path, extra: str) -> Path:
    """A fresh environment with the wheel and only what it needs. Returns its folder of programs.

    The dependencies are linked from the running environment: no network, and the very versions
    that the other tests have seen.
    """
    venv.create(folder, with_pip=False, symlinks=True)
    programs = folder / "bin"
    pip = [sys.executable, "-m", "pip", "--python", str(programs / "python"), "install"]
    run([*pip, "--quiet", "--no-deps", "--no-index", str(wheel)], folder)
    packages = next(folder.glob("lib/python*/site-packages"))
    for name in needed("etd", extra):
        found = distribution(name)
        for top in {file.parts[0] for file in found.files or ()} - {"..", "__pycache__"}:
            (packages / top).symlink_to(Path(str(found.locate_file(top))).resolve())
    return programs


def test_the_wheel_runs_the_demo_away_from_the_clone(wheel: Path, tmp_path: Path) -> None:
    programs = make_installed(wheel, tmp_path / "daemon", extra="daemon")
    where = run([str(programs / "python"), "-c", "import etd; print(etd.__file__)"], tmp_path)
    assert Path(where.strip()).is_relative_to(tmp_path)
    run([str(programs / "etd"), "demo", "--seconds", "1"], tmp_path)


def test_the_wheel_asks_for_the_clients_python_and_its_two_packages(wheel: Path) -> None:
    with zipfile.ZipFile(wheel) as opened:
        name = next(name for name in opened.namelist() if name.endswith(".dist-info/METADATA"))
        asks = email.message_from_bytes(opened.read(name))
    bare = {
        requirement.name
        for requirement in map(Requirement, asks.get_all("Requires-Dist", []))
        if requirement.marker is None or requirement.marker.evaluate({"extra": ""})
    }
    assert (asks["Requires-Python"], bare) == (">=3.10", {"msgspec", "pyzmq"})


def test_the_bare_package_is_the_client_and_needs_nothing_else(wheel: Path, tmp_path: Path) -> None:
    programs = make_installed(wheel, tmp_path / "client", extra="")
    program = (
        "from etd import AsyncDisplay, Display; import sys;"
        "print(sorted({'gpiod', 'numpy', 'rich', 'smbus2', 'spidev'} & set(sys.modules)))"
    )
    assert run([str(programs / "python"), "-c", program], tmp_path).strip() == "[]"
    missing = (
        "from importlib.util import find_spec;"
        "print([m for m in ('gpiod', 'numpy', 'rich', 'smbus2', 'spidev') if find_spec(m)])"
    )
    assert run([str(programs / "python"), "-c", missing], tmp_path).strip() == "[]"


def test_a_verb_that_needs_more_says_the_line_that_installs_it(wheel: Path, tmp_path: Path) -> None:
    programs = make_installed(wheel, tmp_path / "client", extra="")
    for words in (
        ("demo", "--seconds", "1"),
        ("run", "--board", "fake"),
        ("calibrate", "P1", "--board", "fake", "--max-current-ua", "900"),
        ("explain", "thickness"),
    ):
        command = [str(programs / "etd"), *words]
        ran = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path, check=False)
        assert ran.returncode == 1
        assert ran.stderr.splitlines() == [
            "etd: the Python package numpy is not installed; this line installs it:"
            f" {programs / 'python'} -m pip install 'etd[daemon]'"
        ]


def test_boards_and_units_travel_in_the_wheel(wheel: Path, tmp_path: Path) -> None:
    programs = make_installed(wheel, tmp_path / "data", extra="")
    program = (
        "from etd.files import resources; print(resources.find('boards', 'kajimoto-hv507'));"
        "print(resources.config_dir().parent / 'systemd' / 'etd-engine@.service')"
    )
    for line in run([str(programs / "python"), "-c", program], tmp_path).splitlines():
        path = Path(line)
        assert path.is_relative_to(tmp_path)
        assert path.is_file()
