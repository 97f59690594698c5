"""The line view: what the camera sees, where it is wrong, the verdict; through restarts, by keyboard, on a tablet."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import pytest

from inspector.cameras import open_camera
from inspector.cameras.simulated import SimulatedCamera
from inspector.client import Client
from inspector.demo import CLOSE
from models.frame import Frame
from tests.api.stations import BAD, GOOD, LINE, PRODUCT, frames
from tests.browser.conftest import Seen, Station
from tests.system.serving import serve

ORANGE = """([canvas, x0, y0, x1, y1]) => {
    const pen = document.querySelector(canvas).getContext("2d");
    const { width, height } = pen.canvas;
    const { data } = pen.getImageData(0, 0, width, height);
    let box = null;
    for (let at = 0; at < data.length; at += 4) {
        const [red, green, blue] = data.subarray(at, at + 3);
        if (Math.abs(red - 255) > 3 || Math.abs(green - 147) > 3 || Math.abs(blue - 32) > 3) continue;
        const [x, y] = [(at / 4) % width, Math.floor(at / 4 / width)];
        box = box ? [Math.min(box[0], x), Math.min(box[1], y), Math.max(box[2], x), Math.max(box[3], y)] : [x, y, x, y];
    }
    return box && box.map((each, index) => each / (index % 2 ? height : width));
}"""
"""Where a canvas is as orange as a box: x0, y0, x1, y1 as shares of it; null where it is nowhere."""

AWAY = ["net::ERR_", "503"]
"""What a browser says where a service stops, is away, and starts."""


def true_boxes(options: str) -> list[tuple[float, float, float, float] | None]:
    """For each frame where the planted defect is, in its pixels; the camera knows."""
    with open_camera(f"{LINE}&{options}") as camera:
        assert isinstance(camera, SimulatedCamera)
        return [frame.defects[0].box if frame.defects else None for frame in camera.truth()]


def told_boxes(label: str) -> list[tuple[float, float, float, float]]:
    """x0, y0, x1, y1 of the boxes that a picture is described by."""
    found = re.findall(r"at x (\d+) to (\d+), y (\d+) to (\d+)", label)
    return [(float(x0), float(y0), float(x1), float(y1)) for x0, x1, y0, y1 in found]


def touch(one: tuple[float, ...], other: tuple[float, ...]) -> bool:
    return all(one[axis] <= other[axis + 2] + CLOSE and other[axis] <= one[axis + 2] + CLOSE for axis in (0, 1))


def test_nothing_inspected_yet_says_what_to_do(seen: Seen) -> None:
    page = seen.open(wait=".empty")
    assert f"inspector push part-0001.mcap --url {seen.url} --product {PRODUCT}" in page.inner_text(".empty pre")
    seen.both("line-ready")


def test_a_defective_part_goes_through_to_ng_with_its_box_over_the_true_place(seen: Seen, station: Station) -> None:
    truth, sweep = true_boxes(BAD), frames(BAD)
    page = seen.line()
    with station.client() as client, client.begin(PRODUCT, "0042", transport="rest") as inspection:
        lane = f".lane[data-inspection='{inspection.inspection_id}']"
        page.wait_for_selector(f"{lane}[data-verdict=processing]")
        told: list[dict[str, Any]] = []
        inspection._on_message = told.append  # type: ignore[attr-defined]
        bad = next(
            index
            for index, frame in enumerate(sweep)
            if inspection.send(frame) is None and index > 4 and told[-1].get("regions") and truth[index] is not None
        )
        # The picture that is shown now is that of the frame that was sent last.
        page.wait_for_function(
            "([lane, index]) => document.querySelector(`${lane} .caption`).textContent.startsWith(`Frame ${index},`)",
            arg=[lane, bad],
        )
        label = page.get_attribute(f"{lane} canvas.picture", "aria-label") or ""
        place = truth[bad]
        assert place is not None
        assert any(touch(box, place) for box in told_boxes(label)), (label, place)
        seen.both("line-running")
        for frame in sweep[bad + 1 :]:
            inspection.send(frame)
        result = inspection.conclude()
    assert result["verdict"] == "NG"
    page.wait_for_selector(f"{lane}[data-verdict=NG]")
    assert page.inner_text(f"{lane} .now").split() == ["✕", "NG"]
    worst = max((each for each in result["deviations"] if each["regions"]), key=lambda each: each["peak_score"])
    page.wait_for_function(
        "([lane, index]) => document.querySelector(`${lane} .caption`).textContent.startsWith(`Frame ${index},`)",
        arg=[lane, worst["peak_index"]],
    )
    label = page.get_attribute(f"{lane} canvas.picture", "aria-label") or ""
    place = truth[worst["peak_index"]]
    assert place is not None
    assert any(touch(box, place) for box in told_boxes(label)), (label, place)
    # And it is drawn there.
    drawn = page.wait_for_function(ORANGE, arg=[f"{lane} canvas.picture", 0, 0, 0, 0]).json_value()
    width, height = sweep[0].size
    assert touch([drawn[0] * width, drawn[1] * height, drawn[2] * width, drawn[3] * height], place)
    assert page.get_attribute(".tiles li:first-child a", "aria-label").startswith(f"{PRODUCT} 0042: NG")
    seen.both("line-ng")


def test_a_good_part_is_ok_and_the_strip_tells_both(seen: Seen, station: Station) -> None:
    page = seen.line()
    assert station.inspect(GOOD, "0043")["verdict"] == "OK"
    page.wait_for_selector(".lane[data-verdict=OK]")
    assert page.locator(".lane").count() == 1
    assert page.inner_text(".tally") == "1 OK · 1 NG"
    # The bar under the curve tells what was seen; the result knows exactly.
    assert "100 %" in page.inner_text(".lane-facts")
    seen.both("line-ok")


def test_several_at_once_have_a_lane_each_and_keep_it(seen: Seen, station: Station) -> None:
    page = seen.line()
    with station.client() as client:
        running = [client.begin(PRODUCT, f"10{number}", transport="rest") for number in range(4)]
        for number, inspection in enumerate(running):
            for frame in frames(BAD if number == 2 else GOOD)[: 16 - 3 * number]:
                inspection.send(frame)
        page.wait_for_function("() => document.querySelectorAll('.lane.is-running').length === 4")
        page.wait_for_function(
            "() => [...document.querySelectorAll('.caption')].every(each => /^Frame/.test(each.textContent))"
        )
        before = page.eval_on_selector_all(".lane", "lanes => lanes.map(lane => lane.dataset.inspection)")
        assert sorted(before) == sorted(each.inspection_id for each in running)
        seen.both("line-four", full=True)
        running[1].abort("the part fell off")
        page.wait_for_selector(".tiles li:first-child a[aria-label*=aborted]")
        after = page.eval_on_selector_all(".lane", "lanes => lanes.map(lane => lane.dataset.inspection)")
        assert after == [each for each in before if each != running[1].inspection_id]
        for inspection in (running[0], running[2], running[3]):
            inspection.abort("enough")


def test_a_part_that_lies_upside_down_is_invalid_while_it_is_there(seen: Seen, station: Station) -> None:
    page = seen.line()
    with station.client() as client, client.begin(PRODUCT, "0049", transport="rest") as inspection:
        lane = f'.lane.is-running[data-inspection="{inspection.inspection_id}"]'
        for number, frame in enumerate(reversed(frames(GOOD)[-8:])):
            inspection.send(Frame(frame.pixels[::-1, ::-1], 40_000_000 * number, number))
        page.wait_for_selector(f"{lane}[data-verdict=INVALID] .because >> text=upside down, turned by 180 degrees")
        seen.both("line-upside-down")


def test_who_comes_in_the_middle_sees_what_was_found_before(seen: Seen, station: Station) -> None:
    with station.sweeping("0051") as send:
        send(*frames(BAD)[:20])
        page = seen.open(wait=".lane.is-running[data-verdict=NG]")
        page.wait_for_selector(".lane.is-running .because >> text=NG is certain already: too bright at s 0.")


def test_who_comes_in_the_middle_sees_that_another_part_lies_there(seen: Seen, station: Station) -> None:
    with station.client() as client, client.begin(PRODUCT, "0052", transport="rest") as inspection:
        for number, frame in enumerate(reversed(frames(GOOD)[-8:])):
            inspection.send(Frame(frame.pixels[::-1, ::-1], 40_000_000 * number, number))
        page = seen.open(wait=".lane.is-running[data-verdict=INVALID]")
        page.wait_for_selector(".lane.is-running .because >> text=upside down, turned by 180 degrees")


def test_who_comes_while_nothing_moves_sees_the_last_picture(seen: Seen, station: Station) -> None:
    with station.sweeping("0050") as send:
        send(*frames(BAD)[:12])
        page = seen.open(wait=".lane.is-running")
        page.wait_for_selector(".lane.is-running .caption >> text=Frame 11, s 0.")
        page.wait_for_function(ORANGE, arg=[".lane.is-running canvas.picture", 0, 0, 0, 0])
        page.click(".lane.is-running .lane-name")
        page.wait_for_selector(".watched >> text=Frame 11.")


def test_it_goes_on_after_the_service_was_restarted(seen: Seen, station: Station) -> None:
    seen.excused += AWAY
    page = seen.line()
    page.wait_for_selector(".lane")
    with station.away():
        page.wait_for_selector(".away:not([hidden])")
        page.wait_for_selector("#station[data-state=reconnecting]")
        assert "true at" in page.inner_text(".away")
        seen.both("line-away")
    page.wait_for_selector("#station[data-state=ready]")
    page.wait_for_selector(".away", state="hidden")
    # It hears what happens, without being loaded again.
    assert station.inspect(GOOD, "0044")["verdict"] == "OK"
    page.wait_for_selector(".tiles li:first-child a[aria-label*='0044: OK']")
    assert page.inner_text(".lane-name .part") == "0044"


def test_what_happened_while_it_was_away_is_read_again(seen: Seen, station: Station) -> None:
    seen.excused += AWAY
    page = seen.line()
    with station.away():
        page.wait_for_selector("#station[data-state=reconnecting]")
        # Somewhere else, where this page does not look.
        with serve(station.data, scorers="1") as other, Client(other.url) as client:
            client.begin(PRODUCT, "0045", transport="rest").abort("a power cut")
    page.wait_for_selector(".tiles li:first-child a[aria-label*='0045: aborted']")
    page.wait_for_selector(".because >> text=a power cut")


def test_without_a_mouse(seen: Seen, station: Station) -> None:
    page = seen.open(wait=".tiles li:nth-child(3)")
    page.keyboard.press("Tab")
    assert page.evaluate("() => document.activeElement.className") == "skip"
    page.keyboard.press("Enter")
    assert page.evaluate("() => document.activeElement.id") == "view"
    page.keyboard.press("Tab")
    assert page.evaluate("() => document.activeElement.className") == "lane-name"
    page.keyboard.press("Tab")
    first = page.evaluate("() => document.activeElement.getAttribute('aria-label')")
    page.keyboard.press("ArrowRight")
    page.keyboard.press("ArrowRight")
    second = page.evaluate("() => document.activeElement.getAttribute('aria-label')")
    assert (first, second) == tuple(
        page.get_attribute(f".tiles li:nth-child({number}) a", "aria-label") for number in (1, 3)
    )
    seen.both("line-keyboard")
    page.keyboard.press("Enter")
    page.wait_for_function("() => location.hash.startsWith('#/inspection/')")


def test_sound_is_off_until_it_is_asked_for(seen: Seen) -> None:
    page = seen.open(wait="#station[data-state=ready]")
    assert page.get_attribute("#sound", "aria-pressed") == "false"
    page.click("#sound")
    assert (page.get_attribute("#sound", "aria-pressed"), page.inner_text("#sound")) == ("true", "Sound on")


@pytest.mark.parametrize(
    ("name", "width", "height"), [("tablet", 820, 1180), ("wide", 1920, 1080), ("phone", 390, 844)]
)
def test_nothing_is_cut_off(look: Callable[..., Seen], station: Station, name: str, width: int, height: int) -> None:
    station.inspect(BAD, f"on a {name}")
    seen = look(station.url, viewport={"width": width, "height": height}, has_touch=name != "wide")
    page = seen.open(wait=".lane .caption >> text=Frame")
    page.wait_for_selector("#station[data-state=ready]")
    assert page.evaluate("() => document.documentElement.scrollWidth") <= width
    for size in page.eval_on_selector_all(
        "button, nav a, .lane-name, .tiles a", "all => all.map(each => each.getBoundingClientRect().height)"
    ):
        assert size >= 39.5
    seen.both(f"line-{name}")
