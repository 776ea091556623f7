"""Checkpoints of learned policies: weights and their origin, as plain numbers in JSON."""

import json
from pathlib import Path as FilePath
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field

from drivers.errors import ConfigurationError
from drivers.files import write_file
from drivers.readers import MEGABYTE, read_bytes
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
        content: Any = json.loads(read_bytes(path, MEGABYTE))
    except ConfigurationError as error:
        raise ConfigurationError(f"{error}; name another checkpoint or train one") from None
    except (ValueError, RecursionError):
        raise ConfigurationError(
            f"{path}: checkpoint is corrupt: not JSON; restore the file or train one"
        ) from None
    if not isinstance(content, dict):
        raise ConfigurationError(
            f"{path}: checkpoint is corrupt: not a mapping; restore the file or train one"
        )
    return parse(content, Checkpoint, str(path))


def save_checkpoint(path: FilePath, checkpoint: Checkpoint) -> None:
    """Write `checkpoint` to `path` atomically; ConfigurationError where that fails."""
    content = checkpoint.model_dump(by_alias=True)
    write_file(path, (json.dumps(content, indent=1) + "\n"), "make room or name another folder")
