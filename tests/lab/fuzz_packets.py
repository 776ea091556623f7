"""Sends random packets to every port of the emulated robot, which must keep serving.

`python -m tests.lab fuzz-packets [--packets N] [--seed S]` runs the tests of garbage
with as many packets as asked, a million unless said otherwise.
"""

import os
import sys

import pytest

from tests.drivers.twin.fci_server import test_fuzz as fuzz


def main(packets: int = 1_000_000, seed: int = 0) -> int:
    """Send `packets` random packets to the robot server's ports."""
    os.environ[fuzz.TIMES] = str(packets / fuzz.PACKETS)
    os.environ[fuzz.SEED] = str(seed)
    arguments = ["-q", "-n0", "-m", "", "--durations=0", "-p", "no:cacheprovider"]
    code = pytest.main([*arguments, fuzz.__file__])
    sys.stdout.write(f"about {packets} packets\n")
    return int(code)
