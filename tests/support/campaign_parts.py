"""Parts of a campaign that do what tests need, in processes of their own."""

import os
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from drivers.errors import ConfigurationError


@dataclass(frozen=True)
class Fine:
    """A part that measures the length of its key; leaves a mark each time it is measured."""

    key: str
    marks: Path | None = None
    of: str = "first"
    cost: float = 1.0
    seconds: float = 0.0

    def measure(self) -> Mapping[str, Any]:
        time.sleep(self.seconds)
        if self.marks is not None:
            with self.marks.open("a") as stream:
                stream.write(self.key + "\n")
        return {
            "kind": "effect",
            "policy": self.key,
            "effect": "",
            "displacement": (0.01 * len(self.key),),
        }


@dataclass(frozen=True)
class Impossible(Fine):
    """A part that cannot be measured."""

    def measure(self) -> Mapping[str, Any]:
        super().measure()
        raise ConfigurationError("this strip cannot be folded")


@dataclass(frozen=True)
class Broken(Fine):
    """A part with a defect."""

    def measure(self) -> Mapping[str, Any]:
        return {"one": 1 / 0}


@dataclass(frozen=True)
class Deadly(Fine):
    """A part that takes its whole process with it."""

    def measure(self) -> Mapping[str, Any]:
        super().measure()
        os._exit(3)


@dataclass(frozen=True)
class Endless(Fine):
    """A part that never ends."""

    def measure(self) -> Mapping[str, Any]:
        time.sleep(1e6)
        return {}


class Noted:
    """A watcher that notes what it is shown."""

    def __init__(self) -> None:
        self.known: list[str] = []
        self.finished_parts: list[str] = []

    def begin(self, parts, known) -> None:
        self.known = [part.key for part in known]

    def finish(self, part, record) -> None:
        self.finished_parts.append(part.key)
