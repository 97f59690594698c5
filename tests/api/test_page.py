"""The dashboard as files: served by name, with a policy that lets them ask nobody else, and shipped as they are."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Iterator
from pathlib import Path

import pytest
from fastapi.testclient import TestClient

from api.app import create_app
from api.page import FOLDER, read_files
from inspector.settings import read_settings

OWN = {name: file.body.decode() for name, file in read_files().items() if not name.startswith("vendor/")}


@pytest.fixture(scope="module")
def client(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TestClient]:
    # Where tokens are asked for, the page comes without one: it is what asks for it.
    settings = read_settings(data=tmp_path_factory.mktemp("page") / "data", scorers=1, require_token=True)
    with TestClient(create_app(settings), base_url="http://127.0.0.1") as client:
        yield client


def test_the_page_is_at_the_root_and_may_ask_nobody_else(client: TestClient) -> None:
    answer = client.get("/")
    assert answer.headers["content-type"] == "text/html; charset=utf-8"
    policy = answer.headers["content-security-policy"]
    assert policy.startswith("default-src 'self'; ")
    assert "unsafe" not in policy
    assert "://" not in policy


def test_every_file_that_the_page_names_is_there(client: TestClient) -> None:
    for named in re.findall(r'(?:href|src)="(/[^"]*)"', client.get("/").text):
        answer = client.get(named)
        assert answer.status_code == 200, named
        assert client.get(named, headers={"if-none-match": answer.headers["etag"]}).status_code == 304
        assert client.head(named).headers["content-length"] == str(len(answer.content))


@pytest.mark.parametrize("name", ["none.js", "vendor/uplot/README.md", "../page.py", "%2e%2e/page.py", "js", ""])
def test_nothing_else_is_served(client: TestClient, name: str) -> None:
    answer = client.get(f"/dashboard/{name}")
    assert answer.status_code == 404
    assert answer.headers["content-type"] == "application/problem+json"


def test_no_script_or_style_stands_in_the_page() -> None:
    assert not re.search(r"<style|<script(?![^>]*src=)|\son\w+=|\sstyle=", OWN["index.html"])


@pytest.mark.parametrize("name", sorted(OWN))
def test_no_file_names_another_host_and_none_makes_html_of_text(name: str) -> None:
    named = re.findall(r"https?://[^\s\"'`<>)]*", OWN[name])
    assert [each for each in named if each != "http://www.w3.org/2000/svg"] == []
    assert not re.search(r"innerHTML|outerHTML|insertAdjacentHTML|\beval\(|new Function|document\.write", OWN[name])


def test_every_import_is_a_file_of_the_dashboard() -> None:
    for name, text in OWN.items():
        for other in re.findall(r'^import [^"]*"([^"]+)";', text, re.MULTILINE) if name.endswith(".js") else []:
            assert ((FOLDER / name).parent / other).is_file(), f"{name}: {other}"


def test_every_screenshot_is_small_and_shown() -> None:
    shown = set(re.findall(r"\(screenshots/([^)]+)\)", (FOLDER / "README.md").read_text()))
    files = {path.name: path.stat().st_size for path in (FOLDER / "screenshots").iterdir()}
    assert shown == files.keys()
    assert [name for name, size in files.items() if size > 120_000] == []


def test_all_that_the_line_view_is_made_of_is_fetched_at_once() -> None:
    """And nothing else: without it the browser learns of a module only from the one that imports it."""
    preloaded = set(re.findall(r'rel="modulepreload" href="/dashboard/([^"]+)"', OWN["index.html"]))
    needed, found = ["js/app.js", "js/views/line.js"], set[str]()
    while needed:
        name = needed.pop()
        if name not in found:
            found.add(name)
            others = re.findall(r'^import [^"]*"([^"]+)";', OWN.get(name, ""), re.MULTILINE)
            needed += [((FOLDER / name).parent / other).resolve().relative_to(FOLDER).as_posix() for other in others]
    assert preloaded == found - {"js/app.js"}


def test_what_others_wrote_is_as_they_published_it() -> None:
    folder: Path = FOLDER / "vendor" / "uplot"
    told = dict(re.findall(r"\| `(\S+)` \| `([0-9a-f]{64})` \|", (folder / "README.md").read_text()))
    found = {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in folder.glob("uPlot*")}
    assert told == found
    assert "The MIT License" in (folder / "LICENSE").read_text()
