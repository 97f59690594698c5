"""Several services behind one address: lines go on where one of them dies, and nothing that was told is lost."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack, closing
from pathlib import Path
from threading import Event
from urllib.parse import parse_qs, urlsplit

import pytest

from inspector.service.heart import DEAD_SECONDS
from inspector.stores import open_store
from tests.patience import until
from tests.postgresql import Server
from tests.system.clustered import Cluster, cluster
from tests.system.lines import Dashboard, Gate, come_to_the_middle, end_well, started
from tests.system.rounds import round_with_a_death


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Cluster]:
    with cluster(tmp_path_factory.mktemp("cluster")) as running:
        yield running


def test_one_is_killed_and_every_line_goes_on_and_a_dashboard_on_either_sees_both(
    made: Cluster, tmp_path: Path
) -> None:
    with ExitStack() as held:
        boards = [held.enter_context(closing(Dashboard(node.url, made.token))) for node in made.nodes]
        try:
            inspections = round_with_a_death(made, boards, made.nodes[0].kill, tmp_path)
        finally:
            made.nodes[0].end()
            made.nodes[0].start()
            made.wait_for(made.nodes[0])
        until(lambda: boards[1].has("verdict", inspections), lambda: str(boards[1].seen))


def test_all_are_restarted_one_after_the_other_and_nothing_is_lost(made: Cluster, tmp_path: Path) -> None:
    done, gate = Event(), Gate()
    lines = started(made, 8, ("ws", "rest"), more=lambda: not done.is_set(), gate=gate)
    for node in made.nodes:
        gate.close()
        come_to_the_middle(made, lines)
        assert node.stop(meanwhile=gate.open) == 0, node.log.read_text()
        node.start()
        made.wait_for(node)
    done.set()
    end_well(made, lines)
    parts = {part.inspection: part for line in lines for part in line.parts}
    moved = made.moved({*parts})
    assert moved
    for each in moved:
        parts[each].check_recording(made, tmp_path)


def test_one_that_hangs_is_left_and_changes_nothing_when_it_wakes_up(made: Cluster) -> None:
    gate = Gate()
    lines = started(made, 6, ("ws", "rest"), gate=gate)
    come_to_the_middle(made, lines)
    parts = {line.now.inspection for line in lines}
    with made.nodes[0].asleep():
        gate.open()
        end_well(made, lines)
        assert made.moved(parts)
    made.wait_for(made.nodes[0])
    end_well(made, lines)
    end_well(made, started(made, 6, each=0.0))


def test_the_database_is_killed_and_comes_back_and_nothing_is_lost(made: Cluster) -> None:
    postgresql = Server(Path(parse_qs(urlsplit(made.database).query)["host"][0]))
    gate = Gate()
    lines = started(made, 6, ("ws", "rest"), gate=gate)
    come_to_the_middle(made, lines)
    postgresql.kill()
    try:
        gate.open()
        # Longer than a service may be silent: nobody takes the others for gone.
        time.sleep(DEAD_SECONDS + 1)
    finally:
        postgresql.start()
    end_well(made, lines)
    with open_store(made.database) as store:
        until(lambda: len(store.nodes()) == len(made.nodes), lambda: str(store.nodes()))
