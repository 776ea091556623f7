"""A campaign on a Dask cluster goes on where scheduler and workers died."""

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from threading import Thread

import pytest

from cell.base.campaign import cluster
from cell.base.campaign.cluster import Cluster
from cell.base.campaign.journal import Journal
from cell.base.campaign.progress import Meter
from cell.base.campaign.run import carry_out
from tests.support.campaign_parts import Fine

pytestmark = pytest.mark.long

ROOT = Path(__file__).parents[4]


class Grid:
    """A scheduler and two workers of one thread on loopback, as a user starts them."""

    def __init__(self) -> None:
        pytest.importorskip("distributed", reason="pip install '.[cluster]'")
        with socket.socket() as free:
            free.bind(("127.0.0.1", 0))
            self.port = str(free.getsockname()[1])
        self.address = f"tcp://127.0.0.1:{self.port}"
        self.begin()

    def begin(self) -> None:
        """Start all; workers without a nanny, so that a kill is a death."""
        scheduler = ("scheduler", "--host", "127.0.0.1", "--port", self.port)
        worker = ("worker", self.address, "--nthreads", "1", "--no-nanny")
        self.processes = [
            subprocess.Popen(
                [
                    sys.executable,
                    "-m",
                    f"distributed.cli.dask_{name}",
                    *words,
                    "--no-dashboard",
                ],
                cwd=ROOT,
                stderr=subprocess.DEVNULL,
            )
            for name, *words in (scheduler, worker, worker)
        ]

    def end(self) -> None:
        """Kill all."""
        for process in self.processes:
            process.kill()
            process.wait()


@pytest.fixture
def grid(monkeypatch: pytest.MonkeyPatch) -> Iterator[Grid]:
    monkeypatch.setattr(cluster, "CONNECT_TIMEOUT", 400.0)
    made = Grid()
    yield made
    made.end()


def test_a_scheduler_started_again_goes_on(grid: Grid, tmp_path: Path) -> None:
    marks = tmp_path / "marks"
    parts = [Fine(f"part {n}", marks, seconds=0.5) for n in range(30)]

    def restart() -> None:
        while len(Journal(tmp_path / "j").records()) < 5:
            time.sleep(0.1)
        grid.end()
        grid.begin()

    Thread(target=restart, daemon=True).start()
    found = carry_out(parts, tmp_path / "j", Cluster(grid.address), Meter())
    assert {record.state for record in found} == {"measured"}
    measured = marks.read_text().split("\n")[:-1]
    assert len(measured) <= 30 + 2  # what two workers had
