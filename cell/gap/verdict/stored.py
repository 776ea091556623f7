"""Files that a fit and an acceptance leave for the next command, validated on reading."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ConfigDict, Field

from drivers.readers import MEGABYTE, read_json
from drivers.settings import Settings, parse

STORED = 4 * MEGABYTE


class Stored(Settings):
    """Base of stored files: unknown keys are ignored, for a program wrote them."""

    model_config = ConfigDict(extra="ignore")


class StoredSpread(Stored):
    """A quantity that differs from run to run, with its standard deviation and 95 % interval."""

    name: str
    unit: str
    value: float
    low: float
    high: float


class StoredLaw(Stored):
    """The law that was offered: amounts by term."""

    terms: dict[str, float]


class FitRecord(Stored):
    """Content of fit.json: hash of the file that was fitted, and the effects that were named.

    `values` of the base are outside what the file tolerates; `scatter` are quantities that differ
    from run to run; `steadier` [sigma] is how much better the runs would separate two explanations,
    had one of these differed by half as much; `law` describes what nothing explains.
    """

    file_sha256: str
    effects: tuple[str, ...]
    values: tuple[str, ...] = ()
    scatter: tuple[StoredSpread, ...] = ()
    steadier: Mapping[str, float] = Field(default_factory=dict)
    law: StoredLaw | None = None

    @property
    def laws(self) -> tuple[str, ...]:
        """Names of the terms of the law that was offered."""
        return tuple(self.law.terms) if self.law is not None else ()


class Acceptance(Stored):
    """Content of accepted.json: by path, the text before an acceptance and the hash after it."""

    before: dict[str, str]
    after: dict[str, str]


class Patch(Stored):
    """Content of a patch of any subject: effects and their parameters.

    That of an arm may hold settings of the cell: its tool, and the delay of its twin.
    """

    effects: dict[str, dict[str, float]]
    fci: dict[str, dict[str, Any]] = Field(default_factory=dict)
    twin: dict[str, dict[str, Any]] = Field(default_factory=dict)


S = TypeVar("S", bound=BaseModel)


def read_stored(path: Path, model: type[S]) -> S:
    """The JSON file at `path` as `model`; ConfigurationError where it is missing or broken."""
    return parse(read_json(path, STORED), model, str(path))
