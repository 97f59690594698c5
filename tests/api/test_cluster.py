"""What of the deployment on Ray needs no Ray: a folder for every replica, and what is refused."""

from __future__ import annotations

import asyncio
import sys
from argparse import ArgumentTypeError
from pathlib import Path

import pytest

from api.cluster import RayMissing, app, application, main, started
from inspector.settings import SettingRefused, read_settings
from inspector.stores.errors import StoreNotOpened
from tests.clusters import needs


def test_a_replica_takes_the_first_folder_that_nobody_works_on(tmp_path: Path) -> None:
    settings = read_settings(data=tmp_path, scorers=1)

    async def folders() -> list[str]:
        first = await started(settings)
        second = await started(settings)
        await first.stop("it is enough")
        third = await started(settings)
        for service in (second, third):
            await service.stop("it is enough")
        return [service.folder.path.name for service in (first, second, third)]

    assert asyncio.run(folders()) == ["replica-0", "replica-1", "replica-0"]


def test_several_replicas_need_a_database_that_they_share(tmp_path: Path) -> None:
    with pytest.raises(SettingRefused, match="setting database: 2 replicas share one; allowed is postgresql://"):
        application(read_settings(data=tmp_path), 2)


def test_several_replicas_need_a_place_for_files_that_they_share(tmp_path: Path) -> None:
    with pytest.raises(SettingRefused, match="setting files: 2 replicas share one; allowed are s3://… and file:///…"):
        application(read_settings(data=tmp_path, database="postgresql://host/name"), 2)


@pytest.mark.parametrize("count", ["0", "-1", "many"])
def test_no_replicas_are_refused_before_anything_starts(count: str, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["--replicas", count])
    assert f"{count!r} is not allowed; allowed is a whole number above 0" in capsys.readouterr().err.replace("\n", " ")
    with pytest.raises(ArgumentTypeError, match="not allowed"):
        app({"replicas": count})


@pytest.mark.cluster
@pytest.mark.filterwarnings("default")
def test_a_database_that_is_not_there_is_said_before_anything_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    needs("ray")
    monkeypatch.setenv("INSPECTOR_DATABASE", "postgresql://nobody@127.0.0.1:1/none")
    with pytest.raises(StoreNotOpened, match="refused"):
        main([])


def test_where_ray_is_missing_that_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "ray.serve", None)
    with pytest.raises(RayMissing, match=r"pip install 'sweep-inspector\[cluster\]'"):
        application(read_settings(data=tmp_path), 1)
