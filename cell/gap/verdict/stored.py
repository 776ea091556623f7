"""What a fit and an acceptance leave for the next command, checked when it is read again."""

from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ConfigDict, Field

from drivers.files import MEGABYTE
from drivers.settings import Settings, parse, read_json

STORED = 4 * MEGABYTE


class Stored(Settings):
    """Base: keys that are not known are tolerated, for a program wrote them."""

    model_config = ConfigDict(extra="ignore")


class FitRecord(Stored):
    """fit.json: hash of the file that was fitted, and the effects that were named."""

    file_sha256: str
    effects: tuple[str, ...]


class Acceptance(Stored):
    """accepted.json: path -> text before, and path -> hash after."""

    before: dict[str, str]
    after: dict[str, str]


class CellPatch(Stored):
    """cell-patch.yaml: effects that belong into the cell file."""

    effects: dict[str, dict[str, float]]


class CellEffects(Stored):
    """Of a cell file what an acceptance changes; the command reads all of it before."""

    effects: dict[str, dict[str, float]] = Field(default_factory=dict)


S = TypeVar("S", bound=BaseModel)


def read_stored(path: Path, model: type[S]) -> S:
    """The JSON file at `path` as `model`; ConfigurationError where it is missing or broken."""
    return parse(read_json(path, STORED), model, str(path))
