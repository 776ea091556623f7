"""Parts of a benchmark that do what tests need, in processes of their own."""

import os
from dataclasses import dataclass
from pathlib import Path

from cell.benchmark.results import Laid, Result
from drivers.errors import ConfigurationError


@dataclass(frozen=True)
class Fine:
    """A part that measures its own length; leaves a mark for each time it is measured."""

    key: str
    marks: Path | None = None
    of: str = "first"
    cost: float = 1.0

    def measure(self) -> Result:
        if self.marks is not None:
            with self.marks.open("a") as stream:
                stream.write(self.key + "\n")
        return Laid(bending_length=0.01 * len(self.key), shape=((0.0, 0.0), (0.1, 0.01)))


@dataclass(frozen=True)
class Impossible(Fine):
    """A part that cannot be measured."""

    def measure(self) -> Result:
        raise ConfigurationError("this strip cannot be folded")


@dataclass(frozen=True)
class Deadly(Fine):
    """A part that takes its whole process with it."""

    def measure(self) -> Result:
        os._exit(3)
