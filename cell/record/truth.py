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
    """Write what is known of the true motion of a simulated strip into the run folder
    `folder`.
    """
    write_document(folder / TRUTH, {"schema": SCHEMA, **truth})


def read_truth(folder: Path) -> dict[str, Any] | None:
    """What is known of the true motion of the simulated strip in the run in `folder`;
    None where nothing is recorded.
    """
    path = folder / TRUTH
    return read_yaml(path) if path.exists() else None
