"""How kernels are compiled, and where their machine code is kept."""

import hashlib
import os
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """`function` as a part of compiled code: no bounds checks, IEEE arithmetic, no GIL."""
    compiled: F = numba.njit(
        error_model="numpy", nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True
    )(function)
    return compiled


def entry(function: F) -> F:
    """`function` as compiled code that Python calls; kept between processes.

    The folder carries a digest of this package, because numba looks for changes only in the
    file of the entry itself.
    """
    before = numba.config.CACHE_DIR
    numba.config.CACHE_DIR = str(cache_folder(before))
    try:
        compiled: F = numba.njit(error_model="numpy", nogil=True, cache=True)(function)
    finally:
        numba.config.CACHE_DIR = before
    return compiled


def cache_folder(chosen: str) -> Path:
    """A writable folder: `chosen` (NUMBA_CACHE_DIR), the user's cache, or the temporary folder."""
    sources = sorted(Path(__file__).parent.glob("*.py"))
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]
    homes = [Path(chosen)] if chosen else [_user_cache() / "folding-cell"]
    for home in (*homes, Path(tempfile.gettempdir()) / "folding-cell"):
        folder = home / f"rod-{digest}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
        except OSError:
            continue
        if os.access(folder, os.W_OK):
            return folder
    return Path(tempfile.mkdtemp(prefix="folding-cell-"))


def _user_cache() -> Path:
    if sys.platform == "darwin":
        return Path.home() / "Library" / "Caches"
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache")
