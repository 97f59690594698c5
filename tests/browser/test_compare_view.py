"""Two sweeps side by side: matched by their place on the part, whatever their pace; chosen from what there is."""

from __future__ import annotations

import re
from typing import Any

import pytest

from tests import patience
from tests.api.stations import BAD, GOOD, PRODUCT, frames, material, remove_scores, sweep
from tests.browser.conftest import Seen, Station

SLOW = f"{GOOD}&pause=12"
MCAP = {"content-type": "application/octet-stream"}


@pytest.fixture(scope="module")
def bad(station: Station) -> dict[str, Any]:
    return station.inspect(BAD, "bad-2")


@pytest.fixture(scope="module")
def slow(station: Station) -> dict[str, Any]:
    """A good part, whose sweep stood still for a while: the same places at other times."""
    return station.inspect(SLOW, "slow-2")


def shown(seen: Seen, frame: int) -> None:
    seen.page.wait_for_selector(f".panes[data-frame='{frame}']:not([data-loading])")


def test_sweeps_are_matched_by_place(seen: Seen, bad: dict[str, Any], slow: dict[str, Any]) -> None:
    page = seen.open(f"#/compare/{bad['inspection_id']}/{slow['inspection_id']}", wait=".panes[data-frame]")
    page.focus(".scrub")
    page.keyboard.press("End")
    last = len(bad["frames"]) - 1
    shown(seen, last)
    at = bad["frames"][last]["s"]
    match = min(
        (frame for frame in slow["frames"] if frame["state"] == "scored"), key=lambda frame: abs(frame["s"] - at)
    )
    assert match["index"] >= last + 10
    said = page.locator(".readout").inner_text()
    assert f"A, frame {last}" in said
    assert f"B, frame {match['index']}" in said
    assert page.locator(".pane.b figcaption").inner_text() == f"B: frame {match['index']}"
    page.wait_for_url(f"**?s={at:.4f}")
    page.reload()
    shown(seen, last)


def test_the_difference_shows_what_only_one_has(seen: Seen, bad: dict[str, Any], slow: dict[str, Any]) -> None:
    page = seen.open(f"#/compare/{bad['inspection_id']}/{slow['inspection_id']}", wait=".panes[data-frame]")
    peak = bad["deviations"][0]
    middle = (peak["s_start"] + peak["s_end"]) / 2
    shown(seen, min(bad["frames"], key=lambda frame: abs(frame["s"] - middle))["index"])
    assert page.locator(".pane canvas").count() == 3
    assert page.locator(".pane canvas >> visible=true").count() == 3
    assert [each.split("\n")[1] for each in seen.texts(".side .verdict")] == ["NG", "OK"]
    seen.both("compare", full=True)
    page.click("text=Half and half")
    page.locator(".split").fill("0.3")
    seen.shot("compare-halves", full=True)
    page.click("text=Change sides")
    page.wait_for_url(f"**#/compare/{slow['inspection_id']}/{bad['inspection_id']}*")


def test_a_sweep_whose_scores_are_not_kept_any_more_says_so(seen: Seen, station: Station, bad: dict[str, Any]) -> None:
    old = station.inspect(GOOD, "old-2")
    remove_scores(station.data, old["inspection_id"])
    for sides, name in ((old, bad), "A"), ((bad, old), "B"):
        seen.open("#/compare/" + "/".join(each["inspection_id"] for each in sides), wait=".warning")
        said = f"The scores of the frames of {name} are not kept any more: there is nothing to match."
        assert seen.texts(".warning") == [f"{said} A replay of its recording has them."]
    seen.shot("compare-no-scores")


def test_another_sweep_is_chosen_from_the_product(seen: Seen, bad: dict[str, Any], slow: dict[str, Any]) -> None:
    page = seen.open(f"#/inspection/{bad['inspection_id']}", wait=".panes-room[data-frame]")
    page.click("text=Compare with")
    page.wait_for_selector("dialog.picker tbody tr")
    assert page.locator("dialog.picker tbody >> text=bad-2").count() == 0
    seen.shot("compare-choose")
    page.click("dialog.picker tbody >> text=slow-2")
    page.wait_for_url(f"**#/compare/{bad['inspection_id']}/{slow['inspection_id']}*")
    page.wait_for_selector(".panes[data-frame]")


