"""One inspection looked at: its place on the part under the slider, three pictures, numbers, and what may be done."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from inspector.cameras import open_camera
from inspector.cameras.simulated.camera import SimulatedCamera
from inspector.cameras.simulated.truth import FrameTruth
from inspector.recording import SweepReader
from tests.api.stations import BAD, GOOD, LINE, PRODUCT, frames, remove_scores
from tests.browser.conftest import NEXT_FRAMES, Seen, Station

EARLY = f"{GOOD}&early=6"
READY = ".panes-room[data-frame]"
INK = """name => {
    const canvas = document.querySelector(`.pane.${name} canvas`);
    const { data, width } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
    const scale = canvas.width / 240, ink = [];
    for (let at = 0; at < data.length; at += 4)
        if (data[at] - data[at + 2] > 90) ink.push([(at / 4) % width / scale, Math.floor(at / 4 / width) / scale]);
    return ink;
}"""
"""Where the picture is orange, in pixels of the frame."""
PURE = """async () => {
    const { Sweep, onReference } = await import("/dashboard/js/sweep.js");
    const frame = (index, s, state = "scored") =>
        ({ index, s, state, score: 0.1, residuals: { appearance: 0.1, position: 0, timing: 0 }, regions: [] });
    const sweep = new Sweep([
        frame(0, null, "waiting"), frame(1, 0), frame(2, 0.1), frame(3, null, "lost"), frame(4, null, "lost"),
        frame(5, 0.7), frame(6, 0.61), frame(7, 0.8),
    ]);
    const [a, b] = [Math.cos(0.1), -Math.sin(0.1)];
    return {
        places: [...sweep.places],
        order: sweep.order,
        nearest: [0.29, 0.31, 0.42, 0.9].map(s => sweep.nearest(s)),
        scored: [0.29, 0.31, 0.42, 0.9].map(s => sweep.nearest(s, true)),
        unseen: sweep.unseen(0.8),
        broken: sweep.columns().score.map(each => each === null),
        none: [new Sweep().nearest(0.5), new Sweep().unseen()],
        again: [sweep.add([frame(7, 0.8)]), sweep.add([frame(8, 0.85)]), sweep.length],
        moved: onReference({ x: 12, y: 23, width: 8, height: 6 }, [1, 0, 10, 0, 1, 20]),
        turned: onReference({ x: 100, y: 50, width: 20, height: 10 }, [a, b, 0, -b, a, 0]),
    };
}"""


def address(inspection: str, frame: int | None = None) -> str:
    return f"#/inspection/{inspection}" + ("" if frame is None else f"?frame={frame}")


@pytest.fixture(scope="module")
def bad(station: Station) -> dict[str, Any]:
    return station.inspect(BAD, "bad-1")


@pytest.fixture(scope="module")
def early(station: Station) -> dict[str, Any]:
    return station.inspect(EARLY, "early-1")


def running(send: Any) -> Any:
    """The inspection that a station's `sweeping` feeds."""
    return send.inspection


def at_frame(seen: Seen, index: int) -> None:
    seen.page.wait_for_selector(f".panes-room[data-frame='{index}']:not([data-loading])")


def test_places_along_the_sweep(seen: Seen) -> None:
    found = seen.open().evaluate(PURE)
    assert found["places"] == pytest.approx([0, 0, 0.1, 0.3, 0.5, 0.7, 0.61, 0.8])
    assert found["order"] == [0, 1, 2, 3, 4, 6, 5, 7]
    assert found["nearest"] == [3, 3, 4, 7]
    assert found["scored"] == [2, 2, 6, 7]
    (gap,) = found["unseen"]
    assert (gap["start"], gap["end"], gap["states"]) == (0.1, 0.61, {"lost": 2})
    assert found["broken"] == [True, False, False, True, True, True, False, False, False]
    assert found["none"] == [-1, [{"start": 0, "end": 1, "states": {}}]]
    assert found["again"] == [False, True, 9]
    assert {name: found["moved"][name] for name in ("x", "y", "width", "height")} == {
        "x": 2, "y": 3, "width": 8, "height": 6
    }  # fmt: skip
    # a turned box is wide enough for all of it
    assert found["turned"]["width"] == pytest.approx(20 * 0.995004 + 10 * 0.099833, abs=1e-4)
    assert found["turned"]["height"] == pytest.approx(10 * 0.995004 + 20 * 0.099833, abs=1e-4)


