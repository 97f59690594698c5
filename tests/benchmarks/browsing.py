"""Does the dashboard load in under a second, and do 10,000 inspections and a sweep of 600 frames scroll without jank?

Run by hand, on an otherwise idle machine: python -m tests.benchmarks.browsing [--rounds 5]

Debian's Chromium, driven as by the tests, without a graphics card: it draws on the same two cores that score. Loading
is from the start of the navigation until the picture of a running inspection is drawn. Jank is frames of the screen
that came late: their intervals, while the list is scrolled by a row and a half a frame, and while an arrow key is held
down over the sweep.
"""

from __future__ import annotations

import argparse
import shutil
import tempfile
from pathlib import Path
from statistics import median
from typing import TYPE_CHECKING, Any

from playwright.sync_api import sync_playwright

from inspector.cameras import open_camera
from inspector.client import Client
from inspector.learner import learn_recordings
from inspector.recorder import record
from inspector.recording import SweepReader
from tests.api.stations import copied
from tests.benchmarks.streaming import PRODUCT, served, teach
from tests.browser.conftest import FLAGS, SIZE

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

MANY, LONG = 10_000, 600
CAMERA = f"simulated:?frames={LONG}&size=320x240&part=plate&path=line"
FIRST_PICTURE = """{
    const look = () => {
        const told = document.querySelector(".lane .caption")?.textContent ?? "";
        if (!told.startsWith("Frame")) return requestAnimationFrame(look);
        requestAnimationFrame(() => (window.firstPicture = performance.now()));
    };
    requestAnimationFrame(look);
}"""
INTERVALS = """async frames => {
    const found = [];
    let before = await new Promise(requestAnimationFrame);
    for (let n = 0; n < frames; n++) {
        ACT;
        const now = await new Promise(requestAnimationFrame);
        found.push(now - before);
        before = now;
    }
    return found;
}"""
SCROLL = "document.querySelector('.inspection-list').scrollTop += 66"
ARROW = """document.querySelector('.scrub').dispatchEvent(
    new KeyboardEvent('keydown', { key: 'ArrowRight', bubbles: true, cancelable: true }))"""


def loading(browser: Browser, url: str) -> tuple[float, float, int]:
    """Milliseconds to the first picture, cold and in a browser that was there before; requests until then, cold."""
    context = browser.new_context(viewport=SIZE)
    found = list[float]()
    requests = 0
    for _ in range(2):
        page = context.new_page()
        page.add_init_script(FIRST_PICTURE)
        page.goto(f"{url}/#/")
        page.wait_for_function("() => window.firstPicture")
        found.append(page.evaluate("window.firstPicture"))
        requests = requests or page.evaluate(
            "performance.getEntriesByType('resource').filter(each => each.startTime < firstPicture).length"
        )
        page.close()
    context.close()
    return found[0], found[1], requests


def intervals(page: Page, act: str) -> list[float]:
    """Milliseconds from frame to frame of the screen, where this is done in each."""
    return page.evaluate(INTERVALS.replace("ACT", act), LONG)


def said(found: list[float]) -> str:
    ordered = sorted(found)
    late = sum(each > 50 for each in ordered)
    return (
        f"{len(ordered)} frames: median {median(ordered):.0f} ms, p99 {ordered[int(0.99 * len(ordered))]:.0f} ms, "
        f"longest {ordered[-1]:.0f} ms, {late} over 50 ms"
    )


def jank(page: Page, url: str, inspection_id: str) -> None:
    page.goto(f"{url}/#/inspections")
    page.wait_for_selector(".inspection-list .verdict")
    print("list of 10,000, scrolled:", said(intervals(page, SCROLL)), flush=True)
    while not page.inner_text(".known").endswith("in all"):
        page.evaluate("document.querySelector('.inspection-list').scrollTop = 1e9")
        page.wait_for_timeout(20)
    page.evaluate("document.querySelector('.inspection-list').scrollTop = 0")
    print("the same with all of it read:", said(intervals(page, SCROLL)), flush=True)
    page.goto(f"{url}/#/inspection/{inspection_id}?frame=0")
    page.wait_for_selector(".panes-room[data-frame]")
    page.focus(".scrub")
    print("sweep of 600, arrow held down:", said(intervals(page, ARROW)), flush=True)
    page.click("summary >> text=Raw numbers")
    page.wait_for_selector(".vtable-row[aria-selected=true]")
    page.focus(".scrub")
    page.keyboard.press("Home")
    print("the same with its numbers open:", said(intervals(page, ARROW)), flush=True)


def main() -> None:
    """Loading in rounds, then jank."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--rounds", type=int, default=5)
    asked = parser.parse_args()
    with tempfile.TemporaryDirectory() as name, sync_playwright() as playwright:
        folder = Path(name)
        for part, options in (("golden", "unit=1&seed=1"), ("part", "unit=2&seed=2&defect=extra&at=0.3")):
            with open_camera(f"{CAMERA}&{options}") as camera:
                record(camera, folder / f"{part}.mcap", lossless=True)
        learn_recordings([folder / "golden.mcap"], folder / "plate.appearance")
        teach(folder, folder / "data")
        frames = list(SweepReader(folder / "part.mcap"))
        browser = playwright.chromium.launch(
            executable_path=shutil.which("chromium") or shutil.which("chromium-browser"), args=FLAGS
        )
        with served(folder / "data") as url, Client(url) as client:
            with client.begin(PRODUCT, "0001") as inspection:
                for frame in frames:
                    inspection.send(frame)
                result: dict[str, Any] = inspection.conclude()
            copied(folder / "data", result["inspection_id"], MANY - 1)
            with client.begin(PRODUCT, "running", transport="rest") as running:
                for frame in frames[:30]:
                    running.send(frame)
                loads = [loading(browser, url) for _ in range(asked.rounds)]
                for what, times in zip(("cold", "known"), zip(*loads, strict=True), strict=False):
                    print(f"first picture, {what}: median {median(times):.0f} ms, longest {max(times):.0f} ms")
                print(f"requests until then: {loads[0][2]}", flush=True)
                running.abort("enough")
            jank(browser.new_page(viewport=SIZE), url, result["inspection_id"])
        browser.close()


if __name__ == "__main__":
    main()
