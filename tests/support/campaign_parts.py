"""Parts of a campaign that do what tests need, in processes of their own."""

import os
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from cell.campaign.run import Part
from drivers.errors import ConfigurationError


def length_of_key(key: str, marks: Path | None, seconds: float) -> Mapping[str, Any]:
    """Measure the length of `key`; leaves a line in `marks` each time."""
    time.sleep(seconds)
    if marks is not None:
        with marks.open("a") as stream:
            stream.write(key + "\n")
    return {"kind": "effect", "policy": key, "effect": "", "displacement": (0.01 * len(key),)}


def refuse(*_: object) -> Mapping[str, Any]:
    """Measure what cannot be measured."""
    raise ConfigurationError("this strip cannot be folded")


def fail(*_: object) -> Mapping[str, Any]:
    """Measure with a defect."""
    return {"one": 1 / 0}


def die(*_: object) -> Mapping[str, Any]:
    """Take the whole process along."""
    os._exit(3)


def never_end(*_: object) -> Mapping[str, Any]:
    """Measure for ever."""
    time.sleep(1e6)
    return {}


def _part(
    function: Callable[..., Mapping[str, Any]],
    key: str,
    marks: Path | None = None,
    seconds: float = 0.0,
) -> Part:
    return Part(key, "first", 1.0, function, (key, marks, seconds))


Fine = partial(_part, length_of_key)
Impossible, Broken = partial(_part, refuse), partial(_part, fail)
Deadly, Endless = partial(_part, die), partial(_part, never_end)
