"""Versions of libraries and digests of code and data, on which the numbers of a
campaign depend.
"""

import hashlib
from collections.abc import Sequence
from functools import cache
from importlib.metadata import version
from pathlib import Path

PACKAGES = ("folding-cell", "numpy", "numba", "mujoco", "opencv-python-headless")
ROOTS = ("cell", "drivers", "policies", "calibration")
NO_OUTCOME = (
    "cell/interface/cli/",
    "cell/report/viz/",
    "cell/base/campaign/",
    "cell/studies/",
)
"""Folders whose code changes no outcome of a part."""

ROOT = Path(__file__).resolve().parents[3]


@cache
def code() -> str:
    """Digest, 12 digits, of all source files on which the outcomes of a campaign
    depend.
    """
    return sources(ROOTS, ("*.py",), NO_OUTCOME)[:12]


@cache
def data() -> str:
    """Digest, 16 digits, of all weights and tables that lie beside the sources."""
    return sources(ROOTS, ("*.npz", "*.json", "*.yaml"), NO_OUTCOME)[:12]


def verdicts() -> str:
    """Digest, 16 digits, of the source files on which the verdicts of `cell gap`
    depend.
    """
    return sources(("cell/gap", "cell/record", "drivers/strip"))


def versions() -> dict[str, str]:
    """Versions of the installed libraries that affect the numbers, by name, and the
    digest of code and data under `code`.
    """
    here = {package: version(package) for package in PACKAGES}
    return {**here, "code": f"{code()}-{data()}"}


def sources(
    paths: Sequence[str],
    patterns: Sequence[str] = ("*.py", "*.yaml"),
    without: tuple[str, ...] = (),
) -> str:
    """Digest, 16 digits, of the files at and below `paths` that match `patterns`,
    except those named by `without`.
    """
    digest = hashlib.sha256()
    for pattern in patterns:
        files: list[Path] = []
        for folder_or_file in paths:
            files += _files(ROOT / folder_or_file, pattern)
        for path in sorted(files):
            name = path.relative_to(ROOT).as_posix()
            if not name.startswith(without):
                digest.update(name.encode() + b"\0" + path.read_bytes())
    return digest.hexdigest()[:16]


def _files(path: Path, pattern: str) -> list[Path]:
    return [path] if path.is_file() else list(path.rglob(pattern))
