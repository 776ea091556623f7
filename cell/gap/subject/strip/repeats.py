"""Detects duplicate folds of the digital twin, made with equal seeds and settings."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path

from cell.gap.subject.run_folders import check_indices
from cell.record.header import Header


def duplicate_folds(
    folders: Sequence[Path], headers: Sequence[Header | None]
) -> Mapping[Path, Path]:
    """Map each folder with a duplicate fold of the twin to the first folder with that fold.

    The twin gives the same fold for the same seed: counted twice, it would narrow confidence
    intervals without new information. `cell fold --repeat` and `cell gap plan` number the folds of
    one specimen from 0, with seeds that grow as the index does; several such batches are several
    specimens. Raises ConfigurationError for two runs of one index in a batch. A header is None
    where the run is not used.
    """
    first: dict[str, Path] = {}
    same: dict[Path, Path] = {}
    batches: dict[str, list[tuple[Path, int | None]]] = {}
    for folder, header in zip(folders, headers, strict=True):
        if header is None:
            continue
        known = _fold_key(header)
        if known is not None and known in first:
            same[folder] = first[known]
            continue
        if known is not None:
            first[known] = folder
        batches.setdefault(_batch_key(header), []).append((folder, header.index))
    for batch in batches.values():
        check_indices([folder for folder, _ in batch], [index for _, index in batch])
    return same


def _on_twin(header: Header) -> bool:
    drivers = header.drivers
    return drivers is not None and drivers.arm == "twin" and header.seed is not None


def _fold_key(header: Header) -> str | None:
    """Text of all that determines a fold of the twin; None for a run from elsewhere."""
    if not _on_twin(header):
        return None
    keys = {"seed", "index", "plant_sha256", "condition", "strip_file", "config", "versions"}
    return json.dumps(header.model_dump(mode="json", include=keys), sort_keys=True)


def _batch_key(header: Header) -> str:
    """Command to which a fold of the twin belongs; one common value for runs from elsewhere."""
    if not _on_twin(header) or header.seed is None:
        return ""
    return f"{header.plant_sha256} {header.seed - (header.index or 0)}"
