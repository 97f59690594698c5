"""The same round by Ray Serve, on one machine: a replica is killed, and every line goes on."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path
from uuid import uuid4

import pytest

from tests.patience import until
from tests.system.lines import Dashboard
from tests.system.ray_serve import ray_serve
from tests.system.rounds import round_with_a_death

pytestmark = pytest.mark.cluster


def test_a_replica_is_killed_and_every_line_goes_on_and_a_dashboard_on_either_sees_both(tmp_path: Path) -> None:
    with ray_serve(tmp_path) as (made, ray), ExitStack() as held:
        # Which replica a dashboard is on, its key says: of so many, some are on either.
        boards = [Dashboard(made.url, made.token, **{"X-Session-Id": uuid4().hex}) for _ in range(6)]
        for board in boards:
            held.callback(board.close)
        gone, stays = ray.replicas()
        round_with_a_death(made, boards, lambda: ray.kill(gone), tmp_path, each=0.25, replaced=True)
        until(lambda: len(ray.replicas()) == 2, lambda: "Ray starts no other replica")
        assert stays in ray.replicas()
