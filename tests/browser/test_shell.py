"""The shell of the dashboard: it loads, from this host alone; its menu, its token, its themes."""

from __future__ import annotations

from tests.browser.conftest import Seen


def test_it_loads_and_is_live(seen: Seen) -> None:
    page = seen.open(wait="#station[data-state=ready]")
    assert page.title() == "Line · Sweep Inspector"
    page.click("nav >> text=Inspections")
    page.wait_for_selector("nav a[aria-current=page] >> text=Inspections")
    seen.both("shell")
