"""Workers on a Dask cluster that the user started; it provides the same executor."""

import logging
from collections.abc import Iterator
from concurrent.futures import CancelledError, Executor
from contextlib import contextmanager
from importlib.metadata import version
from typing import TYPE_CHECKING

from drivers.errors import ConfigurationError, WorkersLost

if TYPE_CHECKING:
    from distributed import Client

PATIENCE = 20.0  # s in which scheduler and first worker must answer
PACKAGES = ("folding-cell", "numpy", "torch", "numba")  # that decide the numbers


@contextmanager
def cluster(address: str) -> Iterator[Executor]:
    """An executor over the cluster whose scheduler is at `address`, as tcp://HOST:PORT.

    The scheduler reassigns the work of a worker that died. Raises ConfigurationError for an address
    without a usable cluster, WorkersLost when the cluster is gone.
    """
    try:
        from distributed import Client, KilledWorker
    except ImportError:
        raise ConfigurationError(
            "--cluster: distributed is not installed; pip install '.[cluster]'"
        ) from None
    with _silence(), _connected(Client, address) as client:
        _check(client, address)
        try:
            yield client.get_executor(pure=False)
        except KilledWorker:
            raise WorkersLost(f"{address}: several workers died over the same piece") from None
        except (CancelledError, ConnectionError):
            raise WorkersLost(f"{address}: the connection to the cluster was lost") from None


def versions() -> dict[str, str]:
    """Local versions of libraries that affect the numbers."""
    return {package: version(package) for package in PACKAGES}


def _connected(connect: "type[Client]", address: str) -> "Client":
    try:
        return connect(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ConfigurationError(
            f"--cluster: {address}: no scheduler answers ({str(error).splitlines()[0]:.80}); "
            "start one with `dask scheduler`, and workers with `dask worker ADDRESS`"
        ) from None


def _check(client: "Client", address: str) -> None:
    """Refuse a cluster without workers, or with workers of other versions."""
    try:
        client.wait_for_workers(1, timeout=PATIENCE)
    except TimeoutError:
        raise ConfigurationError(
            f"--cluster: {address}: has no workers; start some with `dask worker {address}`"
        ) from None
    here = versions()
    for worker, there in client.run(versions, on_error="return").items():
        if there != here:
            raise ConfigurationError(
                f"--cluster: {worker}: {_difference(here, there)}; install the same there"
            )


def _difference(here: dict[str, str], there: object) -> str:
    if not isinstance(there, dict):
        return f"cannot run the cell ({there})"
    told = [
        f"{name} {there[name]}, here {here[name]}" for name in here if there[name] != here[name]
    ]
    return "has " + ", ".join(told)


@contextmanager
def _silence() -> Iterator[None]:
    """Silence Dask's log of lost workers and connections, which the command reports itself."""
    loggers = [logging.getLogger(name) for name in ("distributed", "distributed.client")]
    before = [logger.level for logger in loggers]
    for logger in loggers:
        logger.setLevel(logging.CRITICAL)
    try:
        yield
    finally:
        for logger, level in zip(loggers, before, strict=True):
            logger.setLevel(level)
