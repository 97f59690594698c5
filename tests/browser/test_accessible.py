"""For every eye and hand: contrast as WCAG AA asks, in both themes, and each view within reach of the keyboard."""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Any

import pytest

from api.page import FOLDER
from tests.api.stations import BAD, GOOD, PRODUCT
from tests.browser.conftest import NEXT_FRAMES, Seen, Station

TEXT, LARGE_OR_LINE = 4.5, 3.0
"""WCAG 2.2, 1.4.3 and 1.4.11: text, and what is large, or a line, a mark, the edge of a control."""
GROUNDS = ("--ground", "--panel", "--raised")
WORDS = (
    "--ink", "--ink-2", "--ok-ink", "--ng-ink", "--review-ink", "--incomplete-ink", "--invalid-ink", "--limit",
    "--bright", "--dark",
)  # fmt: skip
LINES = ("--score", "--appearance", "--position", "--timing", "--other", "--limit", "--focus", "--accent", "--edge")
WHITE_ON = ("--ok", "--ng", "--incomplete", "--invalid", "--running")
SEEN_TEXT = """() => {
    const parse = text => {
        const [r, g, b, a = 1] = text.match(/[\\d.]+/g).map(Number);
        return [r, g, b, a];
    };
    const over = (top, below) => top.map((each, i) => i === 3 ? 1 : each * top[3] + below[i] * (1 - top[3]));
    const light = ([r, g, b]) => {
        const [x, y, z] = [r, g, b].map(each => each / 255).map(
            each => each <= 0.04045 ? each / 12.92 : ((each + 0.055) / 1.055) ** 2.4);
        return 0.2126 * x + 0.7152 * y + 0.0722 * z;
    };
    const ground = node => {
        const own = node ? parse(getComputedStyle(node).backgroundColor) : [255, 255, 255, 1];
        return own[3] >= 1 ? own : over(own, ground(node.parentElement));
    };
    const found = new Set();
    const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
    while (walker.nextNode()) {
        const node = walker.currentNode.parentElement;
        if (!walker.currentNode.textContent.trim()) continue;
        if (node.closest("script, svg, option, .for-readers, .skip")) continue;
        if (!node.checkVisibility({ visibilityProperty: true })) continue;
        if (node.matches(":disabled, :disabled *")) continue;
        const style = getComputedStyle(node);
        const below = ground(node);
        const [one, other] = [light(over(parse(style.color), below)), light(below)].sort((a, b) => b - a);
        const ratio = (one + 0.05) / (other + 0.05);
        const size = parseFloat(style.fontSize);
        const large = size >= 24 || (size >= 18.66 && Number(style.fontWeight) >= 700);
        if (ratio < (large ? 3 : 4.5)) found.add(`${walker.currentNode.textContent.trim()}: ${ratio.toFixed(2)}`);
    }
    return [...found];
}"""
"""Every text in sight whose contrast with what lies behind it is too low."""
STOPS = """() => {
    const usual = "a[href], button, input, select, textarea, summary, [tabindex='0']";
    const groups = new Set();
    const found = [];
    for (const node of document.querySelectorAll(usual)) {
        if (node.tabIndex < 0 || node.matches(":disabled") || !node.checkVisibility()) continue;
        if (node.type === "radio") {
            const all = [...document.querySelectorAll(`input[type=radio][name="${node.name}"]`)];
            if (groups.has(node.name) || (all.some(each => each.checked) && !node.checked)) continue;
            groups.add(node.name);
        }
        node.dataset.stop = String(found.length);
        found.push(node.outerHTML.slice(0, 120));
    }
    return found;
}"""
"""Marks and tells what the Tab key has to come to."""
NAMELESS = """() => {
    const all = document.querySelectorAll("button, input, select, textarea, canvas, a");
    const named = each => each.textContent.trim() || each.ariaLabel || each.labels?.length || each.title;
    return [...all].filter(each => each.checkVisibility() && !named(each) && !each.closest("[role=img][aria-label]"))
        .map(each => each.outerHTML);
}"""
"""What has neither words nor a name."""
STANDS = """() => {
    const node = document.activeElement;
    const { outlineStyle, outlineWidth } = getComputedStyle(node);
    return [node.dataset.stop ?? null, outlineStyle !== "none" && parseFloat(outlineWidth) >= 2];
}"""


def variables(block: str) -> dict[str, str]:
    return dict(re.findall(r"(--[\w-]+):\s*(#[0-9a-f]{6})\b", block))