def test_it_opens_at_the_worst_place_and_says_why(seen: Seen, bad: dict[str, Any]) -> None:
    page = seen.open(address(bad["inspection_id"]), wait=READY)
    (deviation,) = bad["deviations"]
    at_frame(seen, deviation["peak_index"])
    assert seen.texts(".at-head .verdict") == ["✕\nNG"]
    assert seen.texts(".reasons li") == bad["reasons"]
    (row,) = seen.texts(".at-found tbody tr")
    for said in (f"s {deviation['s_start']:.3f}–{deviation['s_end']:.3f}", "appearance", "☀ too bright", "4.16"):
        assert said in row
    facts = page.locator(".at-facts").inner_text()
    for said in (bad["digest"], bad["recipe_id"], bad["appearance_id"], "bad-1", "100.0 %", "39 scored, 0 dropped"):
        assert said in facts
    assert page.locator(".pane canvas").count() == 3
    seen.both("inspection", full=True)


def test_the_difference_is_where_the_defect_is(seen: Seen, bad: dict[str, Any]) -> None:
    with open_camera(f"{LINE}&{BAD}") as camera:
        assert isinstance(camera, SimulatedCamera)
        truth: tuple[FrameTruth, ...] = camera.truth()
    peak = int(bad["deviations"][0]["peak_index"])
    page = seen.open(address(bad["inspection_id"], peak))
    at_frame(seen, peak)
    page.locator(".panes-tools label", has_text="Boxes").click()
    x0, y0, x1, y1 = truth[peak].defects[0].box
    # what this test reads back, nobody else does
    seen.excused = ["willReadFrequently"]
    # the boxes are gone
    page.wait_for_function(f"() => ({INK})('seen').length === 0")
    page.evaluate(NEXT_FRAMES)
    ink = page.evaluate(INK, "difference")
    inside = [(x, y) for x, y in ink if x0 - 4 <= x <= x1 + 4 and y0 - 4 <= y <= y1 + 4]
    assert len(inside) > 0.8 * len(ink) > 0
    page.locator(".panes-tools label", has_text="Difference over").click()
    page.wait_for_function(f"least => ({INK})('seen').length > least", arg=0.5 * len(inside))


def test_the_slider_goes_by_keys_and_the_address_follows(seen: Seen, bad: dict[str, Any]) -> None:
    page = seen.open(address(bad["inspection_id"], 5), wait=".scrub:enabled")
    at_frame(seen, 5)
    page.focus(".scrub")
    for key, frame in (
        ("ArrowRight", 6),
        ("ArrowLeft", 5),
        ("PageDown", 0),
        ("End", 38),
        ("p", 11),
        ("Home", 0),
        ("n", 11),
    ):
        page.keyboard.press(key)
        at_frame(seen, frame)
    assert page.get_attribute(".scrub", "aria-valuetext") == "s 0.291, frame 11, score 4.16"
    page.wait_for_url("**frame=11")
    page.reload()
    at_frame(seen, 11)
    page.click("[aria-label='Next frame (arrow right)']")
    at_frame(seen, 12)
    page.click(".at-found tbody button")
    at_frame(seen, 11)


