"""Plant files: what really lies on the twin's desk, effects of the rig included."""

from pathlib import Path

from drivers.settings import load
from drivers.strip.effects import check_effects, registry
from drivers.strip.file import StripFile, check_described


def load_plant(path: Path) -> StripFile:
    """The plant file at `path`; unlike a strip it may hold effects of the rig too."""
    plant = load(path, StripFile)
    rig = {n: v for n, v in plant.effects.items() if n in registry() and registry()[n].of == "cell"}
    own = {n: v for n, v in plant.effects.items() if n not in rig}
    check_effects(own, origin=str(path), of="strip")
    check_effects(rig, origin=str(path), of="cell")
    check_described(plant, origin=str(path))
    return plant
