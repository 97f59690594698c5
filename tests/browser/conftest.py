"""Debian's Chromium, driven by Playwright: one per run of these tests; and stations for it to look at.

Skipped where there is no Chromium, but where `INSPECTOR_TESTS_NEED_BROWSER` is set. With
`INSPECTOR_SCREENSHOTS=folder`, `seen.shot("name")` leaves pictures there.
"""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal
from urllib.parse import urlsplit

import pytest

from inspector.client import Client
from models.frame import Frame
from tests import patience, ports
from tests.api.stations import PART, PRODUCT, frames, taught
from tests.system.serving import serve

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext, Page

FLAGS = [
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-dev-shm-usage",
]
NEXT_FRAMES = "() => new Promise(done => requestAnimationFrame(() => setTimeout(done, 60)))"
TEXTS = "selector => [...document.querySelectorAll(selector)].map(each => each.innerText)"
PATIENCE_MS = 1000 * patience.SECONDS
SIZE = {"width": 1280, "height": 720}


# Not of the session: while Playwright is there, no other test of the process can run a loop of its own.
@pytest.fixture(scope="package")
def browser() -> Iterator[Browser]:
    found = shutil.which("chromium") or shutil.which("chromium-browser")
    if found is None:
        if os.environ.get("INSPECTOR_TESTS_NEED_BROWSER"):
            pytest.fail("INSPECTOR_TESTS_NEED_BROWSER is set, and there is no chromium")
        pytest.skip("no chromium here (Debian: apt-get install chromium)")
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=found, args=FLAGS)
        yield browser
        browser.close()


class Station:
    """A service with a product that is learnt, and what a line does with it."""

    def __init__(self, data: Path, **settings: str) -> None:
        self.data, self._settings = data, {"scorers": "1"} | settings
        self._port, self._running = ExitStack(), ExitStack()
        port = self._port.enter_context(ports.held())
        self.url = f"http://127.0.0.1:{port}"
        self._start()

    def _start(self) -> None:
        self._running.enter_context(serve(self.data, port=urlsplit(self.url).port, **self._settings))

    def close(self) -> None:
        self._running.close()
        self._port.close()

    def client(self) -> Client:
        return Client(self.url)

    def inspect(self, options: str, part: str = PART, *, transport: str = "rest") -> dict[str, Any]:
        """One simulated part through the line: its result."""
        with self.client() as client, client.begin(PRODUCT, part, transport=transport) as inspection:
            for frame in frames(options):
                inspection.send(frame)
            return inspection.conclude()

    @contextmanager
    def sweeping(self, part: str = PART) -> Iterator[Callable[..., None]]:
        """A running inspection: send(frames…); it is left running, and aborted in the end."""
        with self.client() as client, client.begin(PRODUCT, part, transport="rest") as inspection:

            def send(*those: Frame) -> None:
                for frame in those:
                    inspection.send(frame)

            send.inspection = inspection  # type: ignore[attr-defined]
            yield send

    @contextmanager
    def away(self) -> Iterator[None]:
        """While this lasts the service is not there; after it, it is again, at the same port."""
        self._running.close()
        try:
            yield
        finally:
            self._start()


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Station]:
    """One for the tests of a module, which see what those before them left (xdist keeps them together)."""
    station = Station(taught(tmp_path_factory.mktemp("station") / "data"))
    yield station
    station.close()


class Seen:
    """A page, and what it did that it should not: `excused` are words of console errors that the test expects."""

    def __init__(self, page: Page, url: str) -> None:
        self.page, self.url = page, url
        self.excused: list[str] = []
        self._errors: list[str] = []
        self._asked: list[str] = []
        page.set_default_timeout(PATIENCE_MS)
        page.on("console", lambda said: self._errors.append(said.text) if said.type in ("error", "warning") else None)
        page.on("pageerror", lambda error: self._errors.append(str(error)))
        page.on("request", lambda request: self._asked.append(request.url))

    def open(self, hash: str = "#/", *, wait: str | None = None) -> Page:
        """The page at a hash, loaded; `wait` is a selector that has to be there."""
        self.page.goto(f"{self.url}/{hash}")
        if wait is not None:
            self.page.wait_for_selector(wait)
        return self.page

    def texts(self, selector: str) -> list[str]:
        """What is written in every element of a CSS selector, as it is laid out at one moment.

        Playwright's `all_inner_texts` finds them first and reads them afterwards: what the page has drawn anew in
        between is not laid out any more, and has no line breaks.
        """
        return self.page.evaluate(TEXTS, selector)

    def line(self) -> Page:
        """The line view, from when on it hears of all that happens."""
        page = self.open(wait="#station[data-state=ready]")
        page.wait_for_selector(".view.line .strip", state="attached")
        return page

    def shot(self, name: str, *, full: bool = False) -> None:
        """A picture of it, where pictures are wanted."""
        if folder := os.environ.get("INSPECTOR_SCREENSHOTS"):
            self.page.screenshot(path=Path(folder) / f"{name}.png", full_page=full, animations="disabled")

    def both(self, name: str, *, full: bool = False) -> None:
        """Pictures of it in dark and in light."""
        themes: tuple[Literal["light", "dark"], ...] = ("light", "dark")
        for theme in themes:
            self.page.emulate_media(color_scheme=theme)
            self.page.evaluate(NEXT_FRAMES)
            self.shot(f"{name}-{theme}", full=full)

    def check(self) -> None:
        """No error in the console, and no other host was asked."""
        errors = [each for each in self._errors if not any(word in each for word in self.excused)]
        assert errors == []
        local = (self.url, self.url.replace("http", "ws"), "blob:", "data:")
        assert [each for each in self._asked if not each.startswith(local)] == []


@pytest.fixture
def look(browser: Browser) -> Iterator[Callable[..., Seen]]:
    """look(url, **context) -> Seen, in a context of its own; in the end all are checked and closed."""
    opened: list[tuple[BrowserContext, Seen]] = []

    def look(url: str, **options: Any) -> Seen:
        context = browser.new_context(**({"viewport": SIZE, "color_scheme": "dark"} | options))
        seen = Seen(context.new_page(), url)
        opened.append((context, seen))
        return seen

    yield look
    for _, seen in opened:
        seen.page.close()
    for context, _ in opened:
        context.close()
    for _, seen in opened:
        seen.check()


@pytest.fixture
def seen(look: Callable[..., Seen], station: Station) -> Seen:
    """A page that looks at the station, 1280 x 720, dark."""
    return look(station.url)
