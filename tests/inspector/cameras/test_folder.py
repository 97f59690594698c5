"""A folder of pictures as a camera."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from inspector.cameras import Clock, open_camera
from inspector.cameras.base import CameraNotOpened, CameraStopped, OptionRefused
from tests.contracts.cameras import ONE_SENTENCE, CameraContract


def picture(brightness: int) -> np.ndarray:
    """A grey ramp that begins at a brightness."""
    return (np.arange(12 * 16, dtype=np.uint8) // 8 + brightness).reshape(12, 16)


def write(folder: Path, names: list[str]) -> Path:
    """Pictures under these names, the k-th of brightness 20 k."""
    for k, name in enumerate(names):
        assert cv2.imwrite(str(folder / name), picture(20 * k))
    return folder


class TestFolderContract(CameraContract):
    @pytest.fixture
    def url(self, tmp_path: Path) -> str:
        return f"folder:{write(tmp_path, ['1.jpg', '2.jpg', '3.png', '4.tiff'])}"


def test_pictures_come_in_the_order_that_a_person_would_count(tmp_path: Path) -> None:
    write(tmp_path, ["img10.png", "img2.png", "img1.png", "IMG3.png"])
    frames = list(open_camera(f"folder:{tmp_path}").frames())
    assert [int(frame.pixels[0, 0]) for frame in frames] == [40, 20, 60, 0]
    assert [frame.sequence for frame in frames] == [0, 1, 2, 3]


def test_lossless_pictures_keep_pixels_and_bytes(tmp_path: Path) -> None:
    deep = np.arange(12 * 16, dtype=np.uint16).reshape(12, 16) * 300
    cv2.imwrite(str(tmp_path / "a.png"), deep)
    cv2.imwrite(str(tmp_path / "b.bmp"), np.dstack([picture(0), picture(50), picture(100)]))
    first, second = open_camera(f"folder:{tmp_path}").frames()
    np.testing.assert_array_equal(first.pixels, deep)
    np.testing.assert_array_equal(second.pixels, np.dstack([picture(0), picture(50), picture(100)]))
    assert [f.encoded and (f.encoded.format, f.encoded.data) for f in (first, second)] == [
        ("png", (tmp_path / "a.png").read_bytes()),
        ("bmp", (tmp_path / "b.bmp").read_bytes()),
    ]


def test_the_format_is_what_the_bytes_are_not_what_the_name_says(tmp_path: Path) -> None:
    write(tmp_path, ["a.png"])
    (tmp_path / "a.png").rename(tmp_path / "a.jpg")
    (frame,) = open_camera(f"folder:{tmp_path}").frames()
    assert frame.encoded is not None
    assert frame.encoded.format == "png"


def test_the_pattern_chooses_and_other_files_are_left_alone(tmp_path: Path) -> None:
    write(tmp_path, ["left_1.png", "right_1.png", "left_2.png"])
    (tmp_path / "left_notes.txt").write_text("no picture")
    frames = list(open_camera(f"folder:{tmp_path}?pattern=left_*").frames())
    assert [int(frame.pixels[0, 0]) for frame in frames] == [0, 40]


def test_frames_are_spaced_by_fps_from_the_first_picture_s_time(tmp_path: Path) -> None:
    write(tmp_path, ["a.png", "b.png", "c.png"])
    written = (tmp_path / "a.png").stat().st_mtime_ns
    times = [frame.t_ns - written for frame in open_camera(f"folder:{tmp_path}?fps=8").frames()]
    assert times == [0, 125_000_000, 250_000_000]


def test_realtime_waits_between_pictures(tmp_path: Path) -> None:
    write(tmp_path, ["a.png", "b.png", "c.png"])
    waits: list[float] = []
    assert len(list(open_camera(f"folder:{tmp_path}?fps=8&realtime=1", Clock(lambda: 0, waits.append)).frames())) == 3
    assert waits == [0.125, 0.25]


def test_a_missing_folder_an_empty_one_and_a_file_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a.txt").write_text("no picture")
    for place, why in [
        (tmp_path / "none", "No such file or directory"),
        (tmp_path, r"no picture matches '\*'; read are jpg, jpeg, png"),
        (tmp_path / "a.txt", "Not a directory; give a folder of pictures"),
    ]:
        with pytest.raises(CameraNotOpened, match=why) as refused:
            open_camera(f"folder:{place}")
        assert str(place) in str(refused.value)
        assert ONE_SENTENCE.fullmatch(str(refused.value))


def test_a_broken_picture_stops_the_sweep_and_is_named(tmp_path: Path) -> None:
    write(tmp_path, ["1.jpg", "2.jpg", "3.jpg"])
    whole = (tmp_path / "2.jpg").read_bytes()
    (tmp_path / "2.jpg").write_bytes(whole[: len(whole) - 40])
    frames = open_camera(f"folder:{tmp_path}").frames()
    assert next(frames).sequence == 0
    with pytest.raises(CameraStopped, match=r"2\.jpg: stopped after 1 frames: jpeg picture of \d+ bytes") as refused:
        next(frames)
    assert ONE_SENTENCE.fullmatch(str(refused.value))


def test_a_picture_that_went_away_stops_the_sweep(tmp_path: Path) -> None:
    write(tmp_path, ["1.png", "2.png"])
    camera = open_camera(f"folder:{tmp_path}")
    (tmp_path / "2.png").unlink()
    with pytest.raises(CameraStopped, match=r"2\.png: stopped after 1 frames: No such file"):
        list(camera.frames())


def test_a_pace_of_nothing_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OptionRefused, match="fps='0'"):
        open_camera(f"folder:{write(tmp_path, ['1.png'])}?fps=0")
