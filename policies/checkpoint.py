"""Checkpoints of learned policies: weights and their origin, as plain numbers in JSON."""

import json
from pathlib import Path as FilePath
from typing import Annotated, Literal

from pydantic import ConfigDict, Field

from drivers.errors import ConfigurationError
from drivers.files import write_file
from drivers.readers import MEGABYTE, read_json
from drivers.settings import Settings, parse
from policies.network import WEIGHT_COUNT


class Training(Settings):
    """Origin of the weights: settings and results of their training."""

    model_config = ConfigDict(extra="ignore")

    seed: int
    generations: int = Field(ge=0)
    folds: int = Field(ge=0)


class Checkpoint(Settings):
    """Weights of the feedback network; see `policies.network.HeadingNetwork` for their order."""

    model_config = ConfigDict(extra="ignore")

    schema_: Literal[1] = Field(1, alias="schema")
    policy: Literal["feedback"]
    weights: Annotated[tuple[float, ...], Field(min_length=WEIGHT_COUNT, max_length=WEIGHT_COUNT)]
    training: Training


def load_checkpoint(path: FilePath) -> Checkpoint:
    """The checkpoint at `path`; one line of ConfigurationError when it is missing or broken."""
    try:
        return parse(read_json(path, MEGABYTE), Checkpoint, str(path))
    except ConfigurationError as error:
        raise ConfigurationError(f"{error}; name another checkpoint or train one") from None


def save_checkpoint(path: FilePath, checkpoint: Checkpoint) -> None:
    """Write `checkpoint` to `path` atomically; ConfigurationError where that fails."""
    content = checkpoint.model_dump(by_alias=True)
    write_file(path, (json.dumps(content, indent=1) + "\n"), "make room or name another folder")