def themes() -> dict[str, Mapping[str, str]]:
    """The colours of both, as the style sheet has them."""
    sheet = (FOLDER / "style.css").read_text()
    light, system_dark, dark, badges = (
        variables(block) for block in re.findall(r":root[^{]*\{([^}]*--[^}]*)\}", sheet)
    )
    assert system_dark == dark
    assert light.keys() == dark.keys()
    return {"light": light | badges, "dark": dark | badges}


def luminance(colour: str) -> float:
    shares = [int(colour[at : at + 2], 16) / 255 for at in (1, 3, 5)]
    red, green, blue = (each / 12.92 if each <= 0.04045 else ((each + 0.055) / 1.055) ** 2.4 for each in shares)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: str, other: str) -> float:
    high, low = sorted((luminance(one), luminance(other)), reverse=True)
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", ["light", "dark"])
def test_colours_keep_the_contrast_of_wcag_aa(theme: str) -> None:
    assert contrast("#000000", "#ffffff") == pytest.approx(21)
    colours = themes()[theme]
    pairs = [
        *((word, ground, TEXT) for word in WORDS for ground in GROUNDS),
        *((line, ground, LARGE_OR_LINE) for line in LINES for ground in GROUNDS),
        ("--accent-ink", "--accent", TEXT),
        ("--warn-ink", "--warn", TEXT),
        ("--ink", "--warn", TEXT),
    ]
    found = [(one, other, contrast(colours[one], colours[other])) for one, other, _ in pairs]
    found += [("white", name, contrast("#ffffff", colours[name])) for name in WHITE_ON]
    found += [("black", "--review", contrast("#1a1200", colours["--review"]))]
    least = [*(each for _, _, each in pairs), *[TEXT] * (len(WHITE_ON) + 1)]
    assert [each for each, enough in zip(found, least, strict=True) if each[2] < enough] == []


@pytest.fixture(scope="module")
def parts(station: Station) -> dict[str, Any]:
    return {name: station.inspect(options, name)["inspection_id"] for name, options in (("bad", BAD), ("good", GOOD))}


VIEWS = {
    "line": ("#/", ".lane[data-verdict] .caption"),
    "inspections": ("#/inspections", ".inspection-list .verdict"),
    "none of them": ("#/inspections?verdict=REVIEW", ".listing .empty"),
    "inspection": ("#/inspection/{bad}", ".panes-room[data-frame]"),
    "compare": ("#/compare/{bad}/{good}", ".panes[data-frame]"),
    "policy": (f"#/recipe/{PRODUCT}?tab=policy", ".rejudged[aria-busy=false] .headline"),
    "golden sweeps": (f"#/recipe/{PRODUCT}?tab=learning", ".speed .uplot"),
    "masks": (f"#/recipe/{PRODUCT}?tab=masks", "text=Nearest reference picture"),
    "versions": (f"#/recipe/{PRODUCT}?tab=versions", ".trail tbody tr"),
    "trends": (f"#/trends/{PRODUCT}", ".figures"),
    "products": ("#/recipe?new=1", "#new-product"),
    "no view": ("#/nowhere", ".failed"),
}


@pytest.mark.parametrize("view", VIEWS)
def test_every_view_is_read_by_all_and_reached_by_keyboard(seen: Seen, parts: dict[str, Any], view: str) -> None:
    hash, there = VIEWS[view]
    page = seen.open(hash.format(**parts), wait=there)
    page.wait_for_selector("#station[data-state=ready]")
    assert page.evaluate(SEEN_TEXT.replace("4.5)", "22)"))
    for theme in ("dark", "light"):
        page.emulate_media(color_scheme=theme)  # type: ignore[arg-type]
        page.evaluate(NEXT_FRAMES)
        assert page.evaluate(SEEN_TEXT) == [], theme
    wanted = page.evaluate(STOPS)
    page.evaluate("document.activeElement.blur()")
    reached = dict[str, bool]()
    for _ in range(len(wanted) + 3):
        page.keyboard.press("Tab")
        stop, marked = page.evaluate(STANDS)
        if stop is not None:
            reached[stop] = marked
    assert [each for number, each in enumerate(wanted) if str(number) not in reached] == []
    assert [wanted[int(stop)] for stop, marked in reached.items() if not marked] == []
    assert page.evaluate(NAMELESS) == []
