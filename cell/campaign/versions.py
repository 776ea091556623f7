"""Versions on which a campaign's numbers depend, of libraries and of the code itself."""

import hashlib
from functools import cache
from importlib.metadata import version
from pathlib import Path

import cell

PACKAGES = ("folding-cell", "numpy", "numba", "mujoco", "opencv-python-headless")
ROOTS = ("cell", "drivers", "policies", "calibration")
SHOWS = ("cell/cli/", "cell/report/viz/", "cell/campaign/", "cell/studies/",
         "cell/exam/studies/")  # fmt: skip
WORKING_PARTS = ("cell/studies/kit/",)
"""Folders whose code changes no outcome, and those within that do. A study adds its own file."""


@cache
def code() -> str:
    """Digest of all sources that outcomes depend on."""
    return _digest("*.py")


@cache
def data() -> str:
    """Digest of all weights and tables that lie beside the sources."""
    return _digest("*.npz", "*.json", "*.yaml")


def versions() -> dict[str, str]:
    """Local versions of libraries that affect the numbers, and the digest of code and data."""
    here = {package: version(package) for package in PACKAGES}
    return {**here, "code": f"{code()}-{data()}"}


def _digest(*patterns: str) -> str:
    h, root = hashlib.sha256(), Path(cell.__file__).resolve().parents[1]
    for pattern in patterns:
        for path in sorted(p for package in ROOTS for p in (root / package).rglob(pattern)):
            name = path.relative_to(root).as_posix()
            if not name.startswith(SHOWS) or name.startswith(WORKING_PARTS):
                h.update(name.encode() + b"\0" + path.read_bytes())
    return h.hexdigest()[:12]
