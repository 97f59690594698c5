"""Engines that do the work of many recordings: processes of this machine, a Dask cluster, a Ray cluster."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

NEEDED = "INSPECTOR_TESTS_NEED_CLUSTERS"
"""Set where tests without them would prove too little: what would be skipped fails."""


@contextmanager
def processes() -> Iterator[str]:
    """Two of this machine."""
    yield "processes:2"


@contextmanager
def dask() -> Iterator[str]:
    """A scheduler and two workers."""
    needs("distributed")
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster.scheduler_address.replace("tcp:", "dask:")


@contextmanager
def ray() -> Iterator[str]:
    """A node with two processors, which is gone with the process that started it."""
    needs("ray")
    environment = os.environ | {"RAY_USAGE_STATS_ENABLED": "0", "RAY_AUTH_MODE": "disabled"}
    with (
        tempfile.TemporaryFile() as said,
        subprocess.Popen(
            [sys.executable, "-c", _RAY], stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=said, env=environment
        ) as process,
    ):
        assert process.stdin is not None
        assert process.stdout is not None
        for line in process.stdout:
            if line.startswith(b"ray://"):
                yield line.decode().strip()
                break
        else:
            said.seek(0)
            raise AssertionError(said.read().decode())
        process.stdin.close()


_RAY = """
import sys, ray
options = dict(num_cpus=2, include_dashboard=False, object_store_memory=100 << 20, log_to_driver=False)
print("ray://" + ray.init(address="local", **options).address_info["gcs_address"], flush=True)
sys.stdin.read()
ray.shutdown()
"""
ENGINES = [
    pytest.param(processes, id="processes"),
    pytest.param(dask, id="dask", marks=pytest.mark.cluster),
    pytest.param(ray, id="ray", marks=pytest.mark.cluster),
]


def needs(module: str) -> None:
    """Skips the test where that is not installed."""
    if importlib.util.find_spec(module) is None:
        why = f"{module} is not installed"
        pytest.fail(why) if os.environ.get(NEEDED) else pytest.skip(why)
