"""Journal of a campaign: a folder with a JSON file for each measured part, written
atomically.

A part that has a file is done, so that a campaign resumes wherever it stopped, and the
journals of several machines merge by copying their files together.
"""

import hashlib
import re
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from drivers.base.errors import ConfigurationError
from drivers.base.files import replace_file, writing
from drivers.base.readers import MEGABYTE, read_bytes

LARGEST_RECORD = 16 * MEGABYTE  # of one record
State = Literal["measured", "failed", "set_aside"]


class Cost(BaseModel):
    """Time [s] that one part of a campaign took: `wall`, and `processor` with that of
    its child processes.
    """

    model_config = ConfigDict(frozen=True)

    wall: float = 0.0
    processor: float = 0.0


class Record(BaseModel):
    """Result of one part of a campaign: its `outcome` where it was measured, else the
    `reason` why it was not.

    `key` names the part, `of` is the digest of its code and inputs. `failed` parts are
    tried again at the next start; `set_aside` ones killed their process or ran out of
    time, and stay. Unknown keys are ignored: another version may have written the file.
    """

    model_config = ConfigDict(frozen=True)

    schema_: Literal[1] = Field(1, alias="schema")
    key: str
    of: str
    state: State
    outcome: dict[str, Any] | None = None
    reason: str = ""
    cost: Cost = Cost()
    versions: dict[str, str] = Field(default_factory=dict)
    host: str = ""

    @property
    def done(self) -> bool:
        """Whether the part is finished and need not be measured again."""
        return self.state != "failed"


class Journal:
    """Journal of a campaign in `folder`: a JSON file for the result of each part."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def path(self, key: str, of: str) -> Path:
        """Path of the record of the part `key` with the digest `of` of its code and
        inputs, the same on every machine.
        """
        name = re.sub(r"[^\w.+-]+", "-", key)[:80]
        return self.folder / f"{name}.{digest(key, of)}.json"

    def get(self, key: str, of: str) -> Record | None:
        """Record of the part `key` with the digest `of`; None where no readable one
        exists.
        """
        record = _read(self.path(key, of))
        is_of_part = record is not None and (record.key, record.of) == (key, of)
        return record if is_of_part else None

    def put(self, record: Record) -> None:
        """Store `record`, which is on disk on return; raises ConfigurationError where
        it cannot be stored.
        """
        path = self.path(record.key, record.of)
        with writing(path, "make room and run the command again"):
            self.folder.mkdir(parents=True, exist_ok=True)
            replace_file(path, record.model_dump_json(by_alias=True, indent=1).encode())

    def records(self) -> tuple[Record, ...]:
        """All records of the campaign that can be read, in the order of their file
        names.
        """
        paths = sorted(self.folder.glob("[!.]*.json"))
        return tuple(filter(None, map(_read, paths)))

    def forget(self, keys: Iterable[tuple[str, str]]) -> None:
        """Remove the records of the parts with these pairs of key and digest."""
        for key, of in keys:
            self.path(key, of).unlink(missing_ok=True)


def _read(path: Path) -> Record | None:
    """Record in the file at `path`; None where there is none that can be read."""
    try:
        return Record.model_validate_json(read_bytes(path, LARGEST_RECORD))
    except (OSError, ValidationError, ConfigurationError):
        return None


def digest(*texts: str) -> str:
    """Digest of the strings `texts`, in order: twelve hexadecimal digits."""
    return hashlib.sha256("\0".join(texts).encode()).hexdigest()[:12]
