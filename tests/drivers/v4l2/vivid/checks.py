"""Checks of the camera driver on the kernel's vivid driver, run where it is loaded.

`python -m tests.drivers.v4l2.vivid.checks` prints a line of JSON for each, which a
test reads outside of the emulated machine. No latency is judged but the one of
an unplug.
"""

import json
import sys
import time
import traceback
from collections.abc import Callable
from types import ModuleType

import pytest

from tests.drivers.v4l2.vivid import faults, pictures, stream
from tests.drivers.v4l2.vivid.device import Vivid


def checks_of(module: ModuleType) -> dict[str, Callable[[Vivid], None]]:
    """The checks that a module defines, by name."""
    return {
        name.removeprefix("check_"): value
        for name, value in vars(module).items()
        if name.startswith("check_")
    }


CHECKS = checks_of(pictures) | checks_of(stream) | checks_of(faults)


def main(wanted: list[str]) -> None:
    """Run the checks, each told in a line; a check that fails says why and where."""
    vivid = Vivid()
    for name in wanted or CHECKS:
        begun = time.monotonic()
        try:
            CHECKS[name](vivid)
            problem = None
        except (Exception, pytest.fail.Exception):  # noqa: BLE001 - others are to run
            problem = traceback.format_exc()
        seconds = round(time.monotonic() - begun, 2)
        print(
            json.dumps({"check": name, "problem": problem, "seconds": seconds}),
            flush=True,
        )


if __name__ == "__main__":
    main(sys.argv[1:])
