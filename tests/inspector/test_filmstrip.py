"""Filmstrips show what should be there, what is, and the difference in its colour, where the regions are."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

from inspector import drawing
from inspector.drawing import View
from inspector.errors import OutputExists
from inspector.filmstrip import (
    CAPTION,
    GAP,
    GUTTER,
    HEADER,
    TILE,
    Shot,
    chosen,
    filmstrips,
    peak_of,
    strip,
    write_filmstrips,
)
from inspector.recording import SweepReader
from inspector.replay import replay
from models.inspection import Explanation
from models.verdict import Deviation, FrameState, Judgement, Region, Residuals, Result, ScoredFrame
from tests.inspector.conftest import Line

SHIFT = (1.0, 0.0, 5.0, 0.0, 1.0, -3.0)
"""The part lies 5 px to the right and 3 px higher in the frame than in the reference."""
NONE = Residuals(0.0, 0.0, 0.0)


def scored(index: int, **changes: object) -> ScoredFrame:
    frame = ScoredFrame(index, index, FrameState.SCORED, index / 100, 0.2, 1.0, NONE, (), index, SHIFT)
    return replace(frame, **changes)


def strip_of_a_dark_spot() -> np.ndarray:
    """A spot of 16x12 px at (64, 48) of the reference, in its box of the frame."""
    expected = np.full((120, 160), 200, np.uint8)
    seen = expected.copy()
    seen[48:60, 64:80] = 90
    region = Region(69, 45, 16, 12, 3.0, "dark")
    peak = scored(50, score=3.0, regions=(region,))
    frames = tuple(peak if n == 50 else scored(n) for n in range(100))
    deviation = Deviation(0.48, 0.53, 48, 53, "appearance", "dark", 3.0, 50, (region,))
    result = Result(Judgement.NG, (), 1.0, 100, 0, (deviation,), "", "", frames)
    difference = seen.astype(np.float32) - expected
    shots = [
        Shot(peak, Explanation(expected, seen, difference, SHIFT)),
        Shot(scored(60), Explanation(expected, expected, np.zeros_like(difference), SHIFT)),
    ]
    return strip(result, deviation, shots, "part 7")


def tile(picture: np.ndarray, row: int, column: int) -> np.ndarray:
    top, left = HEADER + CAPTION + row * (240 + GAP), GUTTER + column * (TILE + GAP)
    return picture[top : top + 240, left : left + TILE].astype(int)


def test_the_difference_is_blue_where_it_is_darker_and_grey_elsewhere() -> None:
    difference = tile(strip_of_a_dark_spot(), 2, 0)
    inside, outside = difference[102:114, 134:154], difference[:80]
    assert np.all(inside == drawing.DARK)
    assert np.ptp(outside, axis=2).max() == 0
    assert np.ptp(tile(strip_of_a_dark_spot(), 2, 1), axis=2).max() == 0


def test_the_box_is_drawn_where_the_region_lies_on_the_reference() -> None:
    seen = tile(strip_of_a_dark_spot(), 1, 0)
    coloured = np.argwhere(np.ptp(seen, axis=2) > 100)
    assert np.abs(coloured.min(axis=0) - (96, 128)).max() <= 1
    assert np.abs(coloured.max(axis=0) - (120, 160)).max() <= 1
    assert np.ptp(tile(strip_of_a_dark_spot(), 0, 0), axis=2).max() == 0


def test_the_close_up_is_centred_on_the_region_and_larger() -> None:
    dark = np.argwhere(tile(strip_of_a_dark_spot(), 1, 2).mean(axis=2) < 100)
    assert np.abs(dark.mean(axis=0) - (119.5, 159.5)).max() < 3
    assert np.ptp(dark, axis=0).min() > 60


def test_brighter_is_red_and_darker_blue_and_the_noise_grey() -> None:
    difference = np.array([[-90, -30, -2, 0, 2, 30, 90]], np.float32)
    colours = drawing.difference_picture(difference, np.zeros((1, 7), np.uint8), 60).astype(int)[0]
    assert tuple(colours[0]) == drawing.DARK
    assert tuple(colours[-1]) == drawing.BRIGHT
    assert np.ptp(colours[2:5], axis=1).max() == 0
    assert colours[1, 0] > colours[1, 2]
    assert colours[5, 2] > colours[5, 0]


def test_of_several_channels_the_one_that_differs_most_counts() -> None:
    assert drawing.signed(np.array([[[1, -9, 3], [0, 2, 1]]], np.float32)).tolist() == [[-9, 2]]


def test_a_view_puts_pixels_where_it_says() -> None:
    picture = np.zeros((60, 80), np.uint8)
    picture[20:24, 40:44] = 255
    for view in (View.whole(picture, 160), View.whole(picture, 160).about(42, 22, 30)):
        bright = np.argwhere(view.picture(picture) > 127)
        x, y = view.points(np.array([[42.0, 22.0]]))[0]
        assert np.abs(bright.mean(axis=0) + 0.5 - (y, x)).max() < 1.0


def test_a_closer_view_stays_within_the_picture() -> None:
    whole = View.whole(np.zeros((60, 80), np.uint8), 160)
    assert whole.about(1, 59, 30).corner == (0.0, 30.0)
    assert whole.about(40, 30, 1000) == whole


def test_the_peak_is_among_the_frames_shown_and_none_that_was_not_compared() -> None:
    frames = [scored(n, reference=-1 if n % 2 else n) for n in range(60)]
    lost = [replace(frame, state=FrameState.LOST) for frame in frames]
    deviation = Deviation(0.0, 0.1, 4, 20, "appearance", "dark", 2.0, 6)
    assert chosen(deviation, frames) == (0, 6, 14, 22)
    assert chosen(deviation, lost) == ()


def test_a_strip_for_each_deviation_and_none_for_a_good_part(line: Line, tmp_path: Path) -> None:
    for path, name in ((line.spot, "spot"), (line.good, "good")):
        recording = SweepReader(path)
        result = replay(recording, line.appearance).result
        written = list(write_filmstrips(tmp_path / name, recording, line.appearance, result, name))
        assert len(written) == len(result.deviations)
        assert sorted((tmp_path / name).glob("*")) == sorted(written)
    picture = cv2.imread(str(tmp_path / "spot" / "spot-1.png"))
    assert picture is not None
    assert picture.shape[0] > 3 * 240
    assert picture.shape[1] > 4 * TILE


def test_a_good_part_can_be_shown_at_its_peak(line: Line) -> None:
    recording = SweepReader(line.good)
    result = replay(recording, line.appearance).result
    peak = peak_of(result)
    assert peak is not None
    assert peak.peak_score == max(frame.score for frame in result.frames)
    assert peak not in result.deviations
    [(number, picture)] = filmstrips(recording, line.appearance, result, [peak], "good", around=(-1, 0, 1))
    assert (number, picture.shape[1]) == (1, GUTTER + 3 * (TILE + GAP))


def test_a_bad_part_is_shown_at_its_highest_deviation_and_a_blind_one_not_at_all(line: Line) -> None:
    result = replay(SweepReader(line.spot), line.appearance).result
    peak = peak_of(result)
    assert peak in result.deviations
    assert peak == max(result.deviations, key=lambda each: each.peak_score)
    lost = tuple(replace(frame, state=FrameState.LOST) for frame in result.frames)
    assert peak_of(replace(result, deviations=(), frames=lost)) is None


def test_strips_are_never_overwritten(line: Line, tmp_path: Path) -> None:
    recording = SweepReader(line.spot)
    result = replay(recording, line.appearance).result
    (tmp_path / "spot-7.png").write_bytes(b"mine")
    with pytest.raises(OutputExists, match=r"spot-7\.png"):
        next(write_filmstrips(tmp_path, recording, line.appearance, result, "spot"))
    assert [path.read_bytes() for path in tmp_path.iterdir()] == [b"mine"]
