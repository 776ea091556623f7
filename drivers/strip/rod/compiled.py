"""Compilation of kernels by numba, and the cache of their machine code."""

import hashlib
import os
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, TypeVar

import numba

F = TypeVar("F", bound=Callable[..., Any])


def kernel(function: F) -> F:
    """Compile `function` for use in other kernels: no bounds checks, IEEE arithmetic, no GIL."""
    compiled: F = numba.njit(
        error_model="numpy", nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True
    )(function)
    return compiled


def entry(function: F) -> F:
    """Compile `function` for calls from Python; cached between processes where possible.

    The cache folder carries a digest of this package, because numba detects changes only in the
    file of the entry itself.
    """
    before = numba.config.CACHE_DIR
    folder = cache_folder(before)
    numba.config.CACHE_DIR = str(folder or before)
    try:
        compiled: F = numba.njit(error_model="numpy", nogil=True, cache=folder is not None)(
            function
        )
    finally:
        numba.config.CACHE_DIR = before
    return compiled


def cache_folder(chosen: str) -> Path | None:
    """A writable folder under `chosen` (NUMBA_CACHE_DIR) or the user's cache; None without one."""
    here = Path(__file__).parent
    sources = (*sorted(here.glob("*.py")), here.parent / "shape.py")  # which holds a constant
    digest = hashlib.sha256(b"".join(path.read_bytes() for path in sources)).hexdigest()[:16]
    home = Path(chosen) if chosen else _user_cache() / "folding-cell"
    folder = home / f"rod-{digest}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return None
    return folder if os.access(folder, os.W_OK) else None


def _user_cache() -> Path:
    if sys.platform == "darwin":
        return Path(os.path.expanduser("~/Library/Caches"))  # noqa: PTH111  Path.home() may raise
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))  # noqa: PTH111
