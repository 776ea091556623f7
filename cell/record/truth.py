"""Reading and writing of truth.yaml, the true motion of a simulated strip, for reports
alone.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from cell.record.documents import write_document
from cell.record.files import TRUTH
from drivers.base.readers import SCHEMA, read_yaml


def write_truth(folder: Path, truth: Mapping[str, Any]) -> None:
    """Write truth.yaml of a run on the twin: plant, true displacement and touch."""
    write_document(folder / TRUTH, {"schema": SCHEMA, **truth})


def read_truth(folder: Path) -> dict[str, Any] | None:
    """Content of truth.yaml of a run on the twin; None where the folder has no such
    file.
    """
    path = folder / TRUTH
    return read_yaml(path) if path.exists() else None
