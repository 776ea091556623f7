"""Documents of a fold's record: what it was made with, and what came of it."""

import hashlib
import json
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from calibration.calibration import Calibration
from cell.calibrating.calibration_in_use import record_entry
from cell.config.cell import CellFile
from cell.folding.request import Request
from cell.orchestrator.outcome import Outcome
from drivers.readers import MEGABYTE, read_bytes
from drivers.strip.file import StripFile

CHECKPOINT_BYTES = 50 * MEGABYTE
PACKAGES = ("folding-cell", "mujoco", "opencv-python-headless", "numpy", "ruckig")


def run_header(
    request: Request, settings: CellFile, calibration: Calibration, camera_rate: float
) -> dict[str, Any]:
    """Content of run.yaml: all that readers need, versions, and a hash of the plant.

    `settings` are those that the run uses, `camera_rate` is that of the open camera [Hz].
    """
    choice, strip = request.choice, request.strip
    return {
        "strip": strip.name,
        "sigma": settings.sigma.model_dump(),
        "start": settings.fold.start,
        "index": choice.index,
        "condition": f"{request.policy} at {settings.fold.speed:g} m/s",
        "speed": settings.fold.speed,
        "camera_hz": camera_rate,
        "contact_height": settings.perception.contact_height,
        "policy": request.policy,
        **_replaced_weights(request.checkpoint),
        "seed": choice.seed,
        "drivers": {
            "arm": choice.arm or settings.drivers.arm,
            "camera": choice.camera or settings.drivers.camera,
        },
        "calibration": record_entry(calibration, datetime.now(UTC)),
        "versions": {package: version(package) for package in PACKAGES},
        "strip_file": strip.model_dump(mode="json", by_alias=True),
        "config": settings.model_dump(mode="json", by_alias=True),
        "plant_sha256": _hash(choice.plant or strip),
    }


def result_content(outcome: Outcome) -> dict[str, Any]:
    """Content of result.yaml for an outcome."""
    content: dict[str, Any] = {"outcome": outcome.name, "reason": outcome.reason}
    content["duration"] = outcome.duration
    if outcome.touch is not None:
        content |= outcome.touch.facts()
    if outcome.edge_offset is not None:
        content["edge_offset"] = outcome.edge_offset
    if outcome.predicted is not None:
        content["foretold"] = asdict(outcome.predicted)
    if outcome.agreement is not None:
        agreed = outcome.agreement
        facts = {"like_model": agreed.like_model, "reason": agreed.sentence()}
        content["agreement"] = asdict(agreed) | facts
    return content


def _hash(plant: StripFile) -> str:
    content = plant.model_dump(mode="json", by_alias=True)
    return hashlib.sha256(json.dumps(content, sort_keys=True).encode()).hexdigest()


def _replaced_weights(checkpoint: Path | None) -> dict[str, Any]:
    """Entry of run.yaml about a checkpoint in place of the committed weights; empty for None."""
    if checkpoint is None:
        return {}
    digest = hashlib.sha256(read_bytes(checkpoint, CHECKPOINT_BYTES)).hexdigest()
    return {"checkpoint": {"file": str(checkpoint), "sha256": digest}}
