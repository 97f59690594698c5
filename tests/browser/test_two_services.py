"""A dashboard at one service sees what runs at another that shares its database; and that it is gone."""

from __future__ import annotations

import os
import signal
import time
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

from inspector.client import Client
from inspector.service.folder import DataFolder
from inspector.stores import open_store
from models.errors import InspectionError
from tests.api.stations import BAD, PRODUCT, frames, teach
from tests.browser.conftest import Seen
from tests.postgresql import Server
from tests.system.serving import serve


def taught(data: Path, database: str) -> Path:
    """A folder and a database in which the product is learnt."""
    folder = DataFolder(data)
    with open_store(database) as store:
        teach(SimpleNamespace(folder=folder, store=store, now_ns=time.time_ns))
    folder.close()
    return data


def test_a_dashboard_sees_what_runs_at_another_service_with_its_pictures_and_that_it_is_gone(
    look: Callable[..., Seen], postgresql: Server, tmp_path: Path
) -> None:
    database = postgresql.new_database()
    usual = {"database": database, "scorers": "1"}
    data = taught(tmp_path / "one", database)
    with serve(data, **usual) as one, serve(tmp_path / "two", **usual) as two:
        page = look(two.url).open(wait="#station[data-state=ready]")
        with suppress(InspectionError), Client(one.url) as client:
            inspection = client.begin(PRODUCT, "0042", transport="rest")
            lane = f".lane[data-inspection='{inspection.inspection_id}']"
            page.wait_for_selector(f"{lane}[data-verdict=processing]")
            for frame in frames(BAD)[:20]:
                inspection.send(frame)
            page.wait_for_function(
                "lane => document.querySelector(`${lane} .caption`).textContent.startsWith('Frame 19,')", arg=lane
            )
            page.wait_for_function(
                "lane => document.querySelector(`${lane} .lane-facts`).textContent.includes('20, none dropped')",
                arg=lane,
            )
            os.killpg(one.process.pid, signal.SIGKILL)
            page.wait_for_function(
                "lane => document.querySelector(`${lane} .because`).textContent.includes('is gone')", arg=lane
            )
        page.close()
