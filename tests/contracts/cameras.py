"""What every camera must do; the tests of each inherit this and say which url to open."""

from __future__ import annotations

import re
from abc import ABC, abstractmethod
from itertools import pairwise

import numpy as np
import pytest

from inspector.cameras import Clock, open_camera
from inspector.errors import CameraError
from inspector.pictures import decode
from models.frame import Frame

ONE_SENTENCE = re.compile(r"[^\n]{20,400}")


class CameraContract(ABC):
    """Inherit, and give a url of at least four frames that can be opened again and again."""

    @abstractmethod
    @pytest.fixture
    def url(self) -> str:
        """The camera under test."""

    @pytest.fixture
    def frames(self, url: str) -> list[Frame]:
        with open_camera(url) as camera:
            return list(camera.frames())

    def test_it_delivers_pictures_of_one_size(self, frames: list[Frame]) -> None:
        assert len(frames) >= 4
        assert len({(frame.size, frame.pixels.ndim, frame.pixels.dtype) for frame in frames}) == 1

    def test_its_pixels_cannot_be_written(self, frames: list[Frame]) -> None:
        with pytest.raises(ValueError, match="read-only"):
            frames[0].pixels[0, 0] = 0

    def test_its_pictures_are_not_overwritten_by_the_next(self, url: str, frames: list[Frame]) -> None:
        with open_camera(url) as camera:
            for frame, kept in zip(camera.frames(), frames, strict=True):
                np.testing.assert_array_equal(frame.pixels, kept.pixels)

    def test_time_and_sequence_increase(self, frames: list[Frame]) -> None:
        assert frames[0].sequence == 0
        assert all(a.t_ns < b.t_ns and a.sequence < b.sequence for a, b in pairwise(frames))

    def test_what_came_encoded_decodes_to_the_pixels(self, frames: list[Frame]) -> None:
        for frame in frames:
            if frame.encoded is not None:
                np.testing.assert_array_equal(decode(frame.encoded), frame.pixels)

    def test_closing_ends_the_iteration(self, url: str) -> None:
        camera = open_camera(url)
        frames = camera.frames()
        first = next(frames)
        camera.close()
        camera.close()
        assert first.sequence == 0
        assert list(frames) == []
        assert list(camera.frames()) == []

    def test_two_opens_give_equal_frames(self, url: str, frames: list[Frame]) -> None:
        with open_camera(url) as camera:
            again = [(f.t_ns, f.sequence, f.encoder, f.encoded, f.pixels.tobytes()) for f in camera.frames()]
        assert again == [(f.t_ns, f.sequence, f.encoder, f.encoded, f.pixels.tobytes()) for f in frames]

    def test_it_does_not_wait_unless_asked(self, url: str) -> None:
        waits: list[float] = []
        with open_camera(url, Clock(lambda: 0, waits.append)) as camera:
            assert len(list(camera.frames())) >= 4
        assert waits == []

    def test_it_describes_itself_in_words(self, url: str) -> None:
        with open_camera(url) as camera:
            facts = camera.describe()
        assert facts["camera"] == url.partition(":")[0]
        assert all(isinstance(value, str) and value for value in facts.values())

    def test_an_unknown_option_is_refused_with_those_known(self, url: str) -> None:
        with pytest.raises(CameraError, match=r"unknown option 'colr'; known are \w+, ") as refused:
            open_camera(url + ("&" if "?" in url else "?") + "colr=1")
        assert ONE_SENTENCE.fullmatch(str(refused.value))
