"""Which devices the command line asks for."""

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True, slots=True)
class Choice:
    """What the command line says of devices; None where silent.

    `index` counts the runs that the strip on the desk has been through before.
    """

    arm: str | None = None
    camera: str | None = None
    plant: Path | None = None
    seed: int = 0
    index: int = 0