def test_the_slider_and_the_curve_go_by_pointer(seen: Seen, bad: dict[str, Any]) -> None:
    page = seen.open(address(bad["inspection_id"], 0))
    at_frame(seen, 0)
    middle = min(bad["frames"], key=lambda frame: abs(frame["s"] - 0.5))["index"]
    for selector in (".u-over", ".scrub"):
        box = page.locator(selector).bounding_box()
        assert box is not None
        page.mouse.click(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        at_frame(seen, middle)
        page.keyboard.press("Home")
        page.focus(".scrub")
        page.keyboard.press("Home")
        at_frame(seen, 0)


def test_frames_that_were_not_scored_say_so(seen: Seen, early: dict[str, Any]) -> None:
    unscored = [frame["index"] for frame in early["frames"] if frame["state"] != "scored"]
    page = seen.open(address(early["inspection_id"], unscored[0]))
    at_frame(seen, unscored[0])
    assert "not scored waiting" in page.locator(".readout").inner_text().replace("\n", " ")
    assert "the part has not come into the picture yet" in page.locator(".pane.expected").inner_text()
    assert page.locator(".pane.seen canvas").is_visible()
    assert "4 waiting" in page.locator(".at-facts").inner_text()
    seen.shot("inspection-not-scored", full=True)


def test_it_grows_while_it_runs_and_is_whole_when_it_ends(seen: Seen, station: Station) -> None:
    # A picture that is asked for in the moment of the end is not there any more.
    seen.excused = ["404"]
    with station.sweeping("growing") as send:
        inspection = running(send)
        send(*frames(BAD)[:8])
        page = seen.open(address(inspection.inspection_id), wait=".watched")
        page.wait_for_selector(".at-facts >> text=8 scored")
        page.wait_for_selector(".watched >> text=Frame 7.")
        assert seen.texts(".at-head .verdict") == ["▸\nrunning"]
        send(*frames(BAD)[8:20])
        page.wait_for_selector(".at-facts >> text=20 scored")
        page.wait_for_selector(".readout >> text=19")
        assert "☀ too bright" in page.locator(".at-found tbody").inner_text()
        panel, picture = (page.locator(each).bounding_box() for each in (".panel.sweep", ".pane.seen canvas"))
        assert panel is not None
        assert picture is not None
        assert picture["y"] + picture["height"] < panel["y"] + panel["height"]
        seen.shot("inspection-running", full=True)
        send(*frames(BAD)[20:])
        result = inspection.conclude()
    at_frame(seen, result["deviations"][0]["peak_index"])
    assert seen.texts(".at-head .verdict") == ["✕\nNG"]
    assert seen.texts(".reasons li") == result["reasons"]


def test_what_was_recorded_and_said_can_be_taken_away(seen: Seen, bad: dict[str, Any], tmp_path: Path) -> None:
    page = seen.open(address(bad["inspection_id"]), wait=READY)
    for name, file in (("Recording", "it.mcap"), ("Result", "it.json")):
        with page.expect_download() as download:
            page.click(f".actions >> text={name}")
        assert download.value.suggested_filename.startswith("plate-bad-1-")
        download.value.save_as(tmp_path / file)
    assert len(list(SweepReader(tmp_path / "it.mcap"))) == 39
    assert json.loads((tmp_path / "it.json").read_text()) == bad


def test_it_is_acknowledged_and_replayed(seen: Seen, bad: dict[str, Any]) -> None:
    page = seen.open(address(bad["inspection_id"]), wait=READY)
    page.click("text=Acknowledge >> visible=true")
    page.wait_for_selector(".actions .chip >> text=Acknowledged")
    page.click(".actions >> text=Replay")
    page.wait_for_selector(".chip >> text=not from production")
    at_frame(seen, bad["deviations"][0]["peak_index"])
    assert bad["digest"] in page.locator(".at-facts").inner_text()
    page.click(".chip a")
    page.wait_for_url(f"**{bad['inspection_id']}*")


def test_a_person_overrules_and_the_verdict_stays(look: Callable[..., Seen], station: Station) -> None:
    result = station.inspect(BAD, "judged-1")
    other, seen = look(station.url), look(station.url)
    page = seen.open(address(result["inspection_id"]), wait=READY)
    other.open(address(result["inspection_id"]), wait=READY)
    page.click("text=Overrule: it is OK")
    page.fill("#disposition-comment", "a reflection")
    page.click(".disposition >> text=Save")
    for each in (seen, other):
        said = each.page.locator(".disposition-said")
        said.wait_for()
        assert said.inner_text().startswith("Overruled: OK")
        assert "a reflection" in said.inner_text()
        assert each.texts(".at-head .verdict") == ["✕\nNG"]
        assert "overruled, OK" in each.page.locator(".at-head").inner_text()
    page.click("text=Decide again")
    page.click("text=Confirm: it is NG")
    page.click(".disposition >> text=Save")
    page.wait_for_selector(".disposition-said >> text=Confirmed NG")
    page.click("text=Earlier decisions: 1")
    assert page.inner_text(".disposition-earlier li").startswith("Overruled: OK")
    assert page.inner_text(".disposition-earlier q") == "a reflection"
    seen.shot("inspection-decided", full=True)


def test_every_number_is_there_but_only_rows_in_sight_are_drawn(look: Callable[..., Seen], station: Station) -> None:
    long = GOOD.replace("unit", "pause=200&unit")
    result = station.inspect(long, "long-1")
    assert len(result["frames"]) > 200
    seen = look(station.url)
    page = seen.open(address(result["inspection_id"], 0))
    at_frame(seen, 0)
    page.click("summary >> text=Raw numbers")
    page.wait_for_selector(".vtable-row[aria-rowindex='2']")
    assert 5 < page.locator(".vtable-room .vtable-row").count() < 40
    page.focus(".vtable")
    page.keyboard.press("ArrowDown")
    at_frame(seen, 1)
    page.evaluate("document.querySelector('.vtable').scrollTop = 150 * 32")
    page.wait_for_selector(".vtable-row[aria-rowindex='152']")
    row = page.locator(".vtable-row[aria-rowindex='152']")
    assert row.inner_text().split("\n")[0] == "150"
    row.click()
    at_frame(seen, 150)
    assert page.locator(".vtable-row[aria-selected=true]").count() == 1


def test_stretches_that_were_not_seen_are_listed(seen: Seen, station: Station) -> None:
    half = station.inspect(f"{GOOD}&stop=0.5", "half-1")
    page = seen.open(address(half["inspection_id"]), wait=READY)
    stretch = page.locator(".at-found .unseen li")
    assert stretch.inner_text().endswith("–1.000: no frame came")
    box = stretch.bounding_box()
    assert box is not None
    assert box["width"] > 100


def test_what_is_not_there_is_told(seen: Seen, station: Station) -> None:
    seen.excused = ["404", "410"]
    page = seen.open(address("nobody"), wait=".failed")
    assert "there is no inspection 'nobody'" in page.locator(".failed").inner_text()
    seen.shot("inspection-missing")
    gone = station.inspect(GOOD, "gone-1")
    (station.data / "inspections" / f"{gone['inspection_id']}.mcap").unlink()
    page = seen.open(address(gone["inspection_id"]), wait=READY)
    page.wait_for_selector(".pane-message >> text=No pictures of frame")
    page.wait_for_selector(".pane-message >> text=its file is not where it was kept")
    assert page.locator(".panes").is_hidden()
    seen.shot("inspection-no-recording", full=True)


def test_scores_that_are_not_kept_any_more_are_told_and_the_profile_is_shown(seen: Seen, station: Station) -> None:
    old = station.inspect(BAD, "old-1")
    remove_scores(station.data, old["inspection_id"])
    # Another part, so that not all of the last ones are without scores.
    station.inspect(GOOD, "new-1")
    page = seen.open(address(old["inspection_id"]), wait=".panel.sweep .warning")
    said = page.locator(".panel.sweep").inner_text()
    assert "The scores of its frames are not kept any more (the setting keep_scores_days)" in said
    assert "a replay scores the frames once more" in said
    assert page.locator(".panel.sweep [role=img]").get_attribute("aria-label") == (
        "Highest score in each fiftieth of the sweep, along s, with the limit at 1"
    )
    assert seen.texts(".at-head .verdict") == ["✕\nNG"]
    assert page.locator(".at-found tbody tr").count() == len(old["deviations"])
    assert page.locator(".at-found .unseen").count() == 0
    facts = page.locator(".at-facts").inner_text()
    for fact in ("39 scored, 0 dropped", "removed", old["digest"]):
        assert fact in facts
    assert page.locator(".raw").is_hidden()
    seen.both("inspection-no-scores", full=True)
    page = seen.open(f"#/recipe/{PRODUCT}?tab=policy", wait=".rejudged .warning")
    left_out = "1 of the last parts is left out: the scores of their frames are not kept any more."
    assert seen.texts(".rejudged .warning") == [left_out]
    assert page.locator(".rejudged .headline").is_visible()
    page = seen.open(address(old["inspection_id"]), wait=".panel.sweep .warning")
    page.click(".actions >> text=Replay")
    page.wait_for_selector(".chip >> text=not from production")
    at_frame(seen, old["deviations"][0]["peak_index"])


def test_nothing_came_yet(seen: Seen, station: Station) -> None:
    with station.sweeping("empty") as send:
        page = seen.open(address(running(send).inspection_id), wait=".watched")
        assert "No frame yet." in page.locator(".readout").inner_text()
        assert page.locator(".scrub").is_disabled()
        send(frames(GOOD)[0])
        page.wait_for_selector(".watched >> text=Frame 0.")
