"""The wheel holds what it should, and a bare checkout works too."""

import os
import shutil
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
SCENE = "import warprt as rt, warprt.kernels.spec; print(rt.load_scene('ziggurat').instance_count)"


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """A wheel built from a copy of the tree, so that the tree stays clean."""
    folder = tmp_path_factory.mktemp("tree")
    for name in ("warprt", "kernels", "scenes", "benchmarks", "pyproject.toml", "README.md", "LICENSE"):
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        copy(ROOT / name, folder / name)
    command = [sys.executable, "-m", "pip", "wheel", "--no-deps", "--quiet", "--wheel-dir", "dist", "."]
    subprocess.run(command, cwd=folder, check=True)
    return next((folder / "dist").glob("*.whl"))


def test_wheel_holds_the_packages_and_nothing_else(wheel):
    inside = {"warprt": "warprt", "warprt/viewer": "warprt/viewer"}
    inside |= {f"warprt/{name}": name for name in ("kernels", "scenes", "benchmarks")}
    expected = {
        f"{package}/{path.name}"
        for package, folder in inside.items()
        for path in (ROOT / folder).iterdir()
        if path.suffix in (".py", ".cfg", ".lark", ".typed", ".html", ".css", ".js")
    }
    with zipfile.ZipFile(wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        licenses = [name for name in archive.namelist() if name.endswith("LICENSE")]
    assert names == expected | {"warprt/py.typed"}
    assert licenses


def run(folder, path):
    environment = {**os.environ, "PYTHONPATH": str(path)}
    done = subprocess.run([sys.executable, "-c", SCENE], cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout.strip()


def test_installed_wheel_works(wheel, tmp_path):
    with zipfile.ZipFile(wheel) as archive:
        archive.extractall(tmp_path / "site")
    assert run(tmp_path, tmp_path / "site") == "15"


def test_bare_checkout_works(tmp_path):
    assert run(tmp_path, ROOT) == "15"
