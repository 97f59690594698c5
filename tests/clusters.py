"""Engines that do the work of many recordings: processes of this machine, a Dask cluster, a Ray cluster."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

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
    _needs("distributed")
    from distributed import LocalCluster

    with LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster:
        yield cluster.scheduler_address.replace("tcp:", "dask:")


@contextmanager
def ray() -> Iterator[str]:
    """A node with two processors."""
    _needs("ray")
    ray = str(Path(sys.executable).parent / "ray")
    options = ("--head", "--num-cpus=2", "--include-dashboard=false", "--disable-usage-stats", "--port=0")
    memory = f"--object-store-memory={100 << 20}"
    subprocess.run([ray, "start", *options, memory], check=True, capture_output=True, timeout=120)
    try:
        yield "ray://auto"
    finally:
        subprocess.run([ray, "stop", "--force"], check=True, capture_output=True, timeout=60)


ENGINES = {"processes": processes, "dask": dask, "ray": ray}


def _needs(module: str) -> None:
    if importlib.util.find_spec(module) is None:
        why = f"{module} is not installed"
        pytest.fail(why) if os.environ.get(NEEDED) else pytest.skip(why)
