"""Requests of every shape that the OpenAPI document allows, and of many that it does not: answered as documented."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, given, settings
from hypothesis.errors import Unsatisfiable
from schemathesis import GenerationMode
from schemathesis.checks import not_a_server_error
from schemathesis.specs.openapi.checks import (
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
    status_code_conformance,
)

from tests import patience
from tests.api.stations import taught
from tests.system.test_serve import Server, running

CHECKS = [
    not_a_server_error,
    status_code_conformance,
    content_type_conformance,
    response_headers_conformance,
    response_schema_conformance,
]
ENDLESS = ("/v1/events",)
"""Answers that do not end."""


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """With a product that is learnt."""
    data = taught(tmp_path_factory.mktemp("documented"))
    with running(data, INSPECTOR_IDLE_SECONDS="2", INSPECTOR_CAMERAS='{"top": "simulated:?frames=3"}') as server:
        yield server
        code, err = server.end()
        assert (code, "Traceback" in err) == (0, False), err


@pytest.mark.parametrize("mode", [GenerationMode.POSITIVE, GenerationMode.NEGATIVE])
def test_every_answer_is_as_documented(server: Server, mode: GenerationMode) -> None:
    schema = schemathesis.openapi.from_url(f"{server.url}/openapi.json")
    tried = set[str]()
    for result in schema.get_all_operations():
        operation = result.ok()
        if operation.path not in ENDLESS:
            _try(operation, mode, tried)
    assert len(tried) > 20


def _try(operation: Any, mode: GenerationMode, tried: set[str]) -> None:
    @settings(max_examples=10, deadline=None, suppress_health_check=list(HealthCheck), database=None)
    @given(operation.as_strategy(generation_mode=mode))
    def ask(case: Any) -> None:
        tried.add(operation.label)
        case.call_and_validate(checks=CHECKS, timeout=patience.SECONDS)

    # Nothing can be wrong with a request that has nothing in it.
    with suppress(Unsatisfiable):
        ask()
