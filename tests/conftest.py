"""How a session of tests uses its processes, their memory and the folders of its
user.
"""

import ctypes
import gc
import os
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

# Bytecode is kept, also where the environment does without: each worker and each
# command that a test starts would compile the package and rewrite the asserts anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

LIBC = ctypes.CDLL(None)
Result = Generator[None, object, object]

# Tests share the machine's compiled kernels, and nothing else that its user has.
CACHE = (
    Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "folding-cell"
)
if CACHE.parent.name != "tests":  # else a worker, whose session has chosen
    os.environ.setdefault("NUMBA_CACHE_DIR", str(CACHE))
    os.environ.setdefault("CELL_KERNEL", str(CACHE / "kernel"))
    os.environ.setdefault("CELL_FRANKY_SIM", str(CACHE / "franky-sim"))
    os.environ["XDG_CACHE_HOME"] = str(CACHE / "tests")


@pytest.fixture(scope="session", autouse=True)
def learned(tmp_path_factory: pytest.TempPathFactory) -> None:
    """What cells learn in a session stays in it."""
    os.environ["XDG_DATA_HOME"] = str(tmp_path_factory.mktemp("data"))


def pytest_collection_finish(session: pytest.Session) -> None:
    """Exempt all that is imported from later collections of garbage, and forks from
    copying it.
    """
    gc.collect()
    gc.freeze()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(
    item: pytest.Function, nextitem: pytest.Function | None
) -> Result:
    """Free the memory of a module's tests after its last one: cached folds, cycles,
    freed pages.
    """
    done = yield
    if nextitem is None or nextitem.module is not item.module:
        for made in vars(item.module).values():
            if hasattr(made, "cache_clear") and made.__module__ == item.module.__name__:
                made.cache_clear()
        gc.collect()
        if hasattr(LIBC, "malloc_trim"):  # of glibc
            LIBC.malloc_trim(0)
    return done
