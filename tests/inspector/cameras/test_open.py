"""Choosing a camera by url, and the options that a url can carry."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path

import pytest

from inspector import cameras
from inspector.cameras import open_camera
from inspector.cameras.base import Clock, OptionRefused, UnknownCamera, UnknownOption, hide_password, split_url
from inspector.cameras.folder import FolderOptions
from inspector.cameras.opencv import OpenCVOptions
from inspector.cameras.options import choice, flag, number, numbers, read, whole, words
from inspector.cameras.simulated.settings import Settings


@dataclass(frozen=True)
class Wishes:
    gain: float = number(1.0, 0, 4)
    count: int = whole(3, 1)
    grey: bool = flag()
    path: str = choice("line", "line", "arc")
    place: tuple[float, ...] = words("0,0", lambda text: numbers(text, 2), "dx,dy")


def test_options_that_are_not_told_keep_their_defaults() -> None:
    assert read("test", Wishes, {}) == Wishes(1.0, 3, False, "line", (0.0, 0.0))


def test_options_are_read_by_their_type() -> None:
    query = {"gain": "4", "count": "7", "grey": "1", "path": "arc", "place": "1,-2.5"}
    assert read("test", Wishes, query) == Wishes(4.0, 7, True, "arc", (1.0, -2.5))


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("gain", "4.001", "a number from 0 to 4"),
        ("gain", "nan", "a number from 0 to 4"),
        ("gain", "bright", "a number from 0 to 4"),
        ("count", "0", "a whole number of at least 1"),
        ("count", "1.5", "a whole number of at least 1"),
        ("grey", "maybe", "0 or 1"),
        ("path", "zigzag", "one of line, arc"),
        ("place", "1,2,3", "dx,dy"),
        ("place", "1,inf", "dx,dy"),
    ],
)
def test_a_refused_option_is_named_with_its_value_and_what_is_allowed(name: str, value: str, allowed: str) -> None:
    with pytest.raises(OptionRefused) as refused:
        read("test", Wishes, {name: value})
    assert str(refused.value) == f"camera test: option {name}={value!r} is not allowed; allowed is {allowed}"


def test_an_unknown_option_lists_the_known() -> None:
    with pytest.raises(UnknownOption, match="unknown option 'gian'; known are gain, count, grey, path, place"):
        read("test", Wishes, {"gian": "1"})


@pytest.mark.parametrize("url", ["", "usb:0", "simulate?part=plate", "http://user:secret@host/"])
def test_an_unknown_camera_lists_the_known_and_tells_no_password(url: str) -> None:
    with pytest.raises(UnknownCamera, match="known are simulated, folder, opencv") as refused:
        open_camera(url)
    assert "secret" not in str(refused.value)


@pytest.mark.parametrize(
    ("url", "parts"),
    [
        ("simulated:", ("simulated", "", {})),
        ("folder:/data/a b?fps=5", ("folder", "/data/a b", {"fps": "5"})),
        ("opencv:rtsp://h:554/s?ch=1?", ("opencv", "rtsp://h:554/s?ch=1", {})),
        ("simulated:?defect=", ("simulated", "", {"defect": ""})),
    ],
)
def test_a_url_is_split_at_its_last_question_mark(url: str, parts: tuple[str, str, dict[str, str]]) -> None:
    assert split_url(url) == parts


@pytest.mark.parametrize("url", ["rtsp://host/a@b", "/dev/video0", "0", "C:/a@b"])
def test_an_address_without_a_password_is_shown_as_it_is(url: str) -> None:
    assert hide_password(url) == url


def test_waiting_for_a_time_that_has_passed_does_not_wait() -> None:
    waits: list[float] = []
    clock = Clock(lambda: 5_000_000_000, waits.append)
    clock.wait_until(5_000_000_000)
    clock.wait_until(4_000_000_000)
    clock.wait_until(5_250_000_000)
    assert waits == [0.25]


def test_the_readme_names_every_option_of_every_camera() -> None:
    readme = Path(cameras.__file__).with_name("README.md").read_text()
    sections = dict(zip(cameras.CAMERAS, ("## `simulated:`", "## `folder:", "## `opencv:"), strict=True))
    for (name, heading), options in zip(sections.items(), (Settings, FolderOptions, OpenCVOptions), strict=True):
        section = readme.partition(heading)[2].partition("\n## ")[0]
        missing = [f.name for f in fields(options) if f"`{f.name}`" not in section]
        assert missing == [], name
