"""Runs foreign clients of the robot's interface, and `cell twin serve`, each in a
process of its own.
"""

import json
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

import pytest

CLIENTS = Path(__file__).parents[1] / "drivers" / "twin" / "fci_server" / "clients"
PACKAGES = {
    "pylibfranka": "pylibfranka",
    "franky": "franky-control",
    "franka": "franka-rs",
}
PATIENCE = 60  # s, for a client on a busy machine


def told_by(
    script: str, module: str, address: str, *arguments: str
) -> dict[str, object]:
    """JSON that a client script prints at its end, run in a process of its own."""
    if find_spec(module) is None:
        pytest.skip(f"{PACKAGES[module]} is not installed: no wheel for this platform")
    command = [sys.executable, str(CLIENTS / script), address, *arguments]
    done = subprocess.run(
        command, capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert done.returncode == 0, done.stderr
    answer: dict[str, object] = json.loads(done.stdout.splitlines()[-1])
    return answer


@contextmanager
def served(*words: str | Path) -> Iterator[tuple[dict[str, object], subprocess.Popen]]:
    """What `cell twin serve` tells with these `words`, and its process."""
    serve = ("-m", "cell", "twin", "serve", "--json")
    command = [sys.executable, *serve, *words]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        try:
            yield json.loads(process.stdout.readline()), process
        finally:
            process.terminate()
