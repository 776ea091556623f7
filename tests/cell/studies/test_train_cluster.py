"""Training on a Dask cluster: the same numbers, whoever folds and whoever dies."""

import gc
import os
import shutil
import signal
import subprocess
from collections.abc import Iterator
from pathlib import Path
from threading import Event, Thread
from typing import Any

import numpy as np
import pytest

from cell.base.campaign.cluster import Cluster, event_loop
from cell.base.campaign.processes import workers
from drivers.base.types import Array, Calls
from policies.train.objective import TrainingSettings
from policies.train.search import FeedbackTraining
from tests.support.refusals import refusal

pytestmark = pytest.mark.slow
TINY = TrainingSettings(generations=3, population=14, strips=1, segments=20, substeps=1)


ON_LOOPBACK = {"threads_per_worker": 1, "dashboard_address": "127.0.0.1:0"}


@pytest.fixture(scope="module")
def local() -> Iterator[Any]:
    """Two worker processes on loopback, each started again when it dies."""
    distributed = library()
    with (
        event_loop() as loop,
        distributed.LocalCluster(n_workers=2, loop=loop, **ON_LOOPBACK) as started,
    ):
        yield started


def library() -> Any:
    """Dask, which takes 80 MB and is imported where a test needs it."""
    return pytest.importorskip("distributed", reason="pip install '.[cluster]'")


def trained(folder: Path, calls: Calls, between: object = None) -> Array:
    run = FeedbackTraining(TINY, folder)
    for done, _ in enumerate(run.run(calls), 1):
        if between is not None and done == 1:
            between()
    return run.weights


def test_worker_killed_in_mid_run_changes_nothing(local, tmp_path: Path) -> None:
    with workers(1) as here:
        alone = trained(tmp_path / "here", here)
    with library().Client(local, set_as_default=False) as watcher:
        pids = watcher.run(os.getpid)
        address, pid = next(iter(pids.items()))
        killed = Event()

        def kill_at_work() -> None:
            while not watcher.processing()[address]:
                pass
            os.kill(pid, signal.SIGKILL)
            killed.set()

        def stop() -> None:
            # A stopped worker takes a piece and does not finish it, so that the kill
            # cannot miss.
            os.kill(pid, signal.SIGSTOP)
            Thread(target=kill_at_work, daemon=True).start()

        with Cluster(local.scheduler_address).calls() as there:
            together = trained(tmp_path / "there", there, stop)
        assert killed.is_set()
        assert pid not in watcher.run(os.getpid).values()
    np.testing.assert_array_equal(alone, together)
    journals = [
        (tmp_path / name / "feedback.jsonl").read_text().count("\n")
        for name in ("here", "there")
    ]
    assert journals == [1 + TINY.generations] * 2


def test_workers_of_another_version_are_refused(local, monkeypatch) -> None:
    monkeypatch.setattr("cell.base.campaign.versions.version", lambda _: "0.0")
    with (
        refusal(r"numpy \S+, here 0\.0"),
        Cluster(local.scheduler_address).calls(),
    ):
        pass


@pytest.mark.parametrize("address", ["tcp://127.0.0.1:9", "nowhere at all"])
def test_address_without_a_scheduler_is_one_line(monkeypatch, address: str) -> None:
    monkeypatch.setattr("cell.base.campaign.cluster.CONNECT_TIMEOUT", 0.2)
    with (
        refusal("no scheduler answers") as told,
        Cluster(address).calls(),
    ):
        pass
    assert "\n" not in str(told.value)
    clients = [each for each in gc.get_objects() if type(each) is library().Client]
    # another waits 40 s at the end
    assert all(client.status == "closed" for client in clients)


def certificate(folder: Path) -> tuple[str, str]:
    """A certificate that signs itself, and its key."""
    cert, key = str(folder / "cell.pem"), str(folder / "cell-key.pem")
    made = ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "1"]
    subprocess.run(
        [*made, "-subj", "/CN=cell", "-keyout", key, "-out", cert],
        check=True,
        capture_output=True,
    )
    return cert, key


@pytest.mark.skipif(shutil.which("openssl") is None, reason="needs openssl")
def test_cluster_with_tls_serves_who_has_the_certificate_alone(
    tmp_path: Path, monkeypatch
) -> None:
    cert, key = certificate(tmp_path)
    known = {
        "distributed.comm.tls.ca-file": cert,
        "distributed.comm.require-encryption": True,
    }
    for role in ("scheduler", "worker", "client"):
        known |= {
            f"distributed.comm.tls.{role}.cert": cert,
            f"distributed.comm.tls.{role}.key": key,
        }
    security = library().Security(
        tls_ca_file=cert,
        require_encryption=True,
        **{
            f"tls_{role}_{kind}": path
            for role in ("scheduler", "worker", "client")
            for kind, path in (("cert", cert), ("key", key))
        },
    )
    monkeypatch.setattr("cell.base.campaign.cluster.CONNECT_TIMEOUT", 400.0)
    with (
        event_loop() as loop,
        library().LocalCluster(
            n_workers=1,
            protocol="tls://",
            security=security,
            loop=loop,
            **ON_LOOPBACK,
        ) as started,
    ):
        address = started.scheduler_address
        assert address.startswith("tls://")
        with (
            refusal("no scheduler answers"),
            Cluster(address).calls(),
        ):
            pass
        with (
            pytest.importorskip("dask").config.set(known),
            Cluster(address).calls() as calls,
        ):
            assert list(calls(max, [(1, 2)])) == [(0, 2)]
