"""Writes the strip file of an unknown fabric, with values estimated in a fold and their source."""

from pathlib import Path

from drivers.files import write_file
from drivers.strip.file import Provenance, StripFile
from drivers.yaml_text import dump_yaml
from policies.prediction import FoldPrediction

LEARNED = "learned.yaml"
NOTABLE_YIELD = 5.0  # 1/m of yield curvature, from which friction is worth a line


def learned_strip(strip: StripFile, predicted: FoldPrediction, run: str) -> StripFile:
    """Copy of `strip` with the estimates of a fold, each with its interval and source."""
    length, time = predicted.bending_length, predicted.retardation_time
    friction = predicted.yield_curvature
    source = f"fold {run}, as the policy judged it at the touch"
    notes = {
        "bending_length": length.text(1.0, 4) + " m",
        "retardation_time": time.text(1.0, 3) + " s",
    }
    effects = dict(strip.effects)
    if friction.value >= NOTABLE_YIELD:
        effects["bending_hysteresis"] = {"yield_curvature": round(friction.value, 1)}
        notes["effects.bending_hysteresis.yield_curvature"] = friction.text(1.0, 0) + " 1/m"
    kept = [entry for entry in strip.provenance if entry.key not in notes]
    new = [Provenance(key=key, source=source, note=f"68 %: {text}") for key, text in notes.items()]
    intervals = {"bending_length": (length.low, length.high)}
    intervals |= {"retardation_time": (time.low, time.high)}
    return strip.model_copy(
        update={
            "bending_length": round(length.value, 5),
            "retardation_time": round(time.value, 4),
            "effects": effects,
            "spread": strip.spread | intervals,
            "provenance": (*kept, *new),
        }
    )


def offer(folder: Path, strip: StripFile, predicted: FoldPrediction) -> Path:
    """Write a strip file with the estimates of the run in `folder` about `strip`; returns its path.

    Raises ConfigurationError where it cannot be written.
    """
    learned = learned_strip(strip, predicted, folder.name)
    content = learned.model_dump(mode="json", by_alias=True)
    path = folder / LEARNED
    write_file(path, dump_yaml(content))
    return path
