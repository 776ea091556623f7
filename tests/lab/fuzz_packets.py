"""Sends random packets to every port of the emulated robot, which must keep serving.

`python -m tests.lab fuzz-packets [--packets N] [--seed S]` sends what the server is
sent in CI, ten times as much. A server that no longer serves ends it with an
AssertionError.
"""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from unittest import mock

import numpy as np

from drivers.twin.fci_server.server import RobotServer
from tests.drivers.twin.fci_server import test_fuzz as fuzz

SHARE = fuzz.DATAGRAMS + fuzz.STREAMS * fuzz.IN_STREAM + fuzz.REQUESTS + fuzz.COMMANDS
SCALED = ("DATAGRAMS", "STREAMS", "REQUESTS", "COMMANDS")


@contextmanager
def serving() -> Iterator[RobotServer]:
    """Context with a robot server, checked at its end to answer still."""
    with RobotServer() as server:
        yield server
        fuzz.assert_serves(server)


def main(packets: int = 1_000_000, seed: int = 0) -> None:
    """Send `packets` random packets to the robot server's ports."""
    times, random = packets / SHARE, np.random.default_rng(seed)
    parts: dict[str, Callable[[RobotServer], None]] = {
        "datagrams": lambda s: (
            fuzz.test_datagrams_of_garbage_in_a_motion_change_nothing(s, random)
        ),
        "streams to the arm": lambda s: (
            fuzz.test_streams_of_garbage_end_and_hold_nobody_up(s, random, 1337)
        ),
        "streams to the hand": lambda s: (
            fuzz.test_streams_of_garbage_end_and_hold_nobody_up(s, random, 1338)
        ),
        "requests": lambda s: (
            fuzz.test_requests_of_garbage_from_a_connected_client_are_answered_or_end_it(
                s, random
            )
        ),
    }
    many = {name: max(fuzz.BATCH, int(times * getattr(fuzz, name))) for name in SCALED}
    with mock.patch.multiple(fuzz, **many):
        for name, part in parts.items():
            begun = time.perf_counter()
            with serving() as server:
                part(server)
            took = time.perf_counter() - begun
            print(f"{name}: the server serves still, {took:.0f} s", flush=True)
        for generator in range(1, 5):
            fuzz.test_commands_of_garbage_for_the_right_state_end_the_motion_and_no_more(
                generator, random
            )
    sent = many["DATAGRAMS"] + many["STREAMS"] * fuzz.IN_STREAM
    print(f"{sent + many['REQUESTS'] + many['COMMANDS']} packets")
