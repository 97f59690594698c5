"""The shell of the dashboard: it loads, from this host alone; its menu, its token, its themes, its errors."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import pytest

from tests.browser.conftest import Seen
from tests.system.serving import Served, serve


def test_it_loads_and_is_live(seen: Seen) -> None:
    page = seen.open(wait="#station[data-state=ready]")
    assert page.title() == "Line · Sweep Inspector"
    page.click("nav >> text=Inspections")
    page.wait_for_selector("nav a[aria-current=page] >> text=Inspections")


def test_the_only_product_is_gone_to_at_once(seen: Seen) -> None:
    page = seen.open("#/recipe")
    page.wait_for_function("() => location.hash === '#/recipe/plate'")
    page.wait_for_selector("nav a[aria-current=page] >> text=Recipes")


def test_a_view_that_is_not_there_says_so(seen: Seen) -> None:
    page = seen.open("#/nowhere", wait=".failed")
    assert "no view #/nowhere" in page.inner_text(".failed")
    page.click(".failed button")
    page.wait_for_selector("nav a[aria-current=page] >> text=Line")


def test_a_theme_that_was_chosen_stays(seen: Seen) -> None:
    page = seen.open(wait="#station[data-state=ready]")
    assert page.inner_text("#theme") == "Light"
    page.click("#theme")
    assert page.evaluate("() => getComputedStyle(document.documentElement).colorScheme") == "light"
    page.reload()
    assert page.evaluate("() => getComputedStyle(document.documentElement).colorScheme") == "light"


def test_what_fails_says_why_and_can_be_tried_again(seen: Seen) -> None:
    seen.excused.append("503")
    page = seen.page
    page.route(
        "**/v1/products*",
        lambda route: route.fulfill(
            status=503,
            headers={"Retry-After": "60", "content-type": "application/problem+json"},
            body='{"title": "Busy", "detail": "the database is locked by a backup", "status": 503}',
        ),
    )
    seen.open(wait=".failed")
    assert page.inner_text(".failed p") == "the database is locked by a backup"
    seen.both("failed")
    page.unroute("**/v1/products*")
    page.click(".failed button")
    page.wait_for_selector(".empty")


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Served]:
    """A service that asks for tokens, and knows nothing yet."""
    with serve(tmp_path_factory.mktemp("guarded") / "data", scorers="1", require_token="true") as served:
        yield served


def test_it_asks_for_a_token_until_one_is_right(look: Callable[..., Seen], guarded: Served) -> None:
    seen = look(guarded.url)
    seen.excused.append("401")
    page = seen.open(wait="dialog[open]")
    seen.both("token")
    page.fill("#token", "nonsense")
    page.keyboard.press("Enter")
    page.wait_for_selector("#token-why >> text=not known here")
    first = guarded.log.read_text().split("it is told this once: ")[1].split()[0]
    page.fill("#token", first)
    page.keyboard.press("Enter")
    page.wait_for_selector("#station[data-state=ready]")
    page.wait_for_selector(".empty")
    assert "inspector demo --serve" in page.inner_text(".empty pre")
    seen.both("line-empty")
    # It is this tab's until it is closed.
    page.reload()
    page.wait_for_selector("#station[data-state=ready]")


def test_it_is_light(seen: Seen) -> None:
    page = seen.open(wait="#station[data-state=ready]")
    sizes = page.evaluate("() => performance.getEntriesByType('resource').map(each => each.decodedBodySize)")
    assert len(sizes) < 40
    assert sum(sizes) < 500_000
