"""Measurements of campaign parts for tests: successful, failing, hanging or fatal."""

import os
import time
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

from cell.base.campaign.run import Part
from drivers.base.errors import ConfigurationError


def length_of_key(key: str, marks: Path | None, seconds: float) -> Mapping[str, Any]:
    """Length of `key` as a measurement; appends a line to the file `marks` each
    time.
    """
    time.sleep(seconds)
    if marks is not None:
        with marks.open("a") as stream:
            stream.write(key + "\n")
    return {
        "kind": "effect",
        "policy": key,
        "effect": "",
        "displacement": (0.01 * len(key),),
    }


def refuse(*_: object) -> Mapping[str, Any]:
    """Measurement that raises a ConfigurationError."""
    raise ConfigurationError("this strip cannot be folded")


def fail(*_: object) -> Mapping[str, Any]:
    """Measurement with a defect of the program."""
    return {"one": 1 / 0}


def die(*_: object) -> Mapping[str, Any]:
    """Measurement that kills its process."""
    os._exit(3)


def never_end(*_: object) -> Mapping[str, Any]:
    """Measurement that never ends."""
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
