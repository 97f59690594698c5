"""A dashboard at one service sees what runs at another that shares its database; and that it is gone."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

from inspector.client import Client
from models.errors import InspectionError
from tests.api.stations import BAD, PRODUCT, frames, taught
from tests.browser.conftest import Seen
from tests.postgresql import Server
from tests.system.serving import serve

CAPTION = "([lane, said]) => document.querySelector(`${lane} .caption`).textContent.startsWith(said)"


def test_a_dashboard_sees_what_runs_at_another_service_with_its_pictures_and_that_it_is_gone(
    look: Callable[..., Seen], postgresql: Server, tmp_path: Path
) -> None:
    database = postgresql.new_database()
    usual = {"database": database, "scorers": "1"}
    data = taught(tmp_path / "one", database)
    with serve(data, **usual) as one, serve(tmp_path / "two", **usual) as two:
        page = look(two.url).line()
        with suppress(InspectionError), Client(one.url) as client:
            inspection = client.begin(PRODUCT, "0042", transport="rest")
            lane = f".lane[data-inspection='{inspection.inspection_id}']"
            page.wait_for_selector(f"{lane}[data-verdict=processing]")
            for frame in frames(BAD)[:20]:
                inspection.send(frame)
            page.wait_for_function(CAPTION, arg=[lane, "Frame 19,"])
            # From now on it is known there, for sure, that somebody looks on here.
            inspection.send(frames(BAD)[20])
            page.wait_for_function(CAPTION, arg=[lane, "Frame 20,"])
            page.wait_for_function(
                "lane => document.querySelector(`${lane} .lane-facts`).textContent.includes('21, none dropped')",
                arg=lane,
            )
            os.killpg(one.process.pid, signal.SIGKILL)
            page.wait_for_function(
                "lane => document.querySelector(`${lane} .because`).textContent.includes('is gone')", arg=lane
            )
        page.close()
