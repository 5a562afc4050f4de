"""A stand-in for the reconstruction, and a cluster in this process."""

import contextlib
from pathlib import Path

import pytest

pytest.importorskip("distributed", reason="needs the extra 'batch'")

import batch_stand_in
from unlit.batches import run as run_module


@pytest.fixture
def log(tmp_path, monkeypatch) -> Path:
    """The stand-in is in place; what it did is in this file."""
    path = tmp_path / "calls.log"
    batch_stand_in.install(path, patch=monkeypatch)
    return path


@pytest.fixture(scope="session")
def _client():
    from distributed import Client, LocalCluster

    with (
        LocalCluster(
            n_workers=1,
            threads_per_worker=2,
            processes=False,
            dashboard_address=None,  # pyright: ignore[reportArgumentType]
        ) as cluster,
        Client(cluster) as client,
    ):
        yield client


@pytest.fixture
def cluster(_client, monkeypatch):
    """Batches run on threads of this process."""

    @contextlib.contextmanager
    def connected(*_):
        yield _client

    monkeypatch.setattr(run_module, "connected", connected)