def test_a_golden_sweep_is_replayed_for_it(seen: Seen, station: Station, bad: dict[str, Any]) -> None:
    golden = (material() / "golden.mcap").read_bytes()
    kept = patience.post(f"{station.url}/v1/products/{PRODUCT}/sweeps", content=golden, headers=MCAP).json()
    page = seen.open(f"#/compare/{bad['inspection_id']}", wait="dialog.picker tbody tr")
    page.click("text=Sweeps that are kept")
    page.click(f"dialog.picker tbody >> text={kept['sweep_id'][:8]}")
    page.wait_for_selector(".panes[data-frame]")
    assert f"Replay of sweep {kept['sweep_id'][:8]}" in page.locator(".side.b").inner_text()
    assert page.locator(".side.b .verdict").inner_text() == "✓\nOK"


def test_what_one_sweep_does_not_show_is_said(seen: Seen, station: Station, bad: dict[str, Any]) -> None:
    half = station.inspect(f"{GOOD}&stop=0.5", "half-2")
    page = seen.open(f"#/compare/{bad['inspection_id']}/{half['inspection_id']}?s=0.95", wait=".panes[data-frame]")
    page.wait_for_selector(".pane.b .pane-message >> text=B has no scored frame within 0.02 of s")
    page.wait_for_selector(".pane.difference .pane-message >> text=Both must show this place")
    seen.shot("compare-unseen", full=True)


def test_one_that_runs_says_so_and_is_whole_when_it_has_ended(
    seen: Seen, station: Station, bad: dict[str, Any]
) -> None:
    # What is not recorded yet has no pictures.
    seen.excused = ["409"]
    with station.sweeping("running-2") as send:
        running = send.inspection  # type: ignore[attr-defined]
        send(*frames(GOOD)[:9])
        page = seen.open(f"#/compare/{bad['inspection_id']}/{running.inspection_id}?s=0.1", wait=".warning")
        page.wait_for_selector(".warning >> text=B is still running: what is here of it are its first 9 frames")
        page.wait_for_selector("html[data-connection=live]")
        send(*frames(GOOD)[9:])
        running.conclude()
    page.wait_for_selector(".side.b .verdict.ok")
    assert page.locator(".warning").count() == 0


def test_a_sweep_that_is_not_there_is_told(seen: Seen, bad: dict[str, Any]) -> None:
    seen.excused = ["404"]
    page = seen.open(f"#/compare/{bad['inspection_id']}/nobody", wait=".failed")
    assert "there is no inspection 'nobody'" in page.locator(".failed").inner_text()


def test_another_appearance_is_warned_of(seen: Seen, station: Station, bad: dict[str, Any]) -> None:
    """The same sweep, replayed by what was learnt from another part: s is not quite the same place."""
    with station.client() as client:
        sweep_id = client.upload_sweep(sweep(GOOD), PRODUCT)
        recipe_id = client.make_recipe(PRODUCT, client.learn(PRODUCT, [sweep_id]))
    asked = {"inspection_id": bad["inspection_id"], "recipe_id": recipe_id}
    again = patience.post(f"{station.url}/v1/replays", json=asked).json()
    page = seen.open(f"#/compare/{bad['inspection_id']}/{again['inspection_id']}", wait=".panes[data-frame]")
    assert "different appearances" in page.locator(".warning").inner_text()
    assert "different pictures of the part" in page.locator(".pane.difference").inner_text()
    seen.shot("compare-unlike")
    page.click("text=Replay B by the recipe of A")
    page.wait_for_selector(".warning", state="detached")
    page.wait_for_selector(".panes[data-frame]")
    assert again["inspection_id"] not in page.url
    assert page.locator(".warning").count() == 0


def test_without_a_sweep_it_asks_for_a_product(seen: Seen, bad: dict[str, Any]) -> None:
    page = seen.open("#/compare", wait="h1")
    page.click(f"main button >> text={PRODUCT}")
    page.click("dialog.picker tbody >> text=bad-2")
    page.wait_for_url(re.compile("#/compare/[0-9a-f]{32}$"))
    page.wait_for_selector(".side >> text=bad-2")
