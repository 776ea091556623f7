"""How a session of tests uses its processes."""

import gc
import os
import sys

import pytest

# Bytecode is kept, also where the environment does without: each worker and each command that a
# test starts would compile the package and rewrite the asserts anew.
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)


def pytest_collection_finish(session: pytest.Session) -> None:
    """Exempt all that is imported from later collections of garbage, and forks from copying it."""
    gc.collect()
    gc.freeze()
