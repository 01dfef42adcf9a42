"""What a measurement was taken on, and with."""

import platform
import subprocess
from importlib import metadata
from pathlib import Path

import warp as wp

import warprt as rt
from warprt.launch import default_threads


def about(device: str) -> dict:
    """Device, versions and commit, as they go into a file of results."""
    versions = {name: _version(name) for name in ("warp-lang", "numpy", "trimesh", "open3d", "embreex", "mitsuba")}
    return {
        "device": wp.get_device(device).name if wp.get_device(device).is_cuda else cpu_name(),
        "cores": default_threads(),
        "python": platform.python_version(),
        "warprt": rt.__version__,
        "commit": _commit(),
        **{name: version for name, version in versions.items() if version},
    }


def cpu_name() -> str:
    """What the processor calls itself."""
    try:
        lines = Path("/proc/cpuinfo").read_text().splitlines()
    except OSError:
        return platform.processor() or platform.machine()
    return next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), platform.machine())


def _version(package: str) -> str | None:
    try:
        return metadata.version(package)
    except metadata.PackageNotFoundError:
        return None


def _commit() -> str | None:
    """The commit of the checkout that this file lies in, if it does."""
    try:
        found = subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"],
            cwd=Path(__file__).parent,
            capture_output=True,
            text=True,
            check=True,
        )
    except (OSError, subprocess.CalledProcessError):
        return None
    return found.stdout.strip()
