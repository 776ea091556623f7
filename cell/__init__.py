"""Application of a cell that folds fabric strips: commands, Python API, records,
reports.

`import cell` offers the functions of `cell.interface.api`; they are imported when one
is used.
"""

# ruff: noqa: F403, F405
import importlib
from importlib.metadata import version
from typing import TYPE_CHECKING, Any

from drivers.base.errors import CellError

if TYPE_CHECKING:
    from cell.interface.api import *  # the names that __all__ lists

__all__ = (
    "CellError",
    "accept",
    "check",
    "compare",
    "effects",
    "export_runs",
    "fit_gap",
    "fold",
    "import_runs",
    "list_runs",
    "observe",
    "predict",
    "read_calibration",
    "read_run",
    "read_strip",
    "read_verdict",
    "runs",
    "table",
    "undo",
)


def __getattr__(name: str) -> Any:
    """Import a function of `cell.interface.api` on first use; AttributeError for any
    other name.
    """
    if name == "__version__":
        return version("folding-cell")
    if name not in __all__:
        raise AttributeError(f"module 'cell' has no attribute {name!r}")
    return getattr(importlib.import_module("cell.interface.api"), name)


def __dir__() -> list[str]:
    return sorted(__all__)
