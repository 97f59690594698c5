"""The trends view: what is out of control, since when scores moved, what people said, and nothing where nothing is."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import pytest

from inspector.stores import open_store
from tests import patience
from tests.api.stations import PRODUCT, came_out, taught
from tests.browser.conftest import Seen, Station

TRENDS = f"#/trends/{PRODUCT}"
HOUR_NS = 3600 * 10**9


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Four hundred parts: one in fifty is NG, of those from 300 to 309 every other; scores moved since the 250th."""
    data = taught(tmp_path_factory.mktemp("trends") / "data")
    store = open_store(f"sqlite:{data / 'service.sqlite'}")
    verdicts = ["NG" if n % 50 == 7 or (300 <= n < 310 and n % 2) else "OK" for n in range(400)]
    begun = time.time_ns() - 90 * HOUR_NS
    active = store.active_recipe(PRODUCT)
    assert active is not None
    came_out(store, active.recipe_id, verdicts, moved_since=250, begun_ns=begun, every_ns=HOUR_NS // 5)
    store.close()
    station = Station(data)
    yield station
    station.close()


@pytest.mark.parametrize(("parts", "rejected"), [(100, 10), (900, 90), (25, 2)])
def test_control_limits_are_three_standard_deviations(seen: Seen, parts: int, rejected: int) -> None:
    page = seen.open(TRENDS)
    ask = """async groups => {
        const { control } = await import('/dashboard/js/views/trends/control.js');
        return control(groups);
    }"""
    share = rejected / parts
    told = page.evaluate(ask, [{"parts": parts, "rejected": rejected}] * 9)
    point = told["points"][0]
    deviation = 3 * (share * (1 - share) / parts) ** 0.5
    assert told["mean"] == pytest.approx(share)
    assert (point["low"], point["high"]) == pytest.approx((max(0, share - deviation), share + deviation))
    assert not any(each["out"] or each["run"] for each in told["points"])


def test_what_is_out_of_control_is_told_and_since_when_scores_moved(seen: Seen, station: Station) -> None:
    page = seen.open(TRENDS, wait=".headline[data-odd='1']")
    assert "1 of 40 groups out of control" in page.inner_text(".headline[data-odd]")
    assert "Moved since" in page.inner_text(".headline[data-changes='1']")
    assert "s 0.48 to 0.54" in page.inner_text(".headline[data-changes='1']")
    link = page.locator("table.rows a[href='#/inspection/part250']")
    assert link.count() == 1
    seen.both("trends", full=True)
    page.click("text=How to read it")
    row = page.locator("table.rows tr:has(strong.wrong)")
    assert "60.0 %" in row.inner_text() or "50.0 %" in row.inner_text()


def test_what_people_said_is_counted(seen: Seen, station: Station) -> None:
    def say(part: str, verdict: str) -> None:
        said = {"decision": "overrule", "verdict": verdict}
        patience.post(f"{station.url}/v1/inspections/{part}/disposition", json=said).raise_for_status()

    say("part000", "NG")
    say("part007", "OK")
    page = seen.open(TRENDS, wait=".figures")
    assert [each.inner_text() for each in page.locator(".figure strong").all()] == ["1", "1", "0", "398"]


def test_where_nothing_was_inspected_the_next_step_is_said(look: Callable[..., Seen], station: Station) -> None:
    seen = look(station.url, viewport={"width": 820, "height": 1180})
    empty = {"parts": 0, "verdicts": {}, "groups": [], "drift": None, "people": {}}
    seen.page.route("**/trends?**", lambda route: route.fulfill(json=empty))
    seen.open(TRENDS, wait="text=No part was inspected yet")
    seen.shot("trends-empty")


def test_a_problem_is_said_and_tried_again(look: Callable[..., Seen], station: Station) -> None:
    seen = look(station.url)
    problem = {"title": "Not now", "detail": "too much to do", "status": 500}
    seen.page.route("**/trends?**", lambda route: route.fulfill(status=500, json=problem), times=1)
    seen.excused.append("500")
    page = seen.open(TRENDS, wait=".failed >> text=too much to do")
    page.click("text=Try again")
    page.wait_for_selector(".headline[data-odd]")
