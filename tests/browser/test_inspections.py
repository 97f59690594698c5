"""The list of inspections: ten thousand of them scrolled through, found by filters and keys, current by itself."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from tests import patience
from tests.api.stations import BAD, GOOD, copied, taught
from tests.browser.conftest import Seen, Station

MANY = 10_000
LIST = "#/inspections"
ROWS = ".inspection-list .vtable-room .vtable-row"
DOWN = """async () => {
    const list = document.querySelector(".inspection-list");
    const frame = () => new Promise(done => requestAnimationFrame(done));
    let most = 0;
    while (!document.querySelector(".known").textContent.endsWith("in all")) {
        list.scrollTop = list.scrollHeight;
        await frame();
        most = Math.max(most, list.querySelectorAll(".vtable-room .vtable-row").length);
    }
    return most;
}"""
"""Scrolls down until the oldest is there: the most rows that were there at once."""
AT = """async indices => {
    const list = document.querySelector(".inspection-list");
    const found = [];
    for (const index of indices) {
        list.scrollTop = 44 * index;
        await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)));
        const row = list.querySelector(`[aria-rowindex="${index + 2}"]`);
        const { top, bottom } = row.getBoundingClientRect();
        const room = list.getBoundingClientRect();
        found.push([row.querySelector("a").textContent, top >= room.top && bottom <= room.bottom]);
    }
    return found;
}"""
"""The parts of these rows, and whether they are in sight, after scrolling to them."""


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """Where ten thousand parts were inspected, every fiftieth of them NG, and then three more."""
    station = Station(taught(tmp_path_factory.mktemp("many") / "data"))
    first = station.inspect(GOOD, "first")["inspection_id"]
    copied(station.data, first, MANY - 1)
    station.inspect(BAD, "the last but one")
    station.inspect(GOOD, "the last")
    yield station
    station.close()


def parts(seen: Seen) -> list[str]:
    return seen.texts(f"{ROWS} a")


def test_ten_thousand_are_scrolled_through_and_few_rows_are_there_at_once(seen: Seen) -> None:
    page = seen.open(LIST, wait=ROWS)
    assert parts(seen)[:2] == ["the last", "the last but one"]
    assert "The newest 200" in page.inner_text(".known")
    seen.both("inspections")
    assert page.evaluate(DOWN) < 60
    assert page.inner_text(".known") == f"{MANY + 2} in all"
    everything = ["the last", "the last but one", *(f"{k:05}" for k in reversed(range(1, MANY))), "first"]
    indices = [MANY + 1, *range(0, MANY, 397), 199, 200, 201]
    assert page.evaluate(AT, indices) == [[everything[index], True] for index in indices]


def test_filters_find_them_and_are_in_the_address(seen: Seen) -> None:
    page = seen.open(LIST, wait=ROWS)
    page.select_option("#filter-verdict", "NG")
    page.wait_for_selector(".known >> text=The newest 200")
    page.wait_for_url("**#/inspections?verdict=NG")
    page.wait_for_function(
        f"() => [...document.querySelectorAll('{ROWS} .verdict')].every(each => /NG/.test(each.textContent))"
    )
    page.fill("#filter-part", "0120")
    page.wait_for_selector(".known >> text=1 in all")
    assert parts(seen) == ["01207"]
    page.reload()
    page.wait_for_selector(".known >> text=1 in all")
    assert page.input_value("#filter-part") == "0120"
    page.select_option("#filter-verdict", "processing")
    page.wait_for_selector("text=None is like that")
    seen.shot("inspections-none")
    page.click("text=Show all")
    page.wait_for_selector(".known >> text=The newest 200")


def test_by_keyboard_and_back_to_the_same_place(seen: Seen) -> None:
    page = seen.open(f"{LIST}?verdict=OK", wait=ROWS)
    page.wait_for_selector("#station[data-state=ready]")
    page.focus(".inspection-list")
    for key in ("ArrowDown", *["PageDown"] * 6, "ArrowUp"):
        page.keyboard.press(key)
    row = f"{ROWS}[aria-selected=true]"
    page.wait_for_selector(f"{row}[aria-rowindex='61']")
    part, top = page.inner_text(f"{row} a"), page.evaluate("document.querySelector('.inspection-list').scrollTop")
    assert top > 0
    page.keyboard.press("Enter")
    page.wait_for_selector(f"h1 >> text={part}")
    page.go_back()
    page.wait_for_selector(f"{row}[aria-rowindex='61']")
    assert page.inner_text(f"{row} a") == part
    assert page.evaluate("document.querySelector('.inspection-list').scrollTop") == top


def test_what_comes_is_there_by_itself(seen: Seen, station: Station) -> None:
    page = seen.open(LIST, wait=ROWS)
    page.wait_for_selector("#station[data-state=ready]")
    with station.sweeping("just now"):
        page.wait_for_selector(f"{ROWS}:first-child >> text=just now")
        page.wait_for_selector(f"{ROWS}:first-child >> text=running")
    page.wait_for_selector(f"{ROWS}:first-child >> text=aborted")
    # What is in sight stays there.
    page.evaluate("document.querySelector('.inspection-list').scrollTop = 44 * 100")
    page.wait_for_selector(f"{ROWS}[aria-rowindex='102']")
    place = f"{ROWS} a >> text="
    part = page.locator(f"{ROWS}[aria-rowindex='102'] a").inner_text()
    before = page.locator(f"{place}{part}").bounding_box()
    result = station.inspect(BAD, "and now")
    page.wait_for_selector(f"{ROWS}[aria-rowindex='103'] >> text={part}")
    after = page.locator(f"{place}{part}").bounding_box()
    assert before is not None
    assert after is not None
    assert after["y"] == pytest.approx(before["y"], abs=1)
    said = {"decision": "overrule", "verdict": "OK"}
    address = f"{station.url}/v1/inspections/{result['inspection_id']}/disposition"
    patience.post(address, json=said).raise_for_status()
    page.evaluate("document.querySelector('.inspection-list').scrollTop = 0")
    page.wait_for_selector(f"{ROWS}:first-child >> text=says OK")


def test_what_fails_is_said_and_tried_again(seen: Seen) -> None:
    problem = {"title": "Not now", "detail": "too much to do", "status": 500}
    broken: list[Any] = []

    def fail_once(route: Any) -> None:
        """The second page."""
        if broken:
            route.fallback()
        else:
            broken.append(route.request.url)
            route.fulfill(status=500, json=problem)

    seen.excused.append("500")
    seen.page.route("**/v1/inspections?*after=*", fail_once)
    page = seen.open(LIST, wait=ROWS)
    page.focus(".inspection-list")
    page.keyboard.press("End")
    page.wait_for_selector(".known >> text=too much to do")
    page.click(".known >> text=Try again")
    page.wait_for_selector(".known >> text=The newest 400")


def test_on_a_tablet_nothing_is_cut_off(look: Callable[..., Seen], station: Station) -> None:
    seen = look(station.url, viewport={"width": 820, "height": 1180}, has_touch=True)
    page = seen.open(LIST, wait=ROWS)
    assert page.evaluate("() => document.documentElement.scrollWidth") <= 820
    heights = page.eval_on_selector_all(
        f"{ROWS} a, select, input, nav a", "all => all.map(each => each.getBoundingClientRect().height)"
    )
    assert min(heights) >= 39.5
    seen.shot("inspections-tablet")
