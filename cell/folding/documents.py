"""Header, result and learned strip file of a fold's record."""

import hashlib
import json
from dataclasses import asdict
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

from calibration.calibration import Calibration
from cell.base.config.cell import CellFile
from cell.folding.request import Request
from cell.orchestrator.outcome import Outcome
from cell.perception.length_checks import doubts
from cell.setup.calibration_in_use import record_entry
from drivers.base.files import write_file
from drivers.base.readers import MEGABYTE, read_bytes
from drivers.base.yaml_text import dump_yaml
from drivers.strip.file import Provenance, StripFile
from drivers.strip.model import CONTACT_HEIGHT
from policies.policy import FoldPrediction

CHECKPOINT_BYTES = 50 * MEGABYTE
LEARNED = "learned.yaml"
NOTABLE_YIELD = 5.0  # 1/m of yield curvature, from which friction is worth a line
PACKAGES = ("folding-cell", "mujoco", "opencv-python-headless", "numpy", "ruckig")


def run_header(
    request: Request, settings: CellFile, calibration: Calibration, camera_rate: float
) -> dict[str, Any]:
    """Content of the header file of a fold's run: settings of the cell, strip, versions
    of programs, and a digest of the simulated strip.

    `settings` are those that the run uses, `camera_rate` is that of the open camera
    [Hz].
    """
    trial = request.trial
    strip = request.strip
    return {
        "strip": strip.name,
        "sigma": settings.sigma.model_dump(),
        "start": settings.fold.start,
        "index": trial.index,
        "condition": request.condition,
        **({} if request.line.is_half else {"line": request.line.at}),
        "speed": settings.fold.speed,
        "camera_hz": camera_rate,
        "contact_height": CONTACT_HEIGHT,
        "policy": request.policy,
        **_replaced_weights(request.checkpoint),
        "seed": trial.seed,
        "drivers": settings.drivers.model_dump(),
        "calibration": record_entry(calibration, datetime.now(UTC)),
        "versions": {package: version(package) for package in PACKAGES},
        "strip_file": _content(strip),
        "config": _content(settings),
        "plant_sha256": _hash(trial.plant or strip),
    }


def result_content(outcome: Outcome) -> dict[str, Any]:
    """Content of the result file of a run whose fold ended with the given `outcome`."""
    content: dict[str, Any] = {
        "outcome": outcome.name,
        "reason": outcome.reason,
        "duration": outcome.duration,
    }
    if outcome.touch is not None:
        content |= outcome.touch.facts()
    if outcome.edge_offset is not None:
        content["edge_offset"] = outcome.edge_offset
    if outcome.predicted is not None:
        content["foretold"] = asdict(outcome.predicted)
    reasons = doubts(outcome.witnesses)
    content["witnesses"] = [
        check.facts() | {"reason": reasons.get(check.name, "")}
        for check in outcome.witnesses
    ]
    agreement = outcome.agreement
    if agreement is not None:
        facts = {"like_model": agreement.like_model, "reason": agreement.sentence()}
        content["agreement"] = asdict(agreement) | facts
    return content


def _hash(plant: StripFile) -> str:
    """Hexadecimal SHA-256 digest of the content of the strip file `plant`, which
    describes the simulated strip.
    """
    text = json.dumps(_content(plant), sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _content(file: StripFile | CellFile) -> dict[str, Any]:
    """Content of the settings `file` of a strip or a cell, as it is written to YAML."""
    return file.model_dump(mode="json", by_alias=True)


def _replaced_weights(checkpoint: Path | None) -> dict[str, Any]:
    """Entry in the header of a run on a `checkpoint` that replaces the policy's own
    weights: its file and digest; empty for None.
    """
    if checkpoint is None:
        return {}
    digest = hashlib.sha256(read_bytes(checkpoint, CHECKPOINT_BYTES)).hexdigest()
    return {"checkpoint": {"file": str(checkpoint), "sha256": digest}}


def _learned_strip(strip: StripFile, predicted: FoldPrediction, run: str) -> StripFile:
    """Copy of the `strip` file with the parameters that were estimated during the fold,
    each noted with its interval and the name of the `run`.
    """
    length = predicted.bending_length
    time = predicted.retardation_time
    friction = predicted.yield_curvature
    notes = {
        "bending_length": f"{length.low:.4f} to {length.high:.4f} m",
        "retardation_time": f"{time.low:.3f} to {time.high:.3f} s",
    }
    effects = dict(strip.effects)
    if friction.value >= NOTABLE_YIELD:
        effects["bending_hysteresis"] = {"yield_curvature": round(friction.value, 1)}
        key = "effects.bending_hysteresis.yield_curvature"
        notes[key] = f"{friction.low:.0f} to {friction.high:.0f} 1/m"
    intervals = {
        "bending_length": (length.low, length.high),
        "retardation_time": (time.low, time.high),
    }
    source = f"fold {run}, as the policy judged it at the touch"
    learned = (
        Provenance(key=key, source=source, note=f"of its rods, 68 %: {interval}")
        for key, interval in notes.items()
    )
    kept = (entry for entry in strip.provenance if entry.key not in notes)
    return strip.model_copy(
        update={
            "bending_length": round(length.value, 5),
            "retardation_time": round(time.value, 4),
            "effects": effects,
            "spread": strip.spread | intervals,
            "provenance": (*kept, *learned),
        }
    )


def offer_strip(folder: Path, strip: StripFile, predicted: FoldPrediction) -> Path:
    """Write a strip file with the parameters that were estimated during a fold into the
    folder of its run, and return the path of that file.

    Raises ConfigurationError where it cannot be written.
    """
    learned = _learned_strip(strip, predicted, folder.name)
    path = folder / LEARNED
    write_file(path, dump_yaml(_content(learned)))
    return path
