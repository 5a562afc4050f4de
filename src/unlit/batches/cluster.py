"""Where the photos are worked on: workers of our own on this machine, or somebody's cluster.

A Dask worker's number of threads is its share of cores. It gives it to Dr.Jit and works on one
photo at a time. Workers with one thread each are the fastest way to do many photos
(docs/batch.md); where memory is too small for that many, each gets more threads.
"""

from __future__ import annotations

import contextlib
import logging
import signal
from collections.abc import Iterator

import dask.config
import psutil
from dask.system import CPU_COUNT
from distributed import Client, LocalCluster, Worker, WorkerPlugin
from distributed.system import MEMORY_LIMIT

from ..errors import MachineError
from ..machine import cost as footprint

#: A photo that as many workers died of is given up.
_MAX_DEATHS = 2
_CONNECT_SECONDS = 20
_DASHBOARD = "127.0.0.1:0"


def workers_and_threads(cores: int, memory: float, jobs: int, resolution: int) -> tuple[int, int]:
    """How many workers, and threads for each, do `jobs` photos with `memory` bytes free."""
    fitting = int(memory / footprint.memory(resolution))
    workers = max(1, min(cores, fitting, jobs))
    return workers, max(1, cores // workers)


@contextlib.contextmanager
def connected(
    scheduler: str | None,
    jobs: int,
    resolution: int,
    memory: float | None = None,
    dashboard: bool = False,
) -> Iterator[Client]:
    """A client of the cluster at `scheduler`, or of one made here and ended on leaving.

    memory: bytes that the workers made here may take together; None is all that is free.
    dashboard: whether the cluster made here serves Dask's own page, to this machine only. Raises
    MachineError where the cluster does not answer.
    """
    # What Dask logs is told by rows of the table and by the progress bar. Its loggers have levels
    # of their own.
    for name in [*logging.root.manager.loggerDict]:
        if name.split(".")[0] == "distributed":
            logging.getLogger(name).setLevel(logging.CRITICAL)
    with contextlib.ExitStack() as stack:
        if scheduler is None:
            cluster = stack.enter_context(_local_cluster(jobs, resolution, memory, dashboard))
            client = stack.enter_context(Client(cluster))
            client.register_plugin(_IgnoreInterrupts())
        else:
            client = stack.enter_context(_client(scheduler))
        yield client


def _client(scheduler: str) -> Client:
    try:
        return Client(scheduler, timeout=_CONNECT_SECONDS)
    except (OSError, ValueError, TypeError, RuntimeError) as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise MachineError(
            f"{scheduler}: no Dask scheduler answers ({reason}); start one with `dask scheduler`, "
            "or name none to use this machine"
        ) from error


def _local_cluster(
    jobs: int, resolution: int, memory: float | None, dashboard: bool
) -> LocalCluster:
    free = min(MEMORY_LIMIT, psutil.virtual_memory().available, memory or float("inf"))
    workers, threads = workers_and_threads(CPU_COUNT, free, jobs, resolution)
    with dask.config.set({"distributed.scheduler.allowed-failures": _MAX_DEATHS - 1}):
        return LocalCluster(
            n_workers=workers,
            threads_per_worker=threads,
            # Encrypted, with a key that only this process has: whoever may connect to a Dask
            # scheduler may run code, and other users reach this machine's own address, too.
            security=True,
            # It shows names and times; whoever else uses this machine can read it.
            dashboard_address=_DASHBOARD if dashboard else None,  # pyright: ignore
            # At a limit Dask would pause workers, of which each has but one photo: for ever.
            memory_limit=0,
            silence_logs=logging.CRITICAL,
        )


class _IgnoreInterrupts(WorkerPlugin):
    """A terminal sends Ctrl-C to every process; only the one that leads the batch acts on it."""

    def setup(self, worker: Worker) -> None:
        signal.signal(signal.SIGINT, signal.SIG_IGN)
