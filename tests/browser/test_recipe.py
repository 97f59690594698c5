"""The recipe view: sliders that judge the last parts again, versions with their trail, golden sweeps, masks."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from threading import Event
from typing import Any

import pytest

from inspector.cameras import open_camera
from inspector.recorder import record
from models.verdict import ALLOWED, Policy
from tests import patience
from tests.api.stations import BAD, GOOD, PRODUCT, material
from tests.browser.conftest import Seen, Station

RECIPE = f"#/recipe/{PRODUCT}"
QUICK = "simulated:?frames=22&size=240x180&part=plate&path=line&pace=0.5"
FAINT = "unit=7&seed=7&defect=spot&at=0.5&strength=0.5"


@pytest.fixture(scope="module", autouse=True)
def inspected(station: Station) -> list[dict[str, Any]]:
    """Parts whose verdicts the sliders move."""
    return [station.inspect(options, f"{i:04}") for i, options in enumerate((GOOD, BAD, FAINT, "unit=5&seed=5"), 1)]


def ask(station: Station, path: str, **body: Any) -> Any:
    path = f"{station.url}/v1/products/{PRODUCT}{path}"
    return (patience.post(path, json=body) if body else patience.get(path)).json()


def rejudged(seen: Seen, changed: int) -> None:
    seen.page.wait_for_selector(f".rejudged[aria-busy=false] .headline[data-changed='{changed}']")


def test_the_fields_are_those_of_a_policy(seen: Seen) -> None:
    page = seen.open(RECIPE)
    fields = page.evaluate("async () => (await import('/dashboard/js/views/recipe/fields.js')).FIELDS")
    assert {each["name"]: (each["low"], each["high"]) for each in fields} == ALLOWED
    assert {each["name"]: each["usual"] for each in fields} == asdict(Policy())


def test_a_moved_threshold_changes_verdicts_as_predicted_and_is_saved_with_a_note(
    seen: Seen, station: Station, inspected: list[dict[str, Any]]
) -> None:
    page = seen.open(RECIPE, wait=".rejudged .headline")
    rejudged(seen, 0)
    assert page.locator("text=Save version 2 and inspect by it").is_disabled()
    predicted = ask(station, "/rejudge", policy={"sensitivity": 0.1})
    assert [each["verdict"] for each in inspected].count("NG") >= 1
    assert predicted["counts"]["now"].keys() == {"OK"}
    page.locator("#policy-sensitivity").focus()
    page.keyboard.press("Home")
    rejudged(seen, predicted["changed"])
    row = page.locator(".changes tbody tr").first
    assert "NG" in row.inner_text()
    assert "OK" in row.inner_text()
    seen.both("recipe-policy")
    page.fill("#recipe-note", "spots are allowed")
    page.click("text=Save version 2 and inspect by it")
    page.wait_for_selector(".news >> text=Version 2 is saved")
    active = ask(station, "")["active_recipe"]
    assert (active["version"], active["note"], active["policy"]["sensitivity"]) == (2, "spots are allowed", 0.1)
    assert station.inspect(BAD, "0009")["verdict"] == "OK"


def test_a_number_that_is_not_allowed_is_said_and_not_saved(seen: Seen) -> None:
    page = seen.open(RECIPE, wait=".rejudged .headline")
    number = page.get_by_label("False-reject target in percent")
    number.fill("60")
    page.wait_for_selector("text=allowed are 0.01 % to 50 %")
    assert page.locator(".save button.main").is_disabled()
    number.fill("5")
    page.wait_for_selector(".save button.main:not([disabled])")


def test_an_older_version_is_made_active_and_the_trail_tells_before_and_after(seen: Seen, station: Station) -> None:
    page = seen.open(f"{RECIPE}?tab=versions", wait=".trail tbody tr")
    page.get_by_label("Activate version 1").click()
    page.wait_for_selector(".news >> text=Version 1 is active")
    page.wait_for_selector(".trail >> text=activated version 1 in place of 2")
    assert "Sensitivity 0.1 × → 1 ×" in page.locator(".trail tbody tr").first.inner_text()
    assert ask(station, "")["active_recipe"]["version"] == 1
    seen.both("recipe-versions")


def test_tabs_are_walked_through_by_keyboard(seen: Seen) -> None:
    page = seen.open(RECIPE, wait="[role=tab]")
    page.locator("#tab-policy").focus()
    page.keyboard.press("ArrowLeft")
    page.wait_for_selector("#tab-versions[aria-selected=true]:focus")
    page.keyboard.press("ArrowRight")
    page.wait_for_selector("#tab-policy[aria-selected=true]:focus")


def test_a_golden_sweep_is_uploaded_and_learnt_from(seen: Seen, station: Station) -> None:
    seen.excused.append("404")
    page = seen.open("#/recipe?new=1", wait="#new-product")
    page.fill("#new-product", "fresh")
    page.click("text=Upload its first golden sweep")
    page.wait_for_selector("text=No sweep yet")
    seen.shot("recipe-new-product")
    page.click("#tab-policy")
    page.click("text=To the golden sweeps")
    page.set_input_files("#sweep-file", material() / "golden.mcap")
    page.fill("#sweep-part", "G2")
    page.click("text=Upload")
    page.wait_for_selector("text=golden.mcap is here")
    page.get_by_label("Learn from sweep of G2").check()
    page.click("text=Learn from 1 sweep")
    page.wait_for_selector(".news >> text=is learnt")
    page.wait_for_selector("text=one golden sweep: limit at 1.00")
    page.click("text=Judge by it")
    page.click("text=Save version 1 and inspect by it")
    page.wait_for_selector(".news >> text=Version 1 is saved")
    page.click("#tab-learning")
    page.wait_for_selector(".speed .uplot")
    page.click("#tab-masks")
    page.wait_for_selector("text=Nearest reference picture")
    page.focus("canvas.picture")
    for key in ("Enter", "Shift+ArrowRight", "Shift+ArrowRight", "Shift+ArrowDown", "Enter"):
        page.keyboard.press(key)
    assert [each.input_value() for each in page.locator("table.masks input").all()] == ["120", "90", "20", "10"]
    page.click("text=Learn with these")
    page.wait_for_selector(".news >> text=is learnt with the masks")
    first, second = patience.get(f"{station.url}/v1/products/fresh/appearances").json()["items"]
    assert first["sweep_ids"] == second["sweep_ids"]
    assert first["appearance_id"] != second["appearance_id"]


def test_while_it_learns_it_says_how_far_it_is_and_then_where_the_sweep_was_too_quick(
    seen: Seen, station: Station, tmp_path: Path
) -> None:
    mcap = {"content-type": "application/octet-stream"}
    for number in (1, 2, 3):
        path = tmp_path / f"{number}.mcap"
        with open_camera(f"{QUICK}&unit={number}&seed={number}") as camera:
            record(camera, path, lossless=True)
        address = f"{station.url}/v1/products/quick/sweeps?part_id=G{number}"
        patience.post(address, content=path.read_bytes(), headers=mcap).raise_for_status()
    page = seen.open("#/recipe/quick", wait=".sweeps tbody tr")
    for number in (1, 2, 3):
        page.get_by_label(f"Learn from sweep of G{number}").check()
    held, is_seen = list[Any](), Event()

    def hold(route: Any) -> None:
        if is_seen.is_set():
            route.continue_()
        else:
            held.append(route)

    # However quick it is, it is not over before it was seen.
    page.route("**/v1/jobs/*", hold)
    page.click("text=Learn from 3 sweeps")
    page.wait_for_selector(".job progress")
    seen.shot("recipe-learning", full=True)
    is_seen.set()
    for route in held:
        route.continue_()
    page.wait_for_selector(".news >> text=is learnt")
    page.wait_for_selector(".advice li >> text=times slower")
    assert "From 3 sweeps" in page.inner_text(".facts").replace("\n", " ")
    seen.both("recipe-golden-sweeps", full=True)


def test_products_are_a_list_to_choose_from(seen: Seen) -> None:
    page = seen.open("#/recipe", wait="table.list tbody tr")
    assert {"fresh", "plate", "quick"} <= set(seen.texts("table.list a"))
    seen.both("products")
    page.click("table.list a >> text=quick")
    page.wait_for_url("**#/recipe/quick")
    page.wait_for_selector("text=No version is active")


def test_what_is_no_recording_is_refused_in_words(seen: Seen) -> None:
    page = seen.open(f"{RECIPE}?tab=learning", wait="#sweep-file")
    wrong = {"name": "x.mcap", "mimeType": "application/mcap", "buffer": b"PNG" * 99}
    page.set_input_files("#sweep-file", files=[wrong])
    page.click("text=Upload")
    page.wait_for_selector(".upload .wrong >> text=no MCAP")
    seen.excused.append("422")


def test_who_may_only_look_is_told_why(station: Station, look: Callable[..., Seen]) -> None:
    seen = look(station.url)
    seen.page.route("**/v1/me", lambda route: route.fulfill(json={"actor": "a viewer (1)", "role": "viewer"}))
    page = seen.open(RECIPE, wait="text=Only an engineer may do this; this token has the role viewer.")
    assert page.locator("#policy-sensitivity").is_disabled()
    assert page.locator(".save button.main").is_disabled()
    seen.shot("recipe-viewer")


def test_a_mask_drawn_with_the_mouse_and_learnt_silences_the_region(seen: Seen, station: Station) -> None:
    before = station.inspect(BAD, "0100")
    assert before["verdict"] == "NG"
    page = seen.open(f"{RECIPE}?tab=masks", wait="text=Nearest reference picture")
    page.check("input[value=excuse]")
    page.locator("#mask-s").fill("0.3")
    page.wait_for_selector("text=/Nearest reference picture: s 0\\.[23]/")
    s = float(page.inner_text("text=/Nearest reference picture: s/").split()[-1])
    frame = min((each for each in before["frames"] if each["regions"]), key=lambda each: abs(each["s"] - s))
    drag(seen, frame["regions"][0], width=240, margin=14)
    page.wait_for_selector("table.masks tbody tr")
    assert page.locator("table.masks tbody tr").count() == 1
    seen.both("recipe-masks", full=True)
    page.click("text=Learn with these")
    page.wait_for_selector(".news >> text=is learnt with the masks")
    page.click(".save button.main")
    page.wait_for_selector(".news >> text=parts are inspected by it from now on")
    assert station.inspect(BAD, "0101")["verdict"] == "OK"
    assert station.inspect(FAINT.replace("strength=0.5", "strength=1"), "0102")["verdict"] == "NG"


def test_masks_that_are_learnt_are_shown_kept_and_taken_away(seen: Seen, station: Station) -> None:
    golden = (material() / "golden.mcap").read_bytes()
    path = f"{station.url}/v1/products/kept"
    mcap = {"content-type": "application/octet-stream"}
    sweep_id = patience.post(f"{path}/sweeps", content=golden, headers=mcap).json()["sweep_id"]
    with station.client() as client:
        learnt = client.learn("kept", [sweep_id])
        client.make_recipe("kept", learnt)

    def newest() -> dict[str, Any]:
        return patience.get(f"{path}/appearances").json()["items"][0]["facts"]

    page = seen.open("#/recipe/kept?tab=masks", wait="text=Nearest reference picture")
    keep = page.get_by_label("Keep what is masked already")
    assert keep.count() == 0
    drawn = """() => document.querySelector("canvas.picture").toDataURL()"""
    for kind in ("excuse", "ignore"):
        page.check(f"input[value={kind}]")
        page.focus("canvas.picture")
        for key in ("Enter", *["Shift+ArrowRight"] * 3, *["Shift+ArrowDown"] * 3, "Enter"):
            page.keyboard.press(key)
        page.click("text=Learn with these")
        page.wait_for_selector(".news >> text=is learnt with the masks")
        page.click("#tab-masks")
        page.wait_for_selector("text=Nearest reference picture")
        assert keep.is_checked()
    facts = newest()
    assert facts["excused_regions"] == "1"
    assert facts["ignored"] == pytest.approx(30 * 30 / (240 * 180), abs=1e-4)
    seen.both("recipe-masks-kept")
    striped = page.evaluate(drawn)
    keep.uncheck()
    page.wait_for_function(f"before => ({drawn})() !== before", arg=striped)
    page.click("text=Learn without masks")
    page.wait_for_selector(".news >> text=is learnt with the masks")
    assert page.get_by_label("Appearance").input_value() == learnt


def drag(seen: Seen, region: dict[str, Any], *, width: int, margin: int) -> None:
    """A rectangle about a region of a picture that is so many pixels wide."""
    bounds = seen.page.locator("canvas.picture").bounding_box()
    assert bounds is not None
    scale = bounds["width"] / width
    corners = [
        (bounds["x"] + scale * (region["x"] - margin), bounds["y"] + scale * (region["y"] - margin)),
        (
            bounds["x"] + scale * (region["x"] + region["width"] + margin),
            bounds["y"] + scale * (region["y"] + region["height"] + margin),
        ),
    ]
    seen.page.mouse.move(*corners[0])
    seen.page.mouse.down()
    seen.page.mouse.move(*corners[1], steps=4)
    seen.page.mouse.up()


def test_what_somebody_else_activates_is_offered_and_does_not_move_the_sliders(seen: Seen, station: Station) -> None:
    page = seen.open(RECIPE, wait=".rejudged .headline")
    page.wait_for_selector("#station[data-state=ready]")
    page.get_by_label("False-reject target in percent").fill("7")
    made = ask(station, "/recipes", policy={"coverage": 0.9}, note="elsewhere")
    page.wait_for_selector(f".news >> text=Version {made['version']} is active now.")
    assert page.get_by_label("False-reject target in percent").input_value() == "7"
    page.click("text=Show it")
    page.wait_for_selector(".headline-row >> text=elsewhere")
