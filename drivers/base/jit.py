"""Compilation of kernels by numba, and the cache of their machine code.

A file of the cache holds one kernel for one set of argument types and is named by what
it was compiled from. So each checkout of the same sources finds the same code, changed
sources find none, and processes that fill the cache at once do no harm (numba's own
index may break: numba#4807).
"""

import ast
import hashlib
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from functools import cache
from pathlib import Path
from pickle import UnpicklingError
from typing import Any, TypeVar

import llvmlite
import numba
from numba.core.caching import IndexDataCacheFile, NullCache
from numba.core.ccallback import CFunc
from numba.core.compiler import CompileResult
from numba.core.sigutils import normalize_signature

F = TypeVar("F", bound=Callable[..., Any])

ERRORS = "numpy"  # error model: IEEE arithmetic, a division by zero raises nothing


def kernel(function: F) -> F:
    """Compile `function` for use in other kernels: no bounds checks, IEEE arithmetic,
    no GIL.
    """
    compiled: F = numba.njit(
        error_model=ERRORS, nogil=True, no_cpython_wrapper=True, no_cfunc_wrapper=True
    )(_with_unique_name(function))
    return compiled


def entry(function: F) -> F:
    """Compile `function` for calls from Python; its machine code is kept for other
    processes.
    """
    compiled = numba.njit(error_model=ERRORS, nogil=True)(_with_unique_name(function))
    compiled._cache = _Cache(function)
    found: F = compiled
    return found


def callback(signature: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorator that compiles a function with `signature` for calls from C, and keeps
    its code.
    """

    def compile_for_c(function: Callable[..., Any]) -> Any:
        form = normalize_signature(signature)
        compiled: Any = CFunc(
            _with_unique_name(function),
            form,
            locals={},
            options={"error_model": ERRORS},
        )
        compiled._cache = _Cache(function)
        compiled.compile()
        return compiled

    return compile_for_c


def cache_folder() -> Path:
    """Folder of machine code of this Python and numba: in NUMBA_CACHE_DIR or the user's
    cache.
    """
    versions = f"{sys.version} {numba.__version__} {llvmlite.__version__}"
    chosen = numba.config.CACHE_DIR
    home = Path(chosen) if chosen else _user_cache() / "folding-cell"
    return home / f"kernels-{_digest(versions)}"


def _user_cache() -> Path:
    if sys.platform == "darwin":
        return Path(os.path.expanduser("~/Library/Caches"))  # noqa: PTH111  Path.home() may raise
    return Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))  # noqa: PTH111


class _Cache(NullCache):  # type: ignore[misc]
    """Cache of one kernel: a file for each set of argument types and kind of processor.

    Numba reads and writes the files, which appear complete or not at all.
    """

    def __init__(self, function: Callable[..., Any]) -> None:
        self._name = function.__name__
        self._origin = _origin(function)
        self._files = IndexDataCacheFile(str(cache_folder()), function.__name__, "")

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """Compiled code for argument types `sig`, None where none is kept."""
        target_context.refresh()
        try:
            kept = self._files._load_data(
                self._file_name(sig, target_context.codegen())
            )
        # a power cut left a part of a file
        except (OSError, EOFError, UnpicklingError):
            return None
        return CompileResult._rebuild(target_context, *kept)

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep compiled `data` on disk, if possible; otherwise the next process
        compiles anew.
        """
        if not data.library.has_dynamic_globals:
            with suppress(OSError):
                cache_folder().mkdir(parents=True, exist_ok=True)
                self._files._save_data(
                    self._file_name(sig, data.codegen), data._reduce()
                )

    def _file_name(self, sig: Any, codegen: Any) -> str:
        digest = _digest(self._origin, f"{sig} {codegen.magic_tuple()}")
        return f"{self._name}-{digest}.nbc"


def _with_unique_name(function: F) -> F:
    """`function` with a hash of its closure in its name: numba caches by name and types
    alone.
    """
    if function.__closure__:
        function.__qualname__ += f"_{_digest(_origin(function))}"
    return function


def _origin(function: Callable[..., Any]) -> str:
    """Text that is another once the compiled `function` would be: key of its cache.

    It holds the function's name, the values that it closes over, and the sources that
    it imports.
    """
    closed = [cell.cell_contents for cell in function.__closure__ or ()]
    values = [_origin(v.py_func) if hasattr(v, "py_func") else repr(v) for v in closed]
    file = Path(function.__code__.co_filename)
    root = file.parents[function.__module__.count(".")]  # holds its top package
    contents = [_content(path) for path in sorted(_reached(file, root))]
    return "\n".join([function.__module__, function.__qualname__, *values, *contents])


def _reached(file: Path, root: Path) -> set[Path]:
    """`file` and all files under `root` that it imports, directly or through others."""
    reached = set[Path]()
    waiting = [file]
    while waiting:
        path = waiting.pop()
        if path not in reached:
            reached.add(path)
            waiting += _imported(path, root)
    return reached


@cache
def _imported(file: Path, root: Path) -> tuple[Path, ...]:
    """Files under `root` that `file` imports from by `from module import ...`."""
    files = list[Path]()
    for node in ast.walk(ast.parse(_content(file))):
        if isinstance(node, ast.ImportFrom) and node.module:
            module = root.joinpath(*node.module.split("."))
            files.append(module.with_suffix(".py"))
            files += [module / f"{name.name}.py" for name in node.names]
    return tuple(path for path in files if path.is_file())


@cache
def _content(file: Path) -> str:
    return file.read_text(encoding="utf-8")


def _digest(*parts: str) -> str:
    return hashlib.sha256("\n".join(parts).encode()).hexdigest()[:32]
